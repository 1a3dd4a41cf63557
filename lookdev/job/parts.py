"""The tables ``[asset]`` and ``[[look]]`` of a job: the asset, and the materials of the asset's parts."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator

from lookdev.asset import BUILTINS
from lookdev.job.keys import (
    JobTable,
    KeyName,
    MaterialFile,
    MaterialPrim,
    OneOf,
    PrimPath,
    Text,
    UsdFile,
    alternative_to,
    key,
    key_error,
    reject_key,
)

_Variants = dict[Text, Text]
BuiltinAsset = Annotated[str, OneOf(lambda: BUILTINS)]
Purpose = Literal["default", "render", "proxy", "guide"]
SubdivisionLevel = Annotated[
    Annotated[Literal["auto"], Tag("name")] | Annotated[Annotated[int, Field(ge=0, le=6)], Tag("level")],
    Discriminator(lambda value: "name" if isinstance(value, str) else "level"),
]


def _check_variants(variants: dict[str, str]) -> dict[str, str]:
    """Return the variants; raise a key error if one of them is ``"*"``, which only a ``[[look]]`` supports."""
    for name, choice in variants.items():
        if choice == "*":
            raise key_error(f"'{name}' is '*'", "only the 'variants' of a [[look]] can stand for several looks")
    return variants


class JobAsset(JobTable):
    """The asset: a USD file or a built-in asset."""

    usd: UsdFile | None = key(None, "A USD file (.usd, .usda, .usdc, .usdz) with the geometry.")
    builtin: Annotated[BuiltinAsset | None, alternative_to("usd")] = Field(
        default=None, validate_default=True, description="A built-in asset, instead of a file."
    )
    prim: PrimPath | None = key(None, "Render only what is under this prim of the USD file; default: everything.")
    variants: _Variants = Field(
        default_factory=dict,
        description="The variant chosen in each variant set of the asset: { modelingVariant = 'hero' }; "
        "default: the file's own choice.",
    )
    time: Annotated[float, Field(ge=-1e9, le=1e9)] | None = key(
        None, "The time code at which an animated asset is shown; default: its first."
    )
    purposes: Annotated[tuple[Purpose, ...], Field(min_length=1)] = key(
        ("default", "render"), "Prims of these purposes are rendered."
    )
    subdivision: SubdivisionLevel = key(
        "auto", "How often subdivision surfaces are refined; auto: by their size in the frame."
    )
    missing: Literal["error", "warn"] = key(
        "error", "What a file that the asset names and that cannot be found is: an error, or a note."
    )

    @field_validator("prim", "variants", "time", "purposes", "subdivision", "missing")
    @classmethod
    def _require_usd(cls, value: object, info: ValidationInfo) -> object:
        if info.data.get("builtin") is not None:
            raise key_error("has no meaning with a built-in asset", f"'{info.field_name}' goes with 'usd'")
        return value

    _reject_star = field_validator("variants")(_check_variants)


class JobAssign(JobTable):
    """A material, and the parts of the asset that it is assigned to."""

    prims: Annotated[tuple[Text, ...], Field(min_length=1)] = Field(
        description="Prims of the asset, with all that is below them: paths, globs ('/Car/Body*'), "
        "and collections ('/Car.collection:paint')."
    )
    material: MaterialFile = Field(description="A USD or MaterialX file with their look, a material.")
    prim: MaterialPrim = None
    variants: _Variants = Field(
        default_factory=dict, description="The variant chosen in each variant set of the material."
    )

    _reject_star = field_validator("variants")(_check_variants)


class JobLook(JobTable):
    """One look: the materials of the asset's parts."""

    name: KeyName = Field(description="The look's name, unique; it becomes a folder of the output.")
    material: MaterialFile | None = key(
        None,
        "A USD or MaterialX file with a material, for every part that nothing is assigned to; "
        "default: what the asset itself binds.",
    )
    prim: MaterialPrim = None
    variants: _Variants = Field(
        default_factory=dict,
        description="The variant chosen in each variant set of the material, or of the asset where the look has no "
        "'material': { wear = 'dirty' }. '*' makes a look of each: { wear = '*' } of 'paint' gives 'paint_clean', "
        "'paint_dirty'.",
    )
    parts: Annotated[tuple[Text, ...], Field(min_length=1)] | None = key(
        None,
        "Prims, as those of 'assign', that 'material' covers; other parts have what the asset binds; default: all.",
    )
    layer: UsdFile | None = key(
        None, "A USD layer that is composed over the asset, with bindings, materials, variants."
    )
    assign: tuple[JobAssign, ...] = key((), "Materials of some parts; the first entry that names a part counts.")

    _require_material = field_validator("prim", "parts")(
        reject_key("without", "material", "a look without 'material' has what the asset binds")
    )
