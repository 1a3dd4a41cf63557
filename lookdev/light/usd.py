"""Lights of UsdLux: what is read of a prim beside its emission, and how a kind of light reads it.

A light that is scaled by different factors is one of the same kind where its shape allows it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lookdev.errors import EnvironmentMapError
from lookdev.light.dome.environment import EnvironmentMap
from lookdev.light.placement import Axes, Vector

if TYPE_CHECKING:
    from lookdev.light.base import Light
    from lookdev.light.placed import PlacedLight
    from lookdev.light.rig.attributes import LightPrim

_SAME = 1e-5  # relative: scales that differ by less are one, as float32 has them

ALL_LIGHTS = ("turns", "camera", "lightGroup")
FALLOFF = tuple(f"falloff:{name}" for name in ("virtualDistance", "exponent", "start", "end"))
"""Attributes below ``lookdev:`` of all lights, and of those that have a place."""


@dataclass(frozen=True)
class LightShape:
    """What is read of a prim beside its emission.

    `make` makes the light, of emission 1, from its image if it has one. Where power is normalized, it is divided by
    `area`, in square metres, or by `size`, of a light without an area. `lengths` are in metres. `image` is a file, of
    the colour space `space` if one is stated, and of the format `format` if the light is a dome.
    """

    make: Callable[[EnvironmentMap | None], Light]
    area: float | None = None
    size: float = 1.0
    lengths: tuple[float, ...] = ()
    image: Path | None = None
    space: str = ""
    format: str = ""

    @classmethod
    def of(cls, light: PlacedLight, *lengths: float) -> LightShape:
        """Return the shape of a light without an image."""
        return cls(lambda _: light, light.size_factor, lengths=lengths)


@dataclass(frozen=True)
class UsdLight:
    """How prims of a type are read, and the attributes below ``lookdev:`` that they have.

    `read` reports a value that is wrong as a fault, and goes on with its default.
    """

    read: Callable[[PlacedPrim], LightShape]
    attributes: tuple[str, ...] = (*ALL_LIGHTS, *FALLOFF)


@dataclass(frozen=True, eq=False)
class PlacedPrim:
    """A light prim to be read: its place and scales in metres, its axes, and whether domes need tables to sample."""

    light: LightPrim
    position: Vector
    axes: Axes
    scale: Vector
    y_up: bool
    sampled: bool

    @property
    def kind(self) -> str:
        """The type of the prim."""
        return str(self.light.prim.GetTypeName())

    def length(self, name: str, scale: float) -> float:
        """Return a length in metres."""
        return scale * self.light.number(f"inputs:{name}", above=0.0, default=1.0)

    def radius(self, hint: str, shape: str, others: tuple[int, ...]) -> float:
        """Return the radius of a light that other renderers may take for a point or a line, as `hint` tells them to.

        "Renderers that only support area lights can disregard this": each lamp has a surface here, for mirrors show it.
        It is scaled as y is; raises EnvironmentMapError unless the `others` are scaled alike.
        """
        if self.light.flag(hint):
            right = "a small radius would be right"
            self.light.note(hint, f"is disregarded: the light is a {shape} of its radius; {right}")
        radius = self.length("radius", self.scale[1])
        for other in others:
            self.check_scales(*sorted((1, other)))
        return radius

    def check_scales(self, first: int, second: int) -> None:
        """Raise EnvironmentMapError where the scale along two axes differs."""
        a, b = self.scale[first], self.scale[second]
        if abs(a - b) > _SAME * max(a, b):
            raise EnvironmentMapError(
                f"is scaled by {a:.6g} along {'xyz'[first]} and {b:.6g} along {'xyz'[second]}; the same scale along "
                f"both would be right for a {self.kind}"
            )

    @property
    def image(self) -> tuple[Path | None, str]:
        """The image file of the light, if it has one, and its colour space if one is stated."""
        name = "inputs:texture:file"
        return self.light.file(name), self.light.space(name)
