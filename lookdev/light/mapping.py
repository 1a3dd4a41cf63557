"""The mapping between directions and the coordinates (u, v) of a lat-long image, by Blender's convention.

World space has z up. ``u`` grows clockwise seen from above and is periodic. ``v`` grows upward, from 0 at the nadir to
1 at the zenith: the top edge of an image, above its row 0, is at ``v = 1``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats


def direction_to_uv(direction: ArrayLike) -> Floats:
    """Map directions (..., 3), of any length but 0, to (u, v), an array (..., 2); at the poles u is 0, 0.5 or 1."""
    x, y, z = np.moveaxis(np.asarray(direction, dtype=np.float64), -1, 0)
    u = 0.5 - np.arctan2(y, x) / (2.0 * np.pi)
    v = 0.5 + np.arctan2(z, np.hypot(x, y)) / np.pi
    return np.stack([u, v], axis=-1)


def uv_to_direction(uv: ArrayLike) -> Floats:
    """Map coordinates (u, v), an array (..., 2) with u of any value, to unit directions (..., 3)."""
    u, v = np.moveaxis(np.asarray(uv, dtype=np.float64), -1, 0)
    azimuth = np.pi * (1.0 - 2.0 * u)
    # The cosine of the latitude. Computed from the distance to the nearer pole, it is exactly 0 at both poles.
    horizontal = np.sin(np.pi * np.minimum(v, 1.0 - v))
    return np.stack([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), -np.cos(np.pi * v)], axis=-1)


def rotate_z(direction: ArrayLike, degrees: ArrayLike) -> Floats:
    """Rotate directions (..., 3) about world z, counter-clockwise seen from above, by `degrees` (...)."""
    x, y, z = np.moveaxis(np.asarray(direction, dtype=np.float64), -1, 0)
    angle = np.radians(np.asarray(degrees, dtype=np.float64))
    cosine, sine = np.cos(angle), np.sin(angle)
    turned = np.broadcast_arrays(cosine * x - sine * y, sine * x + cosine * y, z)
    return np.stack(turned, axis=-1)
