"""Lights of UsdLux: the interface through which each kind of light reads its own prims.

A kind has a `UsdLight` with a function that turns a `PlacedPrim` into a `UsdLightShape`. The emission is read
separately, in `lookdev.light.rig.emission`. A scale that differs between axes is supported where the kind's shape
allows it.
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

_SCALE_TOLERANCE = 1e-5  # relative difference of scales that counts as rounding in float32

LIGHT_ATTRIBUTES = ("turns", "camera", "lightGroup")
"""The attributes in the namespace ``lookdev:`` of all lights."""

FALLOFF_ATTRIBUTES = tuple(f"falloff:{name}" for name in ("virtualDistance", "exponent", "start", "end"))
"""The attributes in the namespace ``lookdev:`` of lights with a position, besides `LIGHT_ATTRIBUTES`."""


@dataclass(frozen=True)
class UsdLightShape:
    """The content of a light prim without its emission.

    Parameters
    ----------
    make
        A function that returns the light with radiance 1; its argument is the light's image, or None.
    area
        The light's area in square metres. If the power is normalized, the radiance is divided by the area in square
        units of the stage. None if the divisor is `size`.
    size
        The divisor of the radiance if the power is normalized and `area` is None. A distant light has a divisor in
        steradians, which does not depend on the unit of length; a dome has 1.
    lengths
        The sizes of the light in metres, for a check of their range.
    image
        The image file.
    space
        The colour space that the prim states for the image, or "".
    format
        The format of a dome's image; "" for other lights.
    """

    make: Callable[[EnvironmentMap | None], Light]
    area: float | None = None
    size: float = 1.0
    lengths: tuple[float, ...] = ()
    image: Path | None = None
    space: str = ""
    format: str = ""

    @classmethod
    def without_image(cls, light: PlacedLight) -> UsdLightShape:
        """Return the shape of a light without an image."""
        return cls(lambda _: light, light.size_factor, lengths=light.shape_numbers)


@dataclass(frozen=True)
class UsdLight:
    """The reader of prims of one type, and the names of these prims' attributes in the namespace ``lookdev:``.

    `read` reports a wrong value as a fault, and continues with the default of that value.
    """

    read: Callable[[PlacedPrim], UsdLightShape]
    attributes: tuple[str, ...] = (*LIGHT_ATTRIBUTES, *FALLOFF_ATTRIBUTES)


@dataclass(frozen=True, eq=False)
class PlacedPrim:
    """A light prim to be read, with its placement in the world.

    `position` is in metres, `scale` in metres per unit along each axis. `y_up` is whether the stage has y up.
    If `sampled`, domes get the tables with which a shader draws directions.
    """

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
        """Return a length in metres; `scale` is in metres per unit."""
        return scale * self.light.number(f"inputs:{name}", above=0.0, default=1.0)

    def radius(self, hint: str, shape: str, others: tuple[int, ...]) -> float:
        """Return the radius in metres of a sphere or cylinder light, which scales with the y axis.

        `hint` is the attribute ``treatAsPoint`` or ``treatAsLine``, of which UsdLux states: "Renderers that only
        support area lights can disregard this". The attribute is disregarded, because mirrors reflect the surface of a
        lamp. A note says so, and calls the light a `shape`. Raises EnvironmentMapError unless the axes `others` (0 for
        x, 2 for z) have the same scale as y.
        """
        if self.light.flag(hint):
            right = "a small radius would be right"
            self.light.note(hint, f"is disregarded: the light is a {shape} of its radius; {right}")
        radius = self.length("radius", self.scale[1])
        for other in others:
            self.check_scales(*sorted((1, other)))
        return radius

    def check_scales(self, first: int, second: int) -> None:
        """Raise EnvironmentMapError if the scale along two axes differs."""
        a, b = self.scale[first], self.scale[second]
        if abs(a - b) > _SCALE_TOLERANCE * max(a, b):
            raise EnvironmentMapError(
                f"is scaled by {a:.6g} along {'xyz'[first]} and {b:.6g} along {'xyz'[second]}; the same scale along "
                f"both would be right for a {self.kind}"
            )

    @property
    def image(self) -> tuple[Path | None, str]:
        """The image file of the light, or None, and the colour space that the prim states for it, or ""."""
        name = "inputs:texture:file"
        return self.light.file(name), self.light.space(name)
