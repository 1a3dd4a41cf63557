"""The table of reference props."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

from pydantic import Field

from lookdev.job.features import check_feature
from lookdev.job.keys import Table, key_error
from lookdev.scene.charts.props import FOLDER, Place, Strip

_LARGEST = 0.5


class JobCharts(Table):
    """A chrome ball, a grey ball and a colour chart beside the asset."""

    place: Place = Field(default="bottom", description="The edge of the frame that they stand along.")
    size: Annotated[float, Field(ge=0.02, le=_LARGEST)] = Field(
        default=0.12, description="The share of the frame's height that they take; at its left or right, of its width."
    )

    def strip(self, resolution: tuple[int, int]) -> Strip:
        """Return the strip of a frame that the props take."""
        return Strip(self.place, self.size, resolution)

    def check(self, resolution: tuple[int, int], backend: str, looks: Iterable[str]) -> None:
        """Raise the error of a job whose resolution, backend or names of looks rule the props out."""
        problem, hint = self.strip(resolution).misfit()
        if problem:
            raise key_error(problem, hint)
        check_feature("charts", backend, self)
        if FOLDER in {name.casefold() for name in looks}:
            raise key_error(f"a look of the job is called '{FOLDER}', the name of the frames of [charts]", "rename it")
