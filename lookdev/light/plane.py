"""A rectangle about the origin of the plane z = 0 that emits along -z, as places with z < 0 see it.

Points of the rectangle are fractions of its width and height, from (-x, -y) to (+x, +y).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.light.spherical_rectangle import SEGMENTS, SphericalRectangle, seen_rectangle

Floats = NDArray[Any]


def meet_plane(place: Floats, direction: Floats, width: Any, height: Any) -> tuple[Floats, Floats, Floats]:
    """Return the distance (...) along directions (..., 3) to the rectangle, and the fractions where it is met.

    The distance is inf where it is missed, or seen from behind; fractions there are clipped to [0, 1].
    """
    x, y, z = np.moveaxis(place, -1, 0)
    wx, wy, wz = np.moveaxis(direction, -1, 0)
    before = (z < 0) & (wz > 0)
    distance = np.where(before, -z / np.where(before, wz, 1), np.inf)
    along = np.where(before, distance, 0)
    s, t = (x + along * wx) / width + 0.5, (y + along * wy) / height + 0.5
    inside = before & (np.abs(s - 0.5) <= 0.5) & (np.abs(t - 0.5) <= 0.5)
    return np.where(inside, distance, np.inf), np.clip(s, 0, 1), np.clip(t, 0, 1)


def seen_part(
    place: Floats, width: Any, height: Any, s: Any = 0.0, t: Any = 0.0, size: Any = 1.0, segments: int = SEGMENTS
) -> SphericalRectangle:
    """Return how places (..., 3) see the part of the rectangle from fractions s, t on, of `size` in both."""
    x, y, z = np.moveaxis(place, -1, 0)
    x0, y0, one = width * (s - 0.5) - x, height * (t - 0.5) - y, np.ones_like(x)
    return seen_rectangle(x0, width * size * one, y0, height * size * one, np.where(z < 0, -z, one), segments)


def towards_plane(place: Floats, width: Any, height: Any, s: Floats, t: Floats) -> Floats:
    """Return unit directions (..., 3) to points of the rectangle; along +z from places that it does not light."""
    x, y, z = np.moveaxis(place, -1, 0)
    before = z < 0
    towards = np.stack([width * (s - 0.5) - x, height * (t - 0.5) - y, np.where(before, -z, 1)], axis=-1)
    towards = np.where(before[..., None], towards, np.array((0, 0, 1), towards.dtype))
    return np.asarray(towards / np.sqrt((towards * towards).sum(axis=-1, keepdims=True)))
