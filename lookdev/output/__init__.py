"""What a user gets: float EXR frames, and the files that are made of them, a record each in one registry."""

from typing import Annotated

from pydantic import Field

from lookdev.output.display import composite, to_display, write_png
from lookdev.output.exr import read_frame, read_header, write_frame
from lookdev.output.record import Frames, Output, write_picture
from lookdev.output.sheet import write_overview, write_sheet, write_turntable

_COLUMNS = Field(default=None, description="Looks in a row of an overview; default: what fills a page of 16:10.")

OUTPUTS: dict[str, Output] = {
    output.name: output
    for output in (
        Output("png", "A display picture beside each EXR.", "frame", ".png", write_picture, True),
        Output("sheet", "A contact sheet for each turntable.", "turntable", ".sheet.png", write_turntable, True),
        Output(
            "overview",
            "A sheet of all looks side by side, for each light and turntable: the first frame of each look.",
            "looks",
            ".looks.png",
            write_overview,
            options={"overview_columns": (Annotated[int, Field(ge=1, le=1000)] | None, _COLUMNS)},
        ),
    )
}
"""Every output but the EXR frames, by its name."""

__all__ = [
    "OUTPUTS", "Frames", "Output", "composite", "read_frame", "read_header", "to_display", "write_frame", "write_png",
    "write_sheet",
]  # fmt: skip
