"""Synthetic measurements of a known BSDF: the value at the centre of each cell of a file's grid."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.angles import half_difference, spherical_direction
from lookdev.brdf.disney import DISNEY
from lookdev.brdf.lobes import Bsdf
from lookdev.brdf.measured.files import MERL_SIZE, write_anisotropic, write_merl
from lookdev.brdf.measured.grids import HALF_PI, IsotropicGrid
from lookdev.brdf.mixture import evaluate
from lookdev.brdf.parameters import ParameterValue
from lookdev.brdf.vectors import normalize

ANISOTROPIC_SIZE = (16, 16, 36, 36)
"""Size of synthetic data of Ngan et al., coarser than their measurements of 45 x 45 x 180 x 90."""

_PLASTIC: dict[str, ParameterValue] = {"baseColor": (0.5, 0.2, 0.1), "roughness": 0.35}
_BLOCK = 1 << 18


@cache
def plastic_grid() -> IsotropicGrid:
    """Return the built-in measurement: a coarse grid of red plastic of Disney's model."""
    return IsotropicGrid(isotropic_samples(DISNEY.bsdf(DISNEY.complete(_PLASTIC)), (32, 32, 24)))


def isotropic_samples(bsdf: Bsdf, size: tuple[int, int, int] = MERL_SIZE) -> Floats:
    """Return f (*size, 3) at the centres of theta_h, theta_d and phi_d; 0 where a direction is below the horizon.

    phi_d is the azimuth of the light. As f is reciprocal, its value at the azimuth of the view is the same.
    """
    centres = [(np.arange(count) + 0.5) / count for count in size]
    h, d, phi = np.meshgrid(centres[0] ** 2 * HALF_PI, centres[1] * HALF_PI, centres[2] * np.pi, indexing="ij")
    return _evaluate_in_blocks(bsdf, *half_difference(h, d, phi))


def anisotropic_samples(
    bsdf: Bsdf, size: tuple[int, int, int, int] = ANISOTROPIC_SIZE, *, half: bool = False
) -> Floats:
    """Return f (*size, 3) at the centres of theta_i, theta_o, phi_d and phi_i."""
    centres = [(np.arange(count) + 0.5) / count for count in size]
    phi_range = np.pi if half else 2.0 * np.pi
    theta_i, theta_o, phi_d, phi_i = np.meshgrid(
        centres[0] * HALF_PI, centres[1] * HALF_PI, centres[2] * phi_range, centres[3] * 2.0 * np.pi, indexing="ij"
    )
    return _evaluate_in_blocks(bsdf, spherical_direction(theta_o, phi_i + phi_d), spherical_direction(theta_i, phi_i))


def write_synthetic(file: Path, bsdf: Bsdf) -> None:
    """Write a measurement of a BSDF: anisotropic data of Ngan et al. for the suffix ``.dat``, else a MERL binary."""
    if file.suffix == ".dat":
        write_anisotropic(file, anisotropic_samples(bsdf))
    else:
        write_merl(file, isotropic_samples(bsdf))


def _evaluate_in_blocks(bsdf: Bsdf, wo: Floats, wi: Floats) -> Floats:
    o, i = wo.reshape(-1, 3), wi.reshape(-1, 3)
    blocks = [slice(first, first + _BLOCK) for first in range(0, len(o), _BLOCK)]
    values = [evaluate(bsdf, np.asarray(normalize(o[block])), np.asarray(normalize(i[block]))) for block in blocks]
    return np.concatenate(values).reshape(wo.shape)
