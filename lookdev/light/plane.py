"""A rectangle about the origin in the plane z = 0 that emits along -z, as seen from points with z < 0."""

from __future__ import annotations

import math

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.vectors import Real
from lookdev.light.shape import FAR
from lookdev.light.spherical_rectangle import SEGMENTS, Point, SphericalRectangle, project_rectangle

_TINY = 1e-30


def meet_plane(point: Floats, direction: Floats, width: Real, height: Real) -> tuple[Floats, Point]:
    """Return the distance (...) along directions (..., 3) to the rectangle, and the point that the ray hits.

    The distance is `FAR` for misses and for rays from behind; the fractions s and t of these are clipped to [0, 1].
    """
    x, y, z = np.moveaxis(point, -1, 0)
    wx, wy, wz = np.moveaxis(direction, -1, 0)
    in_front = (z < 0) & (wz > 0)
    along = np.where(in_front, -z / np.where(in_front, wz, 1), 0)
    dx, dy = along * wx, along * wy
    s, t = (x + dx) / width + 0.5, (y + dy) / height + 0.5
    inside = in_front & (np.abs(s - 0.5) <= 0.5) & (np.abs(t - 0.5) <= 0.5)
    return np.where(inside, along, FAR), Point(np.clip(s, 0, 1), np.clip(t, 0, 1), dx, dy)


def seen_part(
    point: Floats, width: Real, height: Real, s: Real = 0.0, t: Real = 0.0, size: Real = 1.0, segments: int = SEGMENTS
) -> SphericalRectangle:
    """Return the part of the rectangle from fractions (s, t) to (s + size, t + size), as seen from points (..., 3)."""
    x, y, z = np.moveaxis(point, -1, 0)
    x0, y0, ones = width * (s - 0.5) - x, height * (t - 0.5) - y, np.ones_like(x)
    return project_rectangle(x0, width * size * ones, y0, height * size * ones, np.where(z < 0, -z, ones), segments)


def plane_angle(point: Floats, width: Real, height: Real, area: Real) -> Floats:
    """Return the rough solid angle (...) at points (..., 3) of a light of `area` in the rectangle; 0 from behind.

    The formula uses the distance and the cosine at the rectangle's nearest point. Its limits are 2 pi on the light, and
    area cosine / distance^2 from afar.
    """
    x, y, z = np.moveaxis(point, -1, 0)
    dx, dy = np.maximum(np.absolute(x) - width / 2, 0), np.maximum(np.absolute(y) - height / 2, 0)
    squared = dx * dx + dy * dy + z * z
    cosine = np.where(z < 0, -z, 0) / np.sqrt(np.maximum(squared, _TINY))
    angle: Floats = area * cosine / (squared + area / (2 * math.pi))
    return angle


def towards_plane(point: Floats, target: Point) -> Floats:
    """Return unit directions (..., 3) to points of the rectangle; +z at points that it does not illuminate."""
    z = point[..., 2]
    towards = np.stack([target.x, target.y, np.where(z < 0, -z, 1)], axis=-1)
    towards = np.where(np.expand_dims(z < 0, -1), towards, np.stack([0 * z, 0 * z, 0 * z + 1], axis=-1))
    length: Floats = np.expand_dims(np.sqrt((towards * towards).sum(axis=-1)), -1)
    return towards / length
