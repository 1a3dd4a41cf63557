"""Make the table of metals by name, `lookdev.brdf.metal.METAL_TABLE_FILE`: ``python -m lookdev.brdf.metal_fits``.

The table has an index of refraction, eta + ik, for each of red, green and blue. The red, green and blue of a metal's
true reflectance (`lookdev.brdf.conductor.metal_curve`) are weighted sums over all wavelengths, with some negative
weights, so that no single index reproduces one of them exactly. There are two ways to choose the index
(`lookdev.brdf.metal.METAL_COLORS`). ``"nearest"`` is the index with the smallest deviation. ``"bands"`` has the
means of eta and k over a band of wavelengths.

The deviation of an index is the largest difference, at angles of incidence from 0 to 90 degrees, between its
reflectance by Fresnel's equations and the true reflectance, clipped to [0, 1]. `outside` has two numbers: the most
by which the true reflectance is below 0, and above 1, before the clip.

- Gulbrandsen, O. 2014. Artist Friendly Metallic Fresnel. JCGT 3(4).
- Trent, A. 2017. Rendering Notes, section 4.2.
"""

from __future__ import annotations

import json
from collections.abc import Iterable

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.conductor import METALS, metal_curve, metal_indices
from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.brdf.metal import INTERFACE, METAL_TABLE_FILE, MetalEntry, MetalIndex

COSINES: Floats = np.cos(np.radians(np.arange(91.0)))
"""Cosines of the angles of incidence, 0 to 90 degrees, at which reflectances are compared."""

_BANDS = ((620.0, 740.0), (495.0, 570.0), (450.0, 495.0))  # nm; red, green, blue

# The search of `nearest_index`: the number of grids, the factor by which each is smaller than the one before, and the
# number of points of a grid along each axis.
_ROUNDS, _SHRINK, _POINTS = 60, 0.7, 21


def largest_deviation(index: Floats, target: Floats) -> Floats:
    """Return the deviation (...) of indices (..., 2), eta and k, from true reflectances (..., 91) at `COSINES`."""
    curve = conductor_fresnel(COSINES, index[..., :1], index[..., 1:])
    return np.asarray(np.abs(curve - target).max(axis=-1))


# Gulbrandsen 2014, section 3. The search is over r, the reflectance at normal incidence, and u, the position of eta in
# the range that r allows, from 0 to 1. Good fits have nearly the r of the target, so the first grid is narrow in r.
def nearest_index(target: Floats) -> Floats:
    """Return the eta and k, (2,), with the least deviation from reflectances (91,) at `COSINES`.

    Each grid of candidates is smaller than the one before, and is centred at the best candidate of the previous grid.
    """
    ranges = np.array([INTERFACE[name].hard for name in ("eta", "k")]).T

    def eta_and_k(r: Floats, u: Floats) -> Floats:
        min_eta = (1.0 - np.sqrt(r)) / (1.0 + np.sqrt(r))
        eta = min_eta ** (1.0 - 2.0 * u)  # from `min_eta` to its inverse; at both, k is 0
        k = np.sqrt(np.maximum(r * (eta + 1.0) ** 2 - (eta - 1.0) ** 2, 0.0) / (1.0 - r))
        return np.asarray(np.clip(np.stack([eta, k], axis=-1), *ranges))

    centre, width = np.array([target[0], 0.5]), np.array([0.1, 0.5])
    for _ in range(_ROUNDS):
        axes = np.clip(np.linspace(-1.0, 1.0, _POINTS)[:, None] * width + centre, 0.0, (1.0 - 1e-6, 1.0)).T
        grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        centre, width = grid[np.argmin(largest_deviation(eta_and_k(*grid.T), target))], _SHRINK * width
    return eta_and_k(*centre)


# Trent 2017, section 4.2, with weights p over a band. His integral of p has the band's width as an additional factor,
# with which the result would not be a mean.
def band_means(name: str) -> Floats:
    """Return the means of eta and k of a metal over the bands of red, green and blue, (3, 2)."""
    rows = []
    for low, high in _BANDS:
        x = np.linspace(0.0, 1.0, 241)
        p = np.exp(-((x - 0.5) ** 2))
        p[[0, -1]] *= 0.5  # the trapezoid rule
        rows.append(
            [(p * np.asarray(values)).sum() / p.sum() for values in metal_indices(name, low + (high - low) * x)]
        )
    return np.array(rows)


def make_table() -> dict[str, MetalEntry]:
    """Return the entry of each metal, by its name."""
    table: dict[str, MetalEntry] = {}
    for name in METALS:
        curve = np.asarray(metal_curve(name, COSINES))
        target = np.clip(curve, 0.0, 1.0)
        table[name] = {
            "nearest": _rounded_index(np.stack([nearest_index(channel) for channel in target.T]), target),
            "bands": _rounded_index(band_means(name), target),
            "outside": _round([max(-curve.min(), 0.0), max(curve.max() - 1.0, 0.0)]),
        }
    return table


def _rounded_index(index: Floats, target: Floats) -> MetalIndex:
    """Return a `MetalIndex` for eta and k (3, 2), with the deviations from true reflectances `target` (91, 3)."""
    eta, k = index.T
    return {"eta": _round(eta), "k": _round(k), "deviation": _round(largest_deviation(index, target.T))}


def _round(values: Iterable[float]) -> list[float]:
    """Return numbers rounded to five significant digits, and to 8 decimals."""
    return [float(f"{round(float(value), 8):.5g}") for value in values]


if __name__ == "__main__":
    METAL_TABLE_FILE.write_text(json.dumps(make_table(), indent=1) + "\n")
