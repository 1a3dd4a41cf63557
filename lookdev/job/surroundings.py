"""The tables ``[charts]`` and ``[ground]`` of a job: reference props beside the asset, and the ground under it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field, field_validator

from lookdev.job.features import check_feature
from lookdev.job.keys import JobTable, MaterialFile, MaterialPrim, Text, key, key_error, reject_key
from lookdev.scene.charts.props import PROPS_FOLDER, FrameSide, Strip

_SUMMING_PASSES = ("lobes", "direct", "lights", "cryptomatte")
"""The passes that sum up to the beauty pass or to its alpha.

A job with a shadow catcher cannot have these passes: the catcher subtracts light from the beauty, and coverage from the
alpha.
"""


class JobCharts(JobTable):
    """A chrome ball, a grey ball and a colour chart beside the asset."""

    place: FrameSide = key("bottom", "The edge of the frame that they stand along.")
    size: Annotated[float, Field(ge=0.02, le=0.5)] = key(
        0.12, "The share of the frame's height that they take; at its left or right, of its width."
    )

    def strip(self, resolution: tuple[int, int]) -> Strip:
        """Return the strip of a frame in which the props are."""
        return Strip(self.place, self.size, resolution)

    def check(self, resolution: tuple[int, int], backend: str, looks: Iterable[str]) -> None:
        """Raise a key error if the resolution, the backend or the name of a look of the job excludes the props."""
        problem, hint = self.strip(resolution).fit_fault()
        if problem:
            raise key_error(problem, hint)
        check_feature("charts", backend, self)
        if PROPS_FOLDER in {name.casefold() for name in looks}:
            raise key_error(
                f"a look of the job is called '{PROPS_FOLDER}', the name of the frames of [charts]", "rename it"
            )


class JobGround(JobTable):
    """The ground that the asset stands on."""

    kind: Literal["catcher", "plane"] = key(
        "catcher", "catcher: only what the asset does to its light is shown, in colour and alpha; plane: all of it."
    )
    material: MaterialFile | None = key(None, "A USD or MaterialX file with its look; default: Lambert's, 18 % grey.")
    prim: MaterialPrim = None
    variants: dict[Text, Text] = Field(
        default_factory=dict, description="The variant chosen in each variant set of the material."
    )
    size: Annotated[float, Field(ge=1.0, le=1000.0)] = key(10.0, "Its radius, in radii of the asset's bounding sphere.")
    height: Annotated[float, Field(ge=-1e9, le=1e9)] | None = key(
        None, "Its z in metres; default: that of the asset's lowest point."
    )

    _require_material = field_validator("prim", "variants")(
        reject_key("without", "material", "it chooses among what a file has")
    )

    def check(self, backend: str, denoise: str, passes: Iterable[str]) -> None:
        """Raise a key error if a value of the table ``[render]`` excludes the ground."""
        check_feature("ground", backend, self.kind)
        if self.kind != "catcher":
            return
        if denoise != "off":
            raise key_error("the alpha of a shadow catcher is not denoised", 'denoise = "off", or kind = "plane"')
        if excluded := [name for name in passes if name in _SUMMING_PASSES]:
            raise key_error(
                f"a shadow catcher has no {' and no '.join(excluded)}, which sum up to a frame with all of the ground",
                'passes without them, or kind = "plane"',
            )
