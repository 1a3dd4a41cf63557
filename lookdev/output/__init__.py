"""The files that a job writes: EXR frames, and the outputs that are made from frames, whose registry is `OUTPUTS`."""

from typing import Any

from pydantic import Field

from lookdev.output.movie import write_grid, write_h264, write_prores, write_vp9
from lookdev.output.record import Output, write_picture
from lookdev.output.sheet import write_contact_sheet, write_overview

_COLUMNS = "Looks in a row of an overview; by default as many as fill a page of 16:10."
_FPS = "Frames a second of movies; 23.976, 29.97 and 59.94 stand for 24, 30 and 60 times 1000/1001."
_TURNS = "Number of times that a movie shows its turntable; no frame is doubled where it starts again."
_SLATE = "Seconds of a slate before each movie; 0 for no slate."
# Fields of an `Output` that all movies share.
_MOVIE: dict[str, Any] = {
    "options": {
        "fps": (float, Field(default=24.0, ge=1.0, le=240.0, description=_FPS)),
        "movie_turns": (int, Field(default=1, ge=1, le=100, description=_TURNS)),
        "slate": (float, Field(default=0.0, ge=0.0, le=60.0, description=_SLATE)),
    },
    "extra": ("movie", "av"),  # the extra of this package, and the module whose presence shows that it is installed
}
# Fields of an `Output` that all movies of a single turntable share: text can be burned into their frames.
_TURNTABLE_MOVIE = {**_MOVIE, "can_burn_in": True}

OUTPUTS: dict[str, Output] = {
    output.name: output
    for output in (
        Output(
            "png",
            "A display picture beside each EXR.",
            scope="frame",
            suffix=".png",
            write=write_picture,
            default=True,
            can_burn_in=True,
        ),
        Output(
            "sheet",
            "A contact sheet for each turntable.",
            scope="turntable",
            suffix=".sheet.png",
            write=write_contact_sheet,
            default=True,
        ),
        Output(
            "overview",
            "A sheet of all looks side by side, for each light and turntable: the first frame of each look.",
            scope="looks",
            suffix=".looks.png",
            write=write_overview,
            options={"overview_columns": (int | None, Field(default=None, ge=1, le=1000, description=_COLUMNS))},
        ),
        Output(
            "wedges",
            "A sheet for each [[wedge]], look and light.",
            scope="wedge",
            suffix=".wedge.png",
            write=write_contact_sheet,
            default=True,
        ),
        Output(
            "movie",
            "A movie of each turntable, H.264 in MP4.",
            scope="turntable",
            suffix=".mp4",
            write=write_h264,
            **_TURNTABLE_MOVIE,
        ),
        Output(
            "prores",
            "A movie of each turntable with alpha, ProRes.",
            scope="turntable",
            suffix=".mov",
            write=write_prores,
            **_TURNTABLE_MOVIE,
        ),
        Output(
            "vp9",
            "A movie of each turntable with alpha, VP9 in WebM.",
            scope="turntable",
            suffix=".webm",
            write=write_vp9,
            **_TURNTABLE_MOVIE,
        ),
        Output(
            "grid",
            "A movie of all looks side by side, in step, for each light and turntable, H.264.",
            scope="looks in step",
            suffix=".looks.mp4",
            write=write_grid,
            **_MOVIE,
        ),
    )
}
"""All outputs except the EXR frames, by name."""
