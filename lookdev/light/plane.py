"""A rectangle about the origin of the plane z = 0 that emits along -z, as places with z < 0 see it."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np

from lookdev.light.shape import FAR
from lookdev.light.spherical_rectangle import SEGMENTS, Point, SphericalRectangle, seen_rectangle

Floats: TypeAlias = Any
"""An array, or a symbolic one in its place."""

_TINY = 1e-30


def meet_plane(place: Floats, direction: Floats, width: Any, height: Any) -> tuple[Floats, Point]:
    """Return the distance (...) along directions (..., 3) to the rectangle, and where it is met.

    The distance is `FAR` where it is missed, or seen from behind; fractions there are clipped to [0, 1].
    """
    x, y, z = np.moveaxis(place, -1, 0)
    wx, wy, wz = np.moveaxis(direction, -1, 0)
    before = (z < 0) & (wz > 0)
    along = np.where(before, -z / np.where(before, wz, 1), 0)
    across, up = along * wx, along * wy
    s, t = (x + across) / width + 0.5, (y + up) / height + 0.5
    inside = before & (np.abs(s - 0.5) <= 0.5) & (np.abs(t - 0.5) <= 0.5)
    return np.where(inside, along, FAR), Point(np.clip(s, 0, 1), np.clip(t, 0, 1), across, up)


def seen_part(
    place: Floats, width: Any, height: Any, s: Any = 0.0, t: Any = 0.0, size: Any = 1.0, segments: int = SEGMENTS
) -> SphericalRectangle:
    """Return how places (..., 3) see the part of the rectangle from fractions s, t on, of `size` in both."""
    x, y, z = np.moveaxis(place, -1, 0)
    x0, y0, one = width * (s - 0.5) - x, height * (t - 0.5) - y, np.ones_like(x)
    return seen_rectangle(x0, width * size * one, y0, height * size * one, np.where(z < 0, -z, one), segments)


def plane_angle(place: Floats, width: Any, height: Any, area: Any) -> Floats:
    """Return steradians (...) at which places (..., 3) see a light of an area in the rectangle, roughly; 0 from behind.

    By the distance and the cosine at the rectangle's nearest point: 2 pi on it, area cosine / distance^2 from afar.
    """
    x, y, z = np.moveaxis(place, -1, 0)
    across, up = np.maximum(np.absolute(x) - width / 2, 0), np.maximum(np.absolute(y) - height / 2, 0)
    squared = across * across + up * up + z * z
    cosine = np.where(z < 0, -z, 0) / np.sqrt(np.maximum(squared, _TINY))
    return area * cosine / (squared + area / (2 * math.pi))


def towards_plane(place: Floats, point: Point) -> Floats:
    """Return unit directions (..., 3) to points of the rectangle; along +z from places that it does not light."""
    z = place[..., 2]
    towards = np.stack([point.x, point.y, np.where(z < 0, -z, 1)], axis=-1)
    towards = np.where(np.expand_dims(z < 0, -1), towards, np.stack([0 * z, 0 * z, 0 * z + 1], axis=-1))
    return towards / np.expand_dims(np.sqrt((towards * towards).sum(axis=-1)), -1)
