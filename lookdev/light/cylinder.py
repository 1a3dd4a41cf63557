"""Cylinder light: `UsdLuxCylinderLight`.

Sampling draws directions to a rectangle that covers the cylinder's curved side as seen from the shading point. Some
directions miss the side; they carry no light.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from lookdev.arrays import Bools, Floats
from lookdev.light.base import LightKind
from lookdev.light.placed import PlacedLight
from lookdev.light.shape import FAR, LampShape, cone_about
from lookdev.light.spherical_rectangle import RectanglePoint, SphericalRectangle, density, draw, project_rectangle
from lookdev.light.usd import PlacedPrim, UsdLight, UsdLightShape

_MARGIN = 1e-6  # relative margin of the covering rectangle's width
_TINY = 1e-30  # replaces divisors of 0


@dataclass(frozen=True)
class Cylinder:
    """The `LampShape` of a cylinder about x without caps, whose curved side emits outwards."""

    length: Floats | float
    radius: Floats | float

    def distance(self, point: Floats, direction: Floats) -> Floats:
        return intersect_side(point, direction, self.length, self.radius)

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        cover = covering_rectangle(point, self.length, self.radius)
        local = cover.to_frame(direction)
        in_front = cover.outside & (local[..., 2] > 0)
        depth_scale = np.where(in_front, cover.away / np.where(in_front, local[..., 2], 1), 0)
        x, y = depth_scale * local[..., 0], depth_scale * local[..., 1]
        # The fractions of the rectangle's width and height at which the direction meets its plane.
        s, t = (x - cover.x0) / cover.width, (y + cover.half) / (2 * cover.half)
        hits = in_front & (np.absolute(s - 0.5) <= 0.5) & (np.absolute(t - 0.5) <= 0.5)
        target = RectanglePoint(np.clip(s, 0, 1), np.clip(t, 0, 1), x, y)
        return np.where(hits, density(cover.spherical_rectangle, target), 0)

    def sample(self, point: Floats, u: Floats) -> Floats:
        cover = covering_rectangle(point, self.length, self.radius)
        return cover.directions_to(draw(cover.spherical_rectangle, u))

    def solid_angle(self, point: Floats) -> Floats:
        x, y, z = np.moveaxis(point, -1, 0)
        axis_distance = np.sqrt(y * y + z * z)
        beyond_end = np.maximum(np.absolute(x) - self.length / 2, 0)
        side_distance = axis_distance - self.radius
        # The visible side is treated as a rectangle of 2 radius by length, at its nearest point. The cosine to the
        # normal of the rectangle is the sine of the angle to the axis.
        squared, area = beyond_end * beyond_end + side_distance * side_distance, 2 * self.radius * self.length
        sine = axis_distance / np.sqrt(np.maximum(beyond_end * beyond_end + axis_distance * axis_distance, _TINY))
        return np.where(side_distance > 0, area * sine / (squared + area / (2 * math.pi)), 0)

    def cone(self, point: Floats) -> tuple[Floats, Floats]:
        return cone_about(point, np.sqrt(self.length * self.length / 4 + self.radius * self.radius))


@dataclass(frozen=True, kw_only=True)
class CylinderLight(PlacedLight):
    """A cylinder of `length` along its x and a `radius`, in metres, whose side emits outwards; it has no caps."""

    kind = "cylinder"
    shapes: ClassVar[Mapping[str, type[LampShape]]] = {"cylinder": Cylinder}
    example_sizes: ClassVar[Mapping[str, float]] = {"length": 1.5, "radius": 0.2}

    length: float
    radius: float

    @property
    def reach(self) -> float:
        """Metres from the centre to an edge of the side."""
        return math.hypot(self.length / 2.0, self.radius)

    @property
    def size_factor(self) -> float:
        """The area of the side in square metres."""
        return 2.0 * math.pi * self.radius * self.length


def intersect_side(point: Floats, direction: Floats, length: Floats | float, radius: Floats | float) -> Floats:
    """Return the distance (...) along directions (..., 3) to a cylinder's side; `FAR` for misses, and from inside."""
    x, y, z = np.moveaxis(point, -1, 0)
    wx, wy, wz = np.moveaxis(direction, -1, 0)
    moment, squared_sine = y * wz - z * wy, wy * wy + wz * wz
    approach = -(y * wy + z * wz)
    discriminant = radius * radius * squared_sine - moment * moment
    hits = (y * y + z * z > radius * radius) & (approach > 0) & (discriminant >= 0)
    distance = (approach - np.sqrt(np.maximum(discriminant, 0))) / np.where(hits, squared_sine, 1)
    hits = hits & (np.absolute(x + np.where(hits, distance, 0) * wx) <= length / 2)
    return np.where(hits, distance, FAR)


class CoveringRectangle(NamedTuple):
    """Rectangles (...) that cover the side of a cylinder as seen from points (...), each in the frame of its point.

    The origin of a frame is its point, x is along the cylinder's axis, and z points to the axis at right angles. The
    rectangle is at z = `away`, from -`half` to `half` along y and from `x0` to `x0 + width` along x. Along y it is as
    wide as the cylinder's outline.
    """

    outside: Bools
    """Whether the point is outside the infinite cylinder; the side is visible only from such points."""
    y: Floats
    z: Floats
    """The frame's z axis is (0, y, z) in the cylinder's space; `y` and `z` are its coordinates there."""
    x0: Floats
    width: Floats
    half: Floats
    away: Floats

    @property
    def spherical_rectangle(self) -> SphericalRectangle:
        return project_rectangle(self.x0, self.width, -self.half, 2 * self.half, self.away)

    def to_frame(self, direction: Floats) -> Floats:
        """Transform directions (..., 3) from the cylinder's space to the frames."""
        x, y, z = np.moveaxis(direction, -1, 0)
        return np.stack(np.broadcast_arrays(x, self.z * y - self.y * z, self.y * y + self.z * z), axis=-1)

    def directions_to(self, point: RectanglePoint) -> Floats:
        """Return the unit directions (..., 3), in the cylinder's space, to points of the rectangle."""
        x, y, z = np.broadcast_arrays(point.x, point.y, self.away)
        local: Floats = np.stack([x, self.z * y + self.y * z, self.z * z - self.y * y], axis=-1)
        length: Floats = np.sqrt((local * local).sum(axis=-1))
        return local / np.expand_dims(length, -1)


def covering_rectangle(point: Floats, length: Floats | float, radius: Floats | float) -> CoveringRectangle:
    """Return the rectangles that cover the side of a cylinder as seen from points (..., 3).

    Let R be the radius and D the distance of a point from the axis. Two planes through the point touch the cylinder, in
    two lines at the depth `away` = (D - R) (D + R) / D along the frame's z. The side between these lines has a depth of
    at least D - R. Projected from the point onto the rectangle's plane, the ends of the side therefore lie up to
    (D + R) / D times farther out.
    """
    x, y, z = np.moveaxis(point, -1, 0)
    axis_distance = np.sqrt(y * y + z * z)
    outside = axis_distance > radius
    axis_distance = np.where(outside, axis_distance, 2 * radius)
    growth = (axis_distance + radius) / axis_distance
    away = (axis_distance - radius) * growth
    # The margin keeps the cylinder's outline within the rectangle in spite of rounding.
    half = radius * np.sqrt((axis_distance - radius) * (axis_distance + radius)) / axis_distance * (1 + _MARGIN)
    start, end = -length / 2 - x, length / 2 - x
    start_margin, end_margin = np.maximum(-start, 0) * (growth - 1), np.maximum(end, 0) * (growth - 1)
    return CoveringRectangle(
        outside,
        np.where(outside, -y / axis_distance, 0),
        np.where(outside, -z / axis_distance, 1),
        start - start_margin,
        length + start_margin + end_margin,
        half,
        away,
    )


def _read(prim: PlacedPrim) -> UsdLightShape:
    radius, length = prim.radius("treatAsLine", "cylinder", (2,)), prim.length("length", prim.scale[0])
    return UsdLightShape.without_image(
        CylinderLight(length=length, radius=radius, position=prim.position, axes=prim.axes)
    )


CYLINDER = LightKind(CylinderLight, CylinderLight.example, {"CylinderLight": UsdLight(_read)})
