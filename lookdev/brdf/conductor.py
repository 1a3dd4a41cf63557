"""Metals by name: the measured index of refraction, eta + ik, by wavelength, and the colour that a metal reflects.

The numbers in ``data/metals.csv`` are from the refractiveindex.info database (public domain, CC0), from 365 to
821 nm. Where the curves are smooth, some of the database's wavelengths are left out. docs/notebook/metal-spectra.md
compares the publications.

The colour of a metal is its reflectance, seen by the CIE 1931 observer under D65, the white of Rec.709. The colour of
a surface that reflects all light is exactly (1, 1, 1).

References
----------
- K. M. McPeak et al., Plasmonic films can easily be better: rules and recipes, ACS Photonics 2, 326 (2015).
- P. B. Johnson, R. W. Christy, Optical constants of the noble metals, Phys. Rev. B 6, 4370 (1972).
- P. B. Johnson, R. W. Christy, Optical constants of transition metals, Phys. Rev. B 9, 5056 (1974).
- M. R. Querry, Optical constants, Contractor Report CRDC-CR-85034 (1985).
- A. D. Rakić, Algorithm for the determination of intrinsic optical constants of metal films: application to
  aluminum, Appl. Opt. 34, 4755 (1995).
- A. D. Rakić, A. B. Djurišić, J. M. Elazar, M. L. Majewski, Optical properties of metallic films for
  vertical-cavity optoelectronic devices, Appl. Opt. 37, 5271 (1998), Brendel-Bormann model.
- CIE 015:2018, Colorimetry: the standard illuminant D65 and the standard observer of 1931.
"""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.brdf.vectors import Array
from lookdev.errors import ModelError, nearest_hint

METALS: dict[str, str] = {
    "aluminium": "Rakić 1995",
    "brass": "Querry 1985",
    "chromium": "Johnson and Christy 1974",
    "copper": "Johnson and Christy 1972",
    "gold": "McPeak et al. 2015",
    "iron": "Johnson and Christy 1974",
    "nickel": "Johnson and Christy 1974",
    "palladium": "Johnson and Christy 1974",
    "platinum": "Rakić et al. 1998",
    "silver": "Rakić et al. 1998",
    "titanium": "Johnson and Christy 1974",
    "tungsten": "Rakić et al. 1998",
}
"""The publication with the eta and k of each metal, by the metal's name. Brass is 70 % copper and 30 % zinc."""

_DATA = Path(__file__).parent / "data" / "metals.csv"

# The wavelengths in nanometres at which spectra are summed to colours.
_WAVELENGTHS = np.arange(380.0, 781.0, 10.0)

# CIE 015:2018, the spectral power of D65 at `_WAVELENGTHS`, relative to 100 at 560 nm.
_D65 = np.array([
    49.9755, 54.6482, 82.7549, 91.4860, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861, 115.923, 108.811, 109.354,
    107.802, 104.790, 107.689, 104.405, 104.046, 100.000, 96.3342, 95.7880, 88.6856, 90.0062, 89.5991, 87.6987, 83.2886,
    83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091, 74.3490, 61.6040, 69.8856, 75.0870, 63.5927, 46.4182,
    66.8054, 63.3828,
])  # fmt: skip

# CIE 015:2018, table of the CIE 1931 2 degree colour matching functions, at `_WAVELENGTHS`: x, y and z.
_OBSERVER = np.array([
    [
        0.001368, 0.004243, 0.01431, 0.04351, 0.13438, 0.2839, 0.34828, 0.3362, 0.2908, 0.19536, 0.09564, 0.03201,
        0.0049, 0.0093, 0.06327, 0.1655, 0.2904, 0.43345, 0.5945, 0.7621, 0.9163, 1.0263, 1.0622, 1.0026, 0.85445,
        0.6424, 0.4479, 0.2835, 0.1649, 0.0874, 0.04677, 0.0227, 0.011359, 0.00579, 0.002899, 0.00144, 0.00069,
        0.000332, 0.000166, 0.000083, 0.000042,
    ], [
        0.000039, 0.00012, 0.000396, 0.00121, 0.004, 0.0116, 0.023, 0.038, 0.06, 0.09098, 0.13902, 0.20802, 0.323,
        0.503, 0.71, 0.862, 0.954, 0.99495, 0.995, 0.952, 0.87, 0.757, 0.631, 0.503, 0.381, 0.265, 0.175, 0.107, 0.061,
        0.032, 0.017, 0.00821, 0.004102, 0.002091, 0.001047, 0.00052, 0.000249, 0.00012, 0.00006, 0.00003, 0.000015,
    ], [
        0.00645, 0.02005, 0.06785, 0.2074, 0.6456, 1.3856, 1.74706, 1.77211, 1.6692, 1.28764, 0.81295, 0.46518, 0.272,
        0.1582, 0.07825, 0.04216, 0.0203, 0.00875, 0.0039, 0.0021, 0.00165, 0.0011, 0.0008, 0.00034, 0.00019, 0.00005,
        0.00002, *[0.0] * 14,
    ],
])  # fmt: skip

# Converts XYZ to linear Rec.709: the inverse of the matrix that the primaries and the white of ITU-R BT.709 define.
_XYZ_TO_REC709 = np.array([
    [3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252],
])  # fmt: skip


def metal_indices(name: str, wavelengths: Array) -> tuple[Array, Array]:
    """Return eta and k, each (...), of one of `METALS` at `wavelengths`, (...), in nanometres.

    Raises ModelError if the metal is unknown, or if a wavelength is outside 380 to 780 nm.
    """
    if name not in METALS:
        raise ModelError(f"unknown metal '{name}' ({nearest_hint(name, list(METALS))})")
    if np.any((wavelengths < _WAVELENGTHS[0]) | (wavelengths > _WAVELENGTHS[-1])):
        raise ModelError(f"{name}: a wavelength is outside 380 to 780 nm")
    grid, eta, k = _load_spectra()[name].T
    return np.interp(wavelengths, grid, eta), np.interp(wavelengths, grid, k)


def metal_curve(name: str, cos_theta: Array) -> Array:
    """Return the reflectance (..., 3) in linear Rec.709 of one of `METALS`, at cosines of incidence (...).

    The reflectance is not clipped: the red of gold is above 1. An unknown metal raises ModelError.
    """
    spectrum = conductor_fresnel(np.expand_dims(cos_theta, -1), *metal_indices(name, _WAVELENGTHS))
    # The sum of D65 in steps of 10 nm is not exactly the white of Rec.709. The division makes it exact.
    white: Array = _rec709(np.ones_like(_WAVELENGTHS))
    return _rec709(spectrum) / white


@cache
def metal_reflectance(name: str) -> Floats:
    """Return the reflectance (3,) at normal incidence of one of `METALS`, in linear Rec.709, clipped to [0, 1].

    An unknown metal raises ModelError.
    """
    color: Floats = np.clip(np.asarray(metal_curve(name, np.ones(()))), 0.0, 1.0)
    color.setflags(write=False)  # the result is cached
    return color


def _rec709(spectrum: Array) -> Array:
    """Return the linear Rec.709 colour (..., 3) of a spectrum (..., wavelengths) under D65, not normalised."""
    color: Array = (_D65 * np.asarray(spectrum)) @ _OBSERVER.T @ _XYZ_TO_REC709.T
    return color


@cache
def _load_spectra() -> dict[str, Floats]:
    """Return, by the metal's name, an array (wavelengths, 3) whose columns are the wavelength in nm, eta and k."""
    rows: dict[str, list[list[float]]] = {}
    with _DATA.open(newline="", encoding="ascii") as file:
        for row in csv.DictReader(file):
            rows.setdefault(row["metal"], []).append([float(row[name]) for name in ("wavelength_nm", "eta", "k")])
    return {metal: np.array(numbers) for metal, numbers in rows.items()}
