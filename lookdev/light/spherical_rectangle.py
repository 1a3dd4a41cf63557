"""Sampling of directions to a rectangle, nearly uniform over its solid angle, with an exact pdf.

Rectangle, disk and cylinder lights draw their directions in this way. As in Ureña, Fajardo, King, "An Area-Preserving
Parametrization for Spherical Rectangles", 2013, a direction has two coordinates. One is the azimuth about an axis
parallel to two of the sides. The other is the sine of the elevation, which is drawn uniformly between its values at the
other two sides.

In that publication, the azimuth is exactly uniform over the solid angle, and is computed from a sum of four angles. In
float32, the sum has no correct digit at solid angles below about 1e-3 sr. Here the azimuth has a piecewise linear
density: its range is divided into `SEGMENTS` equal segments, and in the middle of each the density is proportional to
the range of the sine. The pdf of the result is exact; docs/notebook/spherical-rectangle.md has the variance of its
weights.

No formula subtracts nearly equal numbers. The formulas therefore hold in float32 at distances from 1e-6 to 1e6 times
the rectangle's size. Of the two possible axes, the azimuth is about the one for which its range is smaller. The
density of the azimuth is then smooth even near an edge and in the plane of the rectangle.

All functions keep the type of their arguments, so that tests can run them in float32.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lookdev.arrays import Bools, Floats
from lookdev.brdf.vectors import Array, Real
from lookdev.light.shape import FAR

SEGMENTS = 4
"""The default number of segments of the azimuth's density."""

_TINY = 1e-30  # replaces divisors of 0


class RectanglePoint(NamedTuple):
    """Points (...) of rectangles, each with its position along the rectangle's own axes in two forms.

    `s` and `t` are fractions of the width and the height. `x` and `y` are distances from the foot of the perpendicular
    from the shading point. Seen from nearby, `x` and `y` have more correct digits; seen from afar, `s` and `t`.
    """

    s: Floats
    t: Floats
    x: Floats
    y: Floats


class SphericalRectangle(NamedTuple):
    """Rectangles (...) as seen from the origin, with the densities from which directions are drawn.

    A rectangle is in the plane at `z` > 0, from `x0` to `x0 + width` and from `y0` to `y0 + height`. The azimuth is the
    angle about the y axis, from the z axis towards x. `swapped` is true where this x axis is the rectangle's own y.
    """

    x0: Floats
    width: Floats
    y0: Floats
    height: Floats
    z: Floats
    swapped: Bools
    azimuth_range: Floats
    """The angle (...) in radians between the azimuths of the sides x0 and x0 + width."""
    sine_ranges: tuple[Floats, ...]
    """The difference (...) of the sine of the elevation between the sides, at the middle of each azimuth segment."""
    mean_sine_range: Real
    """Mean of `sine_ranges`."""

    @property
    def solid_angle(self) -> Floats:
        """Its solid angle in steradians, accurate to a few percent."""
        return self.azimuth_range * self.mean_sine_range


def project_rectangle(
    x0: Floats, width: Floats, y0: Floats, height: Floats, z: Floats, segments: int = SEGMENTS
) -> SphericalRectangle:
    """Return the `SphericalRectangle` of rectangles (...) at z > 0, as seen from the origin."""
    along_x, along_y = _angle_between(x0, width, z), _angle_between(y0, height, z)
    swapped = along_y < along_x
    x0, width, y0, height, angle = (
        np.where(swapped, swapped_value, value)
        for value, swapped_value in ((x0, y0), (width, height), (y0, x0), (height, width), (along_x, along_y))
    )
    middles = (_point_at_angle(x0, width, z, angle, (step + 0.5) / segments)[1] for step in range(segments))
    sine_ranges = tuple(_sine_range(x * x + z * z, y0, height) for x in middles)
    mean_sine_range = sum(sine_ranges) / segments
    return SphericalRectangle(x0, width, y0, height, z, swapped, angle, sine_ranges, mean_sine_range)


def draw(rectangle: SphericalRectangle, u: Array) -> RectanglePoint:
    """Map points u (..., 2) of the unit square to points of the rectangles, with the pdf `density`."""
    segments = len(rectangle.sine_ranges)
    remaining = u[..., 0] * rectangle.mean_sine_range * segments
    # The azimuth's density is linear between the middles of neighbouring segments, and constant outside of them.
    fraction = np.zeros_like(remaining)
    for step in range(segments + 1):
        left, right = rectangle.sine_ranges[max(step - 1, 0)], rectangle.sine_ranges[min(step, segments - 1)]
        segment_width = 0.5 if step in (0, segments) else 1.0
        covered = np.clip(remaining, 0, (left + right) / 2 * segment_width)
        # Solves left t + (right - left) t^2 / 2 = covered for t, without cancellation.
        root = np.sqrt(np.maximum(left * left + 2 * (right - left) * covered, 0))
        fraction = fraction + np.clip(2 * covered / np.maximum(left + root, _TINY), 0, segment_width) / segments
        remaining = remaining - covered
    s, x = _point_at_angle(rectangle.x0, rectangle.width, rectangle.z, rectangle.azimuth_range, fraction)
    # Near the foot of the perpendicular from the origin, x0 + width s loses all digits; z tan(azimuth) does not.
    is_near_foot = x * x + rectangle.z * rectangle.z < rectangle.z * rectangle.width
    azimuth = np.arctan2(rectangle.x0, rectangle.z) + np.where(is_near_foot, fraction, 0) * rectangle.azimuth_range
    x = np.where(is_near_foot, rectangle.z * np.tan(azimuth), x)
    t, y = _point_at_sine(x * x + rectangle.z * rectangle.z, rectangle.y0, rectangle.height, u[..., 1])
    swapped = rectangle.swapped
    return RectanglePoint(
        np.where(swapped, t, s), np.where(swapped, s, t), np.where(swapped, y, x), np.where(swapped, x, y)
    )


def density(rectangle: SphericalRectangle, point: RectanglePoint) -> Floats:
    """Return the pdf (...) per steradian with which `draw` returns points of the rectangles."""
    s, x = np.where(rectangle.swapped, point.t, point.s), np.where(rectangle.swapped, point.y, point.x)
    azimuth = np.arctan2(rectangle.width * s * rectangle.z, rectangle.z * rectangle.z + rectangle.x0 * x)
    segments = len(rectangle.sine_ranges)
    position = np.clip(azimuth / np.maximum(rectangle.azimuth_range, _TINY) * segments - 0.5, 0, segments - 1)
    azimuth_density = sum(
        value * np.maximum(1 - np.abs(position - step), 0) for step, value in enumerate(rectangle.sine_ranges)
    )
    sine_range = _sine_range(rectangle.z * rectangle.z + x * x, rectangle.y0, rectangle.height)
    pdf: Floats = azimuth_density / np.maximum(rectangle.mean_sine_range * rectangle.azimuth_range * sine_range, _TINY)
    return pdf


def _angle_between(x0: Floats, width: Floats, z: Floats) -> Floats:
    """Return the angle between (x0, z) and (x0 + width, z)."""
    return np.arctan2(width * z, z * z + x0 * (x0 + width))


def _point_at_angle(x0: Floats, width: Floats, z: Floats, angle: Floats, fraction: Real) -> tuple[Floats, Floats]:
    """Return s and x of the point at a `fraction` of the `angle` from x0 to x0 + width; s is its fraction of the width.

    The formula is the law of sines in the two triangles between the origin, the point and one end.
    """
    last_x = x0 + width
    first = np.sqrt(x0 * x0 + z * z) * np.sin(fraction * angle)
    last = np.sqrt(last_x * last_x + z * z) * np.sin((1 - fraction) * angle)
    first, last = np.maximum(first, 0), np.maximum(last, 0)
    s = first / np.maximum(first + last, _TINY)
    return s, x0 + width * s


def _sine_range(squared: Floats, y0: Floats, height: Floats) -> Floats:
    """Return the range of the sine of the elevation, y1 / r1 - y0 / r0, with y1 = y0 + height.

    r0 and r1 are the distances of the two ends from the origin: r^2 = squared + y^2, where `squared` is x^2 + z^2.
    """
    y1 = y0 + height
    r0, r1 = np.sqrt(squared + y0 * y0), np.sqrt(squared + y1 * y1)
    spans_zero = y0 * y1 < 0
    weight = y1 * r0 + y0 * r1
    same_side_range = squared * (y0 + y1) * height / (r0 * r1 * np.where(spans_zero | (weight == 0), 1, weight))
    return np.where(spans_zero, y1 / r1 - y0 / r0, same_side_range)


def _point_at_sine(squared: Floats, y0: Floats, height: Floats, v: Array) -> tuple[Floats, Floats]:
    """Return t and y of the point at a fraction `v` of the range of the sine y / r; t is its fraction of the height.

    As in `_sine_range`, r^2 = squared + y^2, and y is from `y0` to `y0 + height`.
    """
    y1 = y0 + height
    spans_zero, is_below = y0 * y1 < 0, (y0 + y1 < 0)
    # A rectangle entirely at y < 0 is mirrored, so that the end `near` is the one closer to y = 0.
    v = np.where(is_below & ~spans_zero, 1 - v, v)
    near = np.where(spans_zero, y0, np.where(is_below, -y1, y0))
    far = near + height
    d, r0, r1 = np.sqrt(squared), np.sqrt(squared + near * near), np.sqrt(squared + far * far)
    sine = near / r0
    step = v * _sine_range(squared, near, height)
    reached = sine + step
    # With the sines s0 and s1 at the ends, 1 - reached^2 is a sum of (1 - v)^2 (1 - s0^2), v^2 (1 - s1^2), and
    # 2 v (1 - v) (1 - s0 s1). `mixed` is 1 - s0 s1, in the form that does not cancel.
    on_both_sides = 1 - near * far / (r0 * r1)
    on_one_side = (
        squared * (squared + near * near + far * far) / (r0 * r1 * (r0 * r1 + np.where(spans_zero, 0, near * far)))
    )
    mixed = np.where(spans_zero, on_both_sides, on_one_side)
    cosine = np.sqrt((1 - v) ** 2 * (squared / (r0 * r0)) + v**2 * (squared / (r1 * r1)) + 2 * v * (1 - v) * mixed)
    near_cosine = d / r0
    # `y_step` is d times the difference of the tangents, reached / cosine - sine / near_cosine, without cancellation.
    y_step = (
        d * step * (reached + sine) / np.maximum(cosine * near_cosine * (reached * near_cosine + sine * cosine), _TINY)
    )
    y = np.where(spans_zero, d * reached / np.maximum(cosine, _TINY), near + y_step)
    t = np.clip(np.where(spans_zero, y - near, y_step) / height, 0, 1)
    mirrored = is_below & ~spans_zero
    return np.where(mirrored, 1 - t, t), np.where(mirrored, -y, y)


# In the functions from here on, the rectangle is centred at the origin in the plane z = 0 and emits along -z, so that
# only points with z < 0 see it.


def intersect_rectangle(point: Floats, direction: Floats, width: Real, height: Real) -> tuple[Floats, RectanglePoint]:
    """Return the distance (...) along directions (..., 3) to the rectangle, and the point that the ray hits.

    For a miss and for a ray from behind, the distance is `FAR`, and the point's s and t are clipped to [0, 1].
    """
    x, y, z = np.moveaxis(point, -1, 0)
    wx, wy, wz = np.moveaxis(direction, -1, 0)
    in_front = (z < 0) & (wz > 0)
    distance = np.where(in_front, -z / np.where(in_front, wz, 1), 0)
    dx, dy = distance * wx, distance * wy
    s, t = (x + dx) / width + 0.5, (y + dy) / height + 0.5
    inside = in_front & (np.abs(s - 0.5) <= 0.5) & (np.abs(t - 0.5) <= 0.5)
    return np.where(inside, distance, FAR), RectanglePoint(np.clip(s, 0, 1), np.clip(t, 0, 1), dx, dy)


def project_part(
    point: Floats, width: Real, height: Real, s: Real = 0.0, t: Real = 0.0, size: Real = 1.0, segments: int = SEGMENTS
) -> SphericalRectangle:
    """Return a part of the rectangle as seen from points (..., 3): from fractions (s, t) to (s + size, t + size)."""
    x, y, z = np.moveaxis(point, -1, 0)
    x0, y0, ones = width * (s - 0.5) - x, height * (t - 0.5) - y, np.ones_like(x)
    return project_rectangle(x0, width * size * ones, y0, height * size * ones, np.where(z < 0, -z, ones), segments)


def approximate_solid_angle(point: Floats, width: Real, height: Real, area: Real) -> Floats:
    """Return an estimate (...) of the solid angle, at points (..., 3), of a light within the rectangle; 0 from behind.

    `area` is the area of the light. The formula uses the distance and the cosine at the rectangle's nearest point. It
    tends to 2 pi on the light, and to area cosine / distance^2 far from the light.
    """
    x, y, z = np.moveaxis(point, -1, 0)
    dx, dy = np.maximum(np.absolute(x) - width / 2, 0), np.maximum(np.absolute(y) - height / 2, 0)
    squared = dx * dx + dy * dy + z * z
    cosine = np.where(z < 0, -z, 0) / np.sqrt(np.maximum(squared, _TINY))
    angle: Floats = area * cosine / (squared + area / (2 * math.pi))
    return angle


def directions_to_points(point: Floats, target: RectanglePoint) -> Floats:
    """Return unit directions (..., 3) from points (..., 3) to points of the rectangle; +z for points behind it."""
    z = point[..., 2]
    towards = np.stack([target.x, target.y, np.where(z < 0, -z, 1)], axis=-1)
    towards = np.where(np.expand_dims(z < 0, -1), towards, np.stack([0 * z, 0 * z, 0 * z + 1], axis=-1))
    length: Floats = np.expand_dims(np.sqrt((towards * towards).sum(axis=-1)), -1)
    return towards / length
