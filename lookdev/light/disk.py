"""Disk light: `UsdLuxDiskLight`.

Sampling draws directions to the bounding rectangle. Some directions miss the disk; they carry no light.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.vectors import Real
from lookdev.light.base import LightKind
from lookdev.light.placed import PlacedLight
from lookdev.light.rect import RectangleShape
from lookdev.light.shape import FAR, LampShape, cone_about
from lookdev.light.spherical_rectangle import approximate_solid_angle, intersect_rectangle
from lookdev.light.usd import PlacedPrim, UsdLight, UsdLightShape


@dataclass(frozen=True)
class Ellipse:
    """The `LampShape` of an ellipse whose radii along x and y are `x` and `y`."""

    x: Real
    y: Real

    def distance(self, point: Floats, direction: Floats) -> Floats:
        distance, hit = intersect_rectangle(point, direction, 2 * self.x, 2 * self.y)
        # Fractions of the bounding rectangle's width and height from its centre, where the ellipse has radius 0.5.
        s, t = hit.s - 0.5, hit.t - 0.5
        return np.where(s * s + t * t <= 0.25, distance, FAR)

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        return self._bounding_rectangle.pdf(point, direction)

    def sample(self, point: Floats, u: Floats) -> Floats:
        return self._bounding_rectangle.sample(point, u)

    def solid_angle(self, point: Floats) -> Floats:
        return approximate_solid_angle(point, 2 * self.x, 2 * self.y, math.pi * self.x * self.y)

    def cone(self, point: Floats) -> tuple[Floats, Floats]:
        return cone_about(point, np.maximum(self.x, self.y))

    @property
    def _bounding_rectangle(self) -> RectangleShape:
        return RectangleShape(2 * self.x, 2 * self.y)


@dataclass(frozen=True, kw_only=True)
class DiskLight(PlacedLight):
    """An ellipse, of `radii` in metres along its x and y, that emits from its -z side."""

    kind = "disk"
    one_sided = True
    shapes: ClassVar[Mapping[str, type[LampShape]]] = {"disk": Ellipse}
    example_sizes: ClassVar[Mapping[str, tuple[float, float]]] = {"radii": (0.7, 0.5)}

    radii: tuple[float, float]

    @property
    def shape_numbers(self) -> tuple[float, ...]:
        return self.radii

    @property
    def reach(self) -> float:
        """Metres from the centre to the farthest point of the edge."""
        return max(self.radii)

    @property
    def sizes(self) -> dict[str, float]:
        x, y = self.radii
        return {"radius x": x, "radius y": y} if x != y else {"radius": x}

    def resize(self, scale: float) -> DiskLight:
        return replace(self, radii=(scale * self.radii[0], scale * self.radii[1]))

    @property
    def mitsuba_shape(self) -> tuple[str, Floats]:
        return "disk", np.diag([*self.radii, 1.0, 1.0])

    @property
    def size_factor(self) -> float:
        """The area in square metres."""
        return math.pi * self.radii[0] * self.radii[1]


def _read(prim: PlacedPrim) -> UsdLightShape:
    radius = prim.length("radius", 1.0)
    x, y = prim.scale[0] * radius, prim.scale[1] * radius
    return UsdLightShape.without_image(DiskLight(radii=(x, y), position=prim.position, axes=prim.axes))


DISK = LightKind(DiskLight, DiskLight.example, {"DiskLight": UsdLight(_read)})
