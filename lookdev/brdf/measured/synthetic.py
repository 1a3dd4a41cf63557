"""Make synthetic measurements: the values of a known BSDF at the centres of the cells of a grid."""

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
"""The numbers of theta_i, theta_o, phi_d and phi_i of synthetic anisotropic data.

The grid is coarser than that of Ngan et al., who measured 45 x 45 x 180 x 90 samples.
"""

_PLASTIC: dict[str, ParameterValue] = {"baseColor": (0.5, 0.2, 0.1), "roughness": 0.35}
_BLOCK = 1 << 18  # the number of direction pairs that are evaluated at once


@cache
def plastic_grid() -> IsotropicGrid:
    """Return a measurement on a coarse grid of a red plastic, which is a material of Disney's model."""
    return IsotropicGrid(isotropic_samples(DISNEY.bsdf(DISNEY.complete(_PLASTIC)), (32, 32, 24)))


def isotropic_samples(bsdf: Bsdf, size: tuple[int, int, int] = MERL_SIZE) -> Floats:
    """Return f (*size, 3) at the centres of the cells of theta_h, theta_d and phi_d (`IsotropicGrid`).

    f is 0 where a direction is below the horizon. phi_d is the azimuth of the light. As f is reciprocal, its value at
    the azimuth of the view is the same.
    """
    centres = [(np.arange(count) + 0.5) / count for count in size]
    h, d, phi = np.meshgrid(centres[0] ** 2 * HALF_PI, centres[1] * HALF_PI, centres[2] * np.pi, indexing="ij")
    return _evaluate_in_blocks(bsdf, *half_difference(h, d, phi))


def anisotropic_samples(
    bsdf: Bsdf, size: tuple[int, int, int, int] = ANISOTROPIC_SIZE, *, half: bool = False
) -> Floats:
    """Return f (*size, 3) at the centres of the cells of theta_i, theta_o, phi_d and phi_i (`AnisotropicGrid`).

    With `half`, phi_d covers only [0, pi].
    """
    centres = [(np.arange(count) + 0.5) / count for count in size]
    phi_range = np.pi if half else 2.0 * np.pi
    theta_i, theta_o, phi_d, phi_i = np.meshgrid(
        centres[0] * HALF_PI, centres[1] * HALF_PI, centres[2] * phi_range, centres[3] * 2.0 * np.pi, indexing="ij"
    )
    return _evaluate_in_blocks(bsdf, spherical_direction(theta_o, phi_i + phi_d), spherical_direction(theta_i, phi_i))


def write_synthetic(file: Path, bsdf: Bsdf) -> None:
    """Write a measurement of a BSDF: in the format of Ngan et al. if the suffix is ``.dat``, else as a MERL binary."""
    if file.suffix == ".dat":
        write_anisotropic(file, anisotropic_samples(bsdf))
    else:
        write_merl(file, isotropic_samples(bsdf))


def _evaluate_in_blocks(bsdf: Bsdf, wo: Floats, wi: Floats) -> Floats:
    """Return f (..., 3) for directions (..., 3); blocks limit the memory that is needed."""
    o, i = wo.reshape(-1, 3), wi.reshape(-1, 3)
    blocks = [slice(first, first + _BLOCK) for first in range(0, len(o), _BLOCK)]
    values = [evaluate(bsdf, np.asarray(normalize(o[block])), np.asarray(normalize(i[block]))) for block in blocks]
    return np.concatenate(values).reshape(wo.shape)
