"""Directions in the shading frame from angles in radians."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats


def spherical_direction(theta: ArrayLike, phi: ArrayLike = 0.0) -> Floats:
    """Return the unit directions (..., 3) at the angle `theta` from the normal and the azimuth `phi`."""
    theta, phi = np.broadcast_arrays(np.asarray(theta, np.float64), np.asarray(phi, np.float64))
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def direction_at_cosine(cosine: Floats, phi: Floats) -> Floats:
    """Return unit directions (..., 3) from their cosine to the normal (...), at least 0, and their azimuth (...)."""
    sine = np.sqrt(1.0 - cosine * cosine)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=-1)


# Rusinkiewicz 1998, with phi_h = 0.
def half_difference(theta_h: ArrayLike, theta_d: ArrayLike, phi_d: ArrayLike) -> tuple[Floats, Floats]:
    """Return `wo` and `wi`, (..., 3), with these half and difference angles; some are below the horizon."""
    h, d, phi = np.broadcast_arrays(*(np.asarray(angle, np.float64) for angle in (theta_h, theta_d, phi_d)))
    x, y, z = np.sin(d) * np.cos(phi), np.sin(d) * np.sin(phi), np.cos(d)

    def direction(sign: float) -> Floats:
        return np.stack([sign * x * np.cos(h) + z * np.sin(h), sign * y, z * np.cos(h) - sign * x * np.sin(h)], axis=-1)

    return direction(-1.0), direction(1.0)
