"""Cylinder light: `UsdLuxCylinderLight`.

Directions are drawn to a rectangle that covers its side as a place sees it; those that miss it bring no light.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lookdev.light.base import LightKind
from lookdev.light.emission import check_number
from lookdev.light.placed import EXAMPLE_AXES, EXAMPLE_EMISSION, PlacedLight
from lookdev.light.shape import FAR, cone_about
from lookdev.light.spherical_rectangle import Point, SphericalRectangle, density, draw, seen_rectangle
from lookdev.light.usd import LightShape, PlacedPrim, UsdLight

Floats: TypeAlias = Any
"""An array, or a symbolic one in its place."""

_MARGIN = 1e-6  # of the width of the outline
_TINY = 1e-30


@dataclass(frozen=True)
class Cylinder:
    """The `Shape` of the side of a cylinder about x, which sends outwards."""

    length: Any
    radius: Any

    def distance(self, place: Any, direction: Any) -> Any:
        return meet_side(place, direction, self.length, self.radius)

    def pdf(self, place: Any, direction: Any) -> Any:
        cover = covering(place, self.length, self.radius)
        towards = cover.inside(direction)
        before = cover.outside & (towards[..., 2] > 0)
        along = np.where(before, cover.away / np.where(before, towards[..., 2], 1), 0)
        x, y = along * towards[..., 0], along * towards[..., 1]
        s, t = (x - cover.x0) / cover.width, (y + cover.half) / (2 * cover.half)
        met = before & (np.absolute(s - 0.5) <= 0.5) & (np.absolute(t - 0.5) <= 0.5)
        point = Point(np.clip(s, 0, 1), np.clip(t, 0, 1), x, y)
        return np.where(met, density(cover.seen, point), 0)

    def sample(self, place: Any, u: Any) -> Any:
        cover = covering(place, self.length, self.radius)
        return cover.towards(draw(cover.seen, u))

    def solid_angle(self, place: Any) -> Any:
        x, y, z = np.moveaxis(place, -1, 0)
        far = np.sqrt(y * y + z * z)
        along = np.maximum(np.absolute(x) - self.length / 2, 0)
        off = far - self.radius
        # What is seen of the side is nearly a rectangle that faces the place, at the nearest point.
        squared, area = along * along + off * off, 2 * self.radius * self.length
        sine = far / np.sqrt(np.maximum(along * along + far * far, _TINY))
        return np.where(off > 0, area * sine / (squared + area / (2 * math.pi)), 0)

    def cone(self, place: Any) -> tuple[Any, Any]:
        return cone_about(place, np.sqrt(self.length * self.length / 4 + self.radius * self.radius))


@dataclass(frozen=True, kw_only=True)
class CylinderLight(PlacedLight):
    """A cylinder of `length` along its x and a `radius`, in metres, whose side emits outwards; it has no caps."""

    kind = "cylinder"
    shapes: ClassVar[Mapping[str, type[Any]]] = {"cylinder": Cylinder}

    length: float
    radius: float

    @classmethod
    def example(cls) -> CylinderLight:
        """Return a warm light above, to a side."""
        return cls(length=1.5, radius=0.2, position=(0.4, -1.0, 1.6), axes=EXAMPLE_AXES, emission=EXAMPLE_EMISSION)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("length", self.length, above=0.0)
        check_number("radius", self.radius, above=0.0)

    @property
    def shape(self) -> Cylinder:
        return Cylinder(self.length, self.radius)

    @property
    def reach(self) -> float:
        return math.hypot(self.length / 2.0, self.radius)

    @property
    def sizes(self) -> dict[str, float]:
        return {"length": self.length, "radius": self.radius}

    def resized(self, scale: float) -> CylinderLight:
        return replace(self, length=scale * self.length, radius=scale * self.radius)

    @property
    def size_factor(self) -> float:
        return 2.0 * math.pi * self.radius * self.length


def meet_side(place: Floats, direction: Floats, length: Any, radius: Any) -> Floats:
    """Return the distance (...) along directions (..., 3) to the outside; `FAR` if missed, or from inside."""
    x, y, z = np.moveaxis(place, -1, 0)
    wx, wy, wz = np.moveaxis(direction, -1, 0)
    across, steep = y * wz - z * wy, wy * wy + wz * wz
    towards = -(y * wy + z * wz)
    squared = radius * radius * steep - across * across
    met = (y * y + z * z > radius * radius) & (towards > 0) & (squared >= 0)
    distance = (towards - np.sqrt(np.maximum(squared, 0))) / np.where(met, steep, 1)
    met = met & (np.absolute(x + np.where(met, distance, 0) * wx) <= length / 2)
    return np.where(met, distance, FAR)


class Cover(NamedTuple):
    """The rectangle that covers the side of a cylinder as places (...) see it, in frames of the places' own.

    x is along the cylinder's axis, z from the place at right angles to the axis. It is as wide as the outline, at
    `away` along z, y from -`half` to `half`, x from `x0` to `x0 + width`.
    """

    outside: NDArray[np.bool_]
    """Whether the place is farther from the axis than the side: from elsewhere none of it is seen."""
    y: Floats
    z: Floats
    """The cylinder's y and z of the frame's z."""
    x0: Floats
    width: Floats
    half: Floats
    away: Floats

    @property
    def seen(self) -> SphericalRectangle:
        return seen_rectangle(self.x0, self.width, -self.half, 2 * self.half, self.away)

    def inside(self, direction: Floats) -> Floats:
        """Express directions (..., 3) of the cylinder in the frames."""
        x, y, z = np.moveaxis(direction, -1, 0)
        return np.stack(np.broadcast_arrays(x, self.z * y - self.y * z, self.y * y + self.z * z), axis=-1)

    def towards(self, point: Point) -> Floats:
        """Return the directions (..., 3) of the cylinder to points of the rectangle."""
        x, y, z = np.broadcast_arrays(point.x, point.y, self.away)
        local = np.stack([x, self.z * y + self.y * z, self.z * z - self.y * y], axis=-1)
        return local / np.expand_dims(np.sqrt((local * local).sum(axis=-1)), -1)


def covering(place: Floats, length: Any, radius: Any) -> Cover:
    """Return what covers the side of a cylinder from places (..., 3).

    The lines in which planes through the place touch it are at `away` = (D - R) (D + R) / D, D being the distance of
    the place from the axis. What lies between them is at least at D - R: its ends show farther out, up to (D + R) / D
    times.
    """
    x, y, z = np.moveaxis(place, -1, 0)
    far = np.sqrt(y * y + z * z)
    outside = far > radius
    far = np.where(outside, far, 2 * radius)
    grown = (far + radius) / far
    away = (far - radius) * grown
    # Rounding must not leave out the outline.
    half = radius * np.sqrt((far - radius) * (far + radius)) / far * (1 + _MARGIN)
    first, last = -length / 2 - x, length / 2 - x
    before, beyond = np.maximum(-first, 0) * (grown - 1), np.maximum(last, 0) * (grown - 1)
    return Cover(
        outside,
        np.where(outside, -y / far, 0),
        np.where(outside, -z / far, 1),
        first - before,
        length + before + beyond,
        half,
        away,
    )


def _read(prim: PlacedPrim) -> LightShape:
    radius, length = prim.radius("treatAsLine", "cylinder", (2,)), prim.length("length", prim.scale[0])
    light = CylinderLight(length=length, radius=radius, position=prim.position, axes=prim.axes)
    return LightShape.of(light, length, radius)


CYLINDER = LightKind(CylinderLight, CylinderLight.example, {"CylinderLight": UsdLight(_read)})
