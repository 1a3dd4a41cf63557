"""Synthetic measurements of a known BSDF: the value at the centre of each cell of a file's grid."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.brdf.disney import DISNEY
from lookdev.brdf.lobes import Bsdf
from lookdev.brdf.measured.files import MERL_SIZE, write_anisotropic, write_merl
from lookdev.brdf.measured.grids import HALF_PI, Floats, Isotropic
from lookdev.brdf.mixture import evaluate
from lookdev.brdf.vectors import normalize

ANISOTROPIC_SIZE = (16, 16, 36, 36)
"""Of the data of Ngan et al.: coarser than their measurements, 45 x 45 x 180 x 90."""

_PLASTIC: dict[str, Any] = {"baseColor": (0.5, 0.2, 0.1), "roughness": 0.35}
_BLOCK = 1 << 18


@cache
def plastic() -> Isotropic:
    """Return the measurement that is built in: a coarse one of red plastic, Disney's model."""
    return Isotropic(isotropic_samples(DISNEY.bsdf(DISNEY.complete(_PLASTIC)), (32, 32, 24)))


def isotropic_samples(bsdf: Bsdf, size: tuple[int, int, int] = MERL_SIZE) -> Floats:
    """Return f (*size, 3) at the centres of theta_h, theta_d and phi_d; 0 where a direction is below the horizon.

    phi_d is that of the light: as f is reciprocal, that of the view has the same value.
    """
    centres = [(np.arange(count) + 0.5) / count for count in size]
    h, d, phi = np.meshgrid(centres[0] ** 2 * HALF_PI, centres[1] * HALF_PI, centres[2] * np.pi, indexing="ij")
    along, across, up = np.sin(d) * np.cos(phi), np.sin(d) * np.sin(phi), np.cos(d)

    def about_half(sign: float) -> Floats:
        # The difference vector, turned from the zenith to the half vector.
        x = sign * along * np.cos(h) + up * np.sin(h)
        return np.stack([x, sign * across, up * np.cos(h) - sign * along * np.sin(h)], axis=-1)

    return _values(bsdf, about_half(-1.0), about_half(1.0))


def anisotropic_samples(
    bsdf: Bsdf, size: tuple[int, int, int, int] = ANISOTROPIC_SIZE, *, half: bool = False
) -> Floats:
    """Return f (*size, 3) at the centres of theta_i, theta_o, phi_d and phi_i."""
    centres = [(np.arange(count) + 0.5) / count for count in size]
    turn = np.pi if half else 2.0 * np.pi
    theta_i, theta_o, turned, phi_i = np.meshgrid(
        centres[0] * HALF_PI, centres[1] * HALF_PI, centres[2] * turn, centres[3] * 2.0 * np.pi, indexing="ij"
    )
    wo, wi = (
        np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
        for theta, phi in ((theta_o, phi_i + turned), (theta_i, phi_i))
    )
    return _values(bsdf, wo, wi)


def write_synthetic(file: Path, bsdf: Bsdf) -> None:
    """Write a measurement of a BSDF: anisotropic data of Ngan et al. for the suffix ``.dat``, else a MERL binary."""
    if file.suffix == ".dat":
        write_anisotropic(file, anisotropic_samples(bsdf))
    else:
        write_merl(file, isotropic_samples(bsdf))


def _values(bsdf: Bsdf, wo: Floats, wi: Floats) -> Floats:
    o, i = wo.reshape(-1, 3), wi.reshape(-1, 3)
    blocks = [slice(first, first + _BLOCK) for first in range(0, len(o), _BLOCK)]
    found = [evaluate(bsdf, np.asarray(normalize(o[block])), np.asarray(normalize(i[block]))) for block in blocks]
    return np.concatenate(found).reshape(wo.shape)
