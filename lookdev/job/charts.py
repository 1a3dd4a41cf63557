"""The table of reference props."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

from pydantic import Field

from lookdev.job.features import check_feature
from lookdev.job.keys import Table, wrong
from lookdev.scene.charts import FOLDER, Strip
from lookdev.scene.charts.props import Place

_LARGEST = 0.5


class JobCharts(Table):
    """A chrome ball, a grey ball and a colour chart beside the asset."""

    place: Place = Field(default="bottom", description="The edge of the frame that they stand along.")
    size: Annotated[float, Field(ge=0.02, le=_LARGEST)] = Field(
        default=0.12, description="The part of the frame's height, or at its sides of its width, that they take."
    )

    def strip(self, resolution: tuple[int, int]) -> Strip:
        """Return the strip of a frame that shows them."""
        return Strip(self.place, self.size, resolution)

    def check(self, resolution: tuple[int, int], backend: str, looks: Iterable[str]) -> None:
        """Raise the fault of a job, by its resolution, backend and names of looks."""
        what, hint = self.strip(resolution).misfit()
        if what:
            raise wrong(what, hint)
        check_feature("charts", backend, self)
        if FOLDER in {name.casefold() for name in looks}:
            raise wrong(f"a look of the job is called '{FOLDER}', the name of the frames of [charts]", "rename it")
