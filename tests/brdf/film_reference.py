"""Fresnel's equations by complex amplitudes, and the reflectance of a thin film by quadrature over wavelengths."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from lookdev.arrays import Floats
from lookdev.brdf import conductor

WAVELENGTHS = np.arange(380.0, 780.01, 0.5)


def complex_fresnel(cosine: NDArray, index: NDArray) -> Floats:
    """Return the reflectance in air for unpolarised light and a complex index: Born and Wolf, 1.5 (20) and 14.2."""
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
    s, p = (cosine - index * inside) / (cosine + index * inside), (inside - index * cosine) / (inside + index * cosine)
    return 0.5 * (np.abs(s) ** 2 + np.abs(p) ** 2)


def color_weights() -> Floats:
    """Return the weights (3, n) of `WAVELENGTHS` in linear Rec.709 under D65; white is exactly 1."""
    daylight = np.interp(WAVELENGTHS, conductor._WAVELENGTHS, conductor._D65)
    observer = CubicSpline(conductor._WAVELENGTHS, conductor._OBSERVER, axis=1)(WAVELENGTHS)
    weights = conductor._XYZ_TO_REC709 @ (observer * daylight)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def metal_film_by_quadrature(eta: Floats, k: Floats, cos_theta: Floats, thickness: Floats, ior: Floats) -> Floats:
    """Return the exact value of `lookdev.brdf.film.metal_film_reflectance`, for indices (n, 3) and numbers (n,).

    Indices (n, 1, `WAVELENGTHS`) are those of spectra.
    """
    index = np.asarray(eta) + 1j * np.asarray(k)
    cos_theta, thickness, ior = (values[:, None, None] for values in (cos_theta, thickness, ior))
    spectra = index if index.shape[-1] == len(WAVELENGTHS) else index[..., None]
    sin2 = 1.0 - cos_theta**2
    inside, beneath = np.sqrt(1.0 - sin2 / ior**2), np.sqrt(1.0 - sin2 / spectra**2)
    phase = np.exp(4.0j * np.pi * ior * inside * thickness / WAVELENGTHS)
    reflectance = np.zeros(1)
    # Born and Wolf, 1.5 (20) and (21), at both faces, s and p; 1.6 (55) and (56).
    for r12, r23 in (
        (
            (cos_theta - ior * inside) / (cos_theta + ior * inside),
            (ior * inside - spectra * beneath) / (ior * inside + spectra * beneath),
        ),
        (
            (inside - ior * cos_theta) / (inside + ior * cos_theta),
            (ior * beneath - spectra * inside) / (ior * beneath + spectra * inside),
        ),
    ):
        wave = r23 * phase
        reflectance = reflectance + 0.5 * np.abs((r12 + wave) / (1.0 + r12 * wave)) ** 2
    return np.asarray((reflectance * color_weights()).sum(axis=-1))


def film_by_quadrature(bare: Floats, cos_theta: Floats, thickness: Floats, ior: Floats) -> Floats:
    """Return the exact value of `lookdev.brdf.film.film_reflectance`, not clipped, for bare (n, 3) and numbers (n,)."""
    inside = np.sqrt(1.0 - (1.0 - cos_theta**2) / ior**2)
    # Born and Wolf, 1.6 (55) and (56): a wave through a layer.
    phase = np.exp(4.0j * np.pi * (ior * inside * thickness)[:, None] / WAVELENGTHS)
    upper = {
        "s": (cos_theta - ior * inside) / (cos_theta + ior * inside),
        "p": (inside - ior * cos_theta) / (inside + ior * cos_theta),
    }
    reflectance = np.zeros(bare.shape)
    for channel, weights in enumerate(color_weights()):
        whole = -np.sqrt(bare[:, channel])
        for r12 in upper.values():
            # The lower face: together with the upper face, at thickness 0, it reflects `whole`.
            r23 = (whole - r12) / (1.0 - r12 * whole)
            wave = r23[:, None] * phase
            amplitude = (r12[:, None] + wave) / (1.0 + r12[:, None] * wave)
            reflectance[:, channel] += 0.5 * np.abs(amplitude) ** 2 @ weights
    return reflectance
