"""The table of the ground."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from lookdev.job.features import check_feature
from lookdev.job.keys import MaterialFile, PrimPath, Table, Text, key_error

_SUMMING_PASSES = ("lobes", "direct", "lights", "cryptomatte")
"""The passes that sum up to the beauty or to its alpha; a shadow catcher takes light and coverage away from both."""


class JobGround(Table):
    """The ground that the asset stands on."""

    kind: Literal["catcher", "plane"] = Field(
        default="catcher",
        description="catcher: only what the asset does to its light is shown, in colour and alpha; plane: all of it.",
    )
    material: MaterialFile | None = Field(
        default=None, description="A USD or MaterialX file with its look; default: Lambert's, 18 % grey."
    )
    prim: PrimPath | None = Field(
        default=None, description="The material's prim; default: the file's default prim, or its only material."
    )
    variants: dict[Text, Text] = Field(
        default_factory=dict, description="The variant chosen in each variant set of the material."
    )
    size: Annotated[float, Field(ge=1.0, le=1000.0)] = Field(
        default=10.0, description="Its radius, in radii of the asset's bounding sphere."
    )
    height: Annotated[float, Field(ge=-1e9, le=1e9)] | None = Field(
        default=None, description="Its z in metres; default: that of the asset's lowest point."
    )

    @field_validator("prim", "variants")
    @classmethod
    def _require_material(cls, value: object, info: ValidationInfo) -> object:
        if info.data.get("material", ...) is None:
            raise key_error("has no meaning without 'material'", "it chooses among what a file has")
        return value

    def check(self, backend: str, denoise: str, passes: Iterable[str]) -> None:
        """Raise the error of a job whose [render] rules the ground out."""
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
