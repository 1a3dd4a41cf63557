"""Directions to a rectangle, nearly uniform over its solid angle, with an exact pdf.

As in Ureña, Fajardo, King, "An Area-Preserving Parametrization for Spherical Rectangles", 2013, a direction is an
azimuth about an axis parallel to two of the sides, then the sine of its elevation, which is uniform between those of
the two sides. Their exact azimuth inverts a sum of four angles, of which float32 leaves nothing at solid angles below
1e-3 sr or so. Here the azimuth has a density that is linear between the middles of `SEGMENTS` equal segments, where it
is the range of the sine; the pdf of the result is exact. The weight of a sample, 1 over pdf and solid angle, is 1 with
a standard deviation of 0.05 in most places and 0.14 in the worst ones tried, and at most 1.2.

Nothing is computed as a difference of nearly equal numbers, so the same formulas serve, in float32, from 1e-6 of a
rectangle's size above it to 1e6 sizes away. The azimuth is about the axis for which its range is smaller: this keeps
its density smooth near an edge and in the plane of the rectangle.

All functions keep the type of their arguments, so that float32 can be tried.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np

Floats: TypeAlias = Any
"""An array, or a symbolic one in its place."""

SEGMENTS = 4
"""Of the density of the azimuth."""

_TINY = 1e-30


class Point(NamedTuple):
    """Points (...) of rectangles, in the rectangle's own axes: `x` and `y` from the foot of the place that sees it, and
    the same as fractions `s` and `t` of width and height. From close x and y have more digits, from afar s and t.
    """

    s: Floats
    t: Floats
    x: Floats
    y: Floats


class SphericalRectangle(NamedTuple):
    """Rectangles (...) seen from the origin; x is along the sides whose ends bound the azimuth.

    x from `x0` to `x0 + width`, y from `y0` to `y0 + height`, at `z` > 0. `swapped` where x is the rectangle's own y.
    """

    x0: Floats
    width: Floats
    y0: Floats
    height: Floats
    z: Floats
    swapped: Floats
    angle: Floats
    """Range of the azimuth."""
    density: tuple[Floats, ...]
    """Ranges (...) of the sine of the elevation, amid equal segments of the azimuth."""
    mass: Floats
    """Mean of `density`."""

    @property
    def solid_angle(self) -> Floats:
        """Steradians, to some percent."""
        return self.angle * self.mass


def seen_rectangle(
    x0: Floats, width: Floats, y0: Floats, height: Floats, z: Floats, segments: int = SEGMENTS
) -> SphericalRectangle:
    """Return how rectangles (...) are seen that lie in front of the origin, at z > 0."""
    along_x, along_y = _angle(x0, width, z), _angle(y0, height, z)
    swapped = along_y < along_x
    x0, width, y0, height, angle = (
        np.where(swapped, other, one)
        for one, other in ((x0, y0), (width, height), (y0, x0), (height, width), (along_x, along_y))
    )
    middles = (_x(x0, width, z, angle, (step + 0.5) / segments)[1] for step in range(segments))
    density = tuple(_sine_range(x * x + z * z, y0, height) for x in middles)
    mass = sum(density) / segments
    return SphericalRectangle(x0, width, y0, height, z, swapped, angle, density, mass)


def draw(seen: SphericalRectangle, u: Floats) -> Point:
    """Map points u (..., 2) of the unit square to points of the rectangles."""
    segments = len(seen.density)
    wanted = u[..., 0] * seen.mass * segments
    fraction = np.zeros_like(wanted)
    for step in range(segments + 1):
        left, right = seen.density[max(step - 1, 0)], seen.density[min(step, segments - 1)]
        part = 0.5 if step in (0, segments) else 1.0
        inside = np.clip(wanted, 0, (left + right) / 2 * part)
        # The root without cancellation of left t + (right - left) t^2 / 2 = inside.
        root = np.sqrt(np.maximum(left * left + 2 * (right - left) * inside, 0))
        fraction = fraction + np.clip(2 * inside / np.maximum(left + root, _TINY), 0, part) / segments
        wanted = wanted - inside
    s, x = _x(seen.x0, seen.width, seen.z, seen.angle, fraction)
    # Near the foot the difference of x0 and width s has no digits, the tangent has.
    near = x * x + seen.z * seen.z < seen.z * seen.width
    x = np.where(near, seen.z * np.tan(np.arctan2(seen.x0, seen.z) + np.where(near, fraction, 0) * seen.angle), x)
    t, y = _y(x * x + seen.z * seen.z, seen.y0, seen.height, u[..., 1])
    swapped = seen.swapped
    return Point(np.where(swapped, t, s), np.where(swapped, s, t), np.where(swapped, y, x), np.where(swapped, x, y))


def density(seen: SphericalRectangle, point: Point) -> Floats:
    """Return the pdf (...) per steradian with which `draw` gives points, which lie in the rectangles."""
    s, x = np.where(seen.swapped, point.t, point.s), np.where(seen.swapped, point.y, point.x)
    azimuth = np.arctan2(seen.width * s * seen.z, seen.z * seen.z + seen.x0 * x)
    segments = len(seen.density)
    place = np.clip(azimuth / np.maximum(seen.angle, _TINY) * segments - 0.5, 0, segments - 1)
    drawn = sum(value * np.maximum(1 - np.abs(place - step), 0) for step, value in enumerate(seen.density))
    across = _sine_range(seen.z * seen.z + x * x, seen.y0, seen.height)
    return drawn / np.maximum(seen.mass * seen.angle * across, _TINY)


def _angle(x0: Floats, width: Floats, z: Floats) -> Floats:
    """Return the angle between (x0, z) and (x0 + width, z)."""
    return np.arctan2(width * z, z * z + x0 * (x0 + width))


def _x(x0: Floats, width: Floats, z: Floats, angle: Floats, fraction: Floats | float) -> tuple[Floats, Floats]:
    """Return where, as a fraction of the width, a part of the angle is passed, and x there.

    By the law of sines in the triangles that the place makes with the two ends.
    """
    last_x = x0 + width
    first = np.sqrt(x0 * x0 + z * z) * np.sin(fraction * angle)
    last = np.sqrt(last_x * last_x + z * z) * np.sin((1 - fraction) * angle)
    first, last = np.maximum(first, 0), np.maximum(last, 0)
    s = first / np.maximum(first + last, _TINY)
    return s, x0 + width * s


def _sine_range(squared: Floats, y0: Floats, height: Floats) -> Floats:
    """Return y1 / r1 - y0 / r0, y1 = y0 + height, where r^2 = squared + y^2."""
    y1 = y0 + height
    r0, r1 = np.sqrt(squared + y0 * y0), np.sqrt(squared + y1 * y1)
    apart = y0 * y1 < 0
    weight = y1 * r0 + y0 * r1
    beside = squared * (y0 + y1) * height / (r0 * r1 * np.where(apart | (weight == 0), 1, weight))
    return np.where(apart, y1 / r1 - y0 / r0, beside)


def _y(squared: Floats, y0: Floats, height: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Return where, as a fraction of the height, the sine is at the part v of its range, and y there."""
    y1 = y0 + height
    apart, below = y0 * y1 < 0, (y0 + y1 < 0)
    v = np.where(below & ~apart, 1 - v, v)
    near = np.where(apart, y0, np.where(below, -y1, y0))
    far = near + height
    d, r0, r1 = np.sqrt(squared), np.sqrt(squared + near * near), np.sqrt(squared + far * far)
    sine = near / r0
    step = v * _sine_range(squared, near, height)
    reached = sine + step
    # 1 - sine^2 at the ends and at v, without the difference where the sine is near 1.
    mixed = np.where(
        apart,
        1 - near * far / (r0 * r1),
        squared * (squared + near * near + far * far) / (r0 * r1 * (r0 * r1 + np.where(apart, 0, near * far))),
    )
    cosine = np.sqrt((1 - v) ** 2 * (squared / (r0 * r0)) + v**2 * (squared / (r1 * r1)) + 2 * v * (1 - v) * mixed)
    first = d / r0
    beyond = d * step * (reached + sine) / np.maximum(cosine * first * (reached * first + sine * cosine), _TINY)
    y = np.where(apart, d * reached / np.maximum(cosine, _TINY), near + beyond)
    t = np.clip(np.where(apart, y - near, beyond) / height, 0, 1)
    mirrored = below & ~apart
    return np.where(mirrored, 1 - t, t), np.where(mirrored, -y, y)
