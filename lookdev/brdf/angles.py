"""Convert angles to unit directions in the shading frame, for plots, grids and quadrature; angles are in radians."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats


def spherical_direction(theta: ArrayLike, phi: ArrayLike = 0.0) -> Floats:
    """Return the unit directions (..., 3) with the angles `theta` (...) to the normal and the azimuths `phi` (...)."""
    theta, phi = np.broadcast_arrays(np.asarray(theta, np.float64), np.asarray(phi, np.float64))
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def direction_at_cosine(cosine: Floats, phi: Floats) -> Floats:
    """Return unit directions (..., 3) from their cosine to the normal (...), at least 0, and their azimuth (...)."""
    sine = np.sqrt(1.0 - cosine * cosine)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=-1)


# Rusinkiewicz, S. 1998. A New Change of Variables for Efficient BRDF Representation. EGWR. phi_h is 0.
def half_difference(theta_h: ArrayLike, theta_d: ArrayLike, phi_d: ArrayLike) -> tuple[Floats, Floats]:
    """Return the directions to viewer and light, (..., 3), with given half and difference angles (...).

    `theta_h` is the angle of the half vector to the normal. `theta_d` and `phi_d` are the angle and the azimuth of the
    light's direction about the half vector. Some of the directions are below the horizon.
    """
    h, d, phi = np.broadcast_arrays(*(np.asarray(angle, np.float64) for angle in (theta_h, theta_d, phi_d)))
    x, y, z = np.sin(d) * np.cos(phi), np.sin(d) * np.sin(phi), np.cos(d)

    def direction(sign: float) -> Floats:
        """Return the direction to the light for sign 1, and to the viewer for sign -1."""
        return np.stack([sign * x * np.cos(h) + z * np.sin(h), sign * y, z * np.cos(h) - sign * x * np.sin(h)], axis=-1)

    return direction(-1.0), direction(1.0)
