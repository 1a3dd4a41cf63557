"""Metals: their measured eta and k, and the colour that follows from them.

The numbers, in ``data/metals.csv``, are as in the refractiveindex.info database (public domain, CC0), from 365 to
821 nm, thinned where they are smooth. Publications differ by some hundredths of reflectance, which depends on how the
surface was made. Gold is a smooth film's, 0.05 brighter in green than Johnson and Christy's. Silver is a fit to several
sources, 0.03 to 0.06 darker than Johnson and Christy's fresh film and slightly warm, as in the usual look-dev tables.

A metal's colour is its reflectance at normal incidence, seen by the CIE 1931 observer under D65, the white of Rec.709:
what reflects all light is exactly (1, 1, 1).

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
- C. Wyman, P.-P. Sloan, P. Shirley, Simple analytic approximations to the CIE XYZ color matching functions,
  JCGT 2(2) (2013).
- CIE 015:2018, Colorimetry: the standard illuminant D65.
"""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

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
"""Each metal, and who published its eta and k. Brass is 70 % copper and 30 % zinc."""

_DATA = Path(__file__).parent / "data" / "metals.csv"

_WAVELENGTHS = np.arange(380.0, 781.0, 10.0)

# CIE 015:2018, D65 at `_WAVELENGTHS`, relative to 100 at 560 nm.
_D65 = np.array([
    49.9755, 54.6482, 82.7549, 91.4860, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861, 115.923, 108.811, 109.354,
    107.802, 104.790, 107.689, 104.405, 104.046, 100.000, 96.3342, 95.7880, 88.6856, 90.0062, 89.5991, 87.6987, 83.2886,
    83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091, 74.3490, 61.6040, 69.8856, 75.0870, 63.5927, 46.4182,
    66.8054, 63.3828,
])  # fmt: skip

# Wyman, Sloan and Shirley 2013, table 1, the fit by several lobes. Each: peak, centre, width below and above it, in nm.
_LOBES = (
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)

# ITU-R BT.709, primaries and white, inverted.
_XYZ_TO_REC709 = np.array([
    [3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252],
])  # fmt: skip


def metal_indices(name: str, wavelengths: Array) -> tuple[Array, Array]:
    """Return eta and k, (...) each, of one of `METALS` at `wavelengths`, (...), in nanometres.

    An unknown metal, or a wavelength outside 380 to 780 nm, raises ModelError.
    """
    if name not in METALS:
        raise ModelError(f"unknown metal '{name}' ({nearest_hint(name, list(METALS))})")
    if np.any((wavelengths < _WAVELENGTHS[0]) | (wavelengths > _WAVELENGTHS[-1])):
        raise ModelError(f"{name}: a wavelength is outside 380 to 780 nm")
    measured, eta, k = _measured()[name].T
    return np.interp(wavelengths, measured, eta), np.interp(wavelengths, measured, k)


@cache
def metal_reflectance(name: str) -> NDArray[np.float64]:
    """Return the colour at normal incidence of one of `METALS`: linear Rec.709, (3,), clipped to [0, 1].

    An unknown metal raises ModelError.
    """
    spectrum = np.asarray(conductor_fresnel(1.0, *metal_indices(name, _WAVELENGTHS)))
    # The white of the fitted observer is not exactly that of Rec.709.
    color = np.clip(_rec709(spectrum) / _rec709(np.ones_like(spectrum)), 0.0, 1.0)
    color.setflags(write=False)  # it is cached
    return color


def _rec709(spectrum: NDArray[np.float64]) -> NDArray[np.float64]:
    xyz: NDArray[np.float64] = (_D65 * spectrum) @ np.asarray(color_matching(_WAVELENGTHS))
    return _XYZ_TO_REC709 @ xyz


def color_matching(wavelengths: Array) -> Array:
    """Return the CIE 1931 2 degree colour matching functions, (..., 3), at wavelengths (...) in nanometres.

    A fit: it deviates from the tabulated functions by at most 0.03.
    """

    def lobe(peak: float, centre: float, below: float, above: float) -> Array:
        t = (wavelengths - centre) / np.where(wavelengths < centre, below, above)
        return peak * np.exp(-0.5 * t * t)

    return np.stack([sum(lobe(*numbers) for numbers in lobes) for lobes in _LOBES], axis=-1)


@cache
def _measured() -> dict[str, NDArray[np.float64]]:
    """Read wavelength, eta and k, (n, 3), of every metal."""
    rows: dict[str, list[list[float]]] = {}
    with _DATA.open(newline="", encoding="ascii") as file:
        for row in csv.DictReader(file):
            rows.setdefault(row["metal"], []).append([float(row[name]) for name in ("wavelength_nm", "eta", "k")])
    return {metal: np.array(numbers) for metal, numbers in rows.items()}
