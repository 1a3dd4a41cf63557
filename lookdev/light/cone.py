"""Cones of directions: sampling, pdf, and frames about their axes. All functions keep the type of their arguments."""

from __future__ import annotations

import math

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.vectors import Real


def uniform_density(versine: Real) -> Real:
    """Return the pdf (...) per steradian of `draw_uniform`; `versine` is 1 - cos of the cone's half angle."""
    return 1 / (2 * math.pi * versine)


def draw_uniform(versine: Real, u: Floats) -> Floats:
    """Map points u (..., 2) of the unit square to directions (..., 3), uniform in cones about z."""
    versine_drawn = u[..., 0] * versine
    sine, angle = np.sqrt(versine_drawn * (2 - versine_drawn)), 2 * math.pi * u[..., 1]
    return np.stack([sine * np.cos(angle), sine * np.sin(angle), 1 - versine_drawn], axis=-1)


def orient_to_axis(axis: Floats, local: Floats) -> Floats:
    """Transform vectors `local` (..., 3) from frames about the unit vectors `axis` (..., 3), their z, to the world.

    Duff et al., "Building an Orthonormal Basis, Revisited", 2017.
    """
    x, y, z = np.moveaxis(axis, -1, 0)
    sign = np.where(z < 0, -np.ones_like(z), np.ones_like(z))
    a = -1 / (sign + z)
    b = x * y * a
    tangent = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    bitangent = np.stack([b, sign + y * y * a, -y], axis=-1)
    world: Floats = local[..., :1] * tangent + local[..., 1:2] * bitangent + local[..., 2:] * axis
    return world
