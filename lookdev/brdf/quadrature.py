"""Quadrature over the hemisphere of light directions, for directional albedos and fits.

One grid is for lobes that peak at half vectors near the normal, another for smooth lobes.
"""

from __future__ import annotations

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.angles import direction_at_cosine


def half_vector_grid(view: Floats, alpha: float, cells: tuple[int, int]) -> tuple[Floats, Floats]:
    """Return directions to the light (n, 3) above the horizon, and their quadrature weights (n,) in steradians.

    The directions are mirror images of `view` (3,), a unit direction above the horizon, about a grid of half vectors.
    `cells` are the numbers of cells along the slope and the azimuth of the half vector. A cell has two by two
    Gauss nodes.

    With ``t = tan^2 theta_h`` and ``t0 = alpha^2 / 4``, cells along the slope have equal steps of ``log(1 + t / t0)``.
    These are nearly equal steps of t within a lobe of width `alpha`, and logarithmic steps beyond. The grid ends at
    ``tan theta_h = 2 / view_z``. Half vectors beyond this end give no direction above the horizon.
    """
    t0 = (0.5 * alpha) ** 2
    nodes, weights = np.polynomial.legendre.leggauss(2)  # type: ignore[no-untyped-call]
    slope_fraction, azimuth_fraction = (((np.arange(n)[:, None] + 0.5 * (nodes + 1.0)) / n).ravel() for n in cells)
    weight = np.outer(*(np.tile(0.5 * weights, n) / n for n in cells))
    log_range = np.log1p((2.0 / view[2]) ** 2 / t0)
    growth = np.exp(slope_fraction * log_range)
    t = t0 * (growth - 1.0)
    # The solid angle of half vectors: d omega_h = sin theta_h d theta_h d phi = dt d phi / (2 (1 + t)^(3/2)).
    weight *= (np.pi * t0 * log_range * growth / (1.0 + t) ** 1.5)[:, None]
    cos_h, azimuth = 1.0 / np.sqrt(1.0 + t), 2.0 * np.pi * azimuth_fraction
    sin_h = np.sqrt(t) * cos_h
    x, y = np.outer(sin_h, np.cos(azimuth)), np.outer(sin_h, np.sin(azimuth))
    wm = np.stack([x, y, np.broadcast_to(cos_h[:, None], x.shape)], axis=-1)
    cos_d = wm @ view
    wi = 2.0 * cos_d[..., None] * wm - view
    # The solid angle of directions to the light: d omega_i = 4 (wi . wm) d omega_h (Walter et al. 2007, eq. 14).
    weight = weight * 4.0 * cos_d
    above = (wi[..., 2] > 0.0) & (cos_d > 0.0)
    return wi[above], weight[above]


def hemisphere_grid(node_count: int) -> tuple[Floats, Floats]:
    """Return directions (n, 3) and quadrature weights (n,) in steradians for smooth functions on the hemisphere.

    The grid has `node_count` nodes along the cosine, and as many along the azimuth.
    """
    x, w = np.polynomial.legendre.leggauss(node_count)  # type: ignore[no-untyped-call]
    cos = 0.5 * (x + 1.0)
    # For a periodic function, such as one of the azimuth, the midpoint rule converges as fast as Gauss's.
    azimuth = 2.0 * np.pi * (np.arange(node_count) + 0.5) / node_count
    directions = direction_at_cosine(*np.meshgrid(cos, azimuth, indexing="ij")).reshape(-1, 3)
    return directions, np.repeat(w * np.pi / node_count, node_count)
