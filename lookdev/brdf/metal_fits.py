"""Make the table of metals by name: ``python -m lookdev.brdf.metal_fits`` writes it.

For each metal and each of `lookdev.brdf.metal.METAL_COLORS`, the table has eta and k of each channel, and their
deviation: the largest difference between the conductor's curve and the reflectance of the metal's spectra
(`lookdev.brdf.conductor.metal_curve`), clipped to [0, 1], at angles of incidence from 0 to 90 degrees. `outside` has
the largest excess of that reflectance below 0 and above 1.

A channel is a weighted sum over all wavelengths, some weights negative, so no index reproduces it exactly.
``"nearest"`` has the smallest deviation; ``"bands"`` are means over bands of wavelengths.

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
"""Cosines of the angles at which curves are compared."""

_BANDS = ((620.0, 740.0), (495.0, 570.0), (450.0, 495.0))  # nm; red, green, blue
_ROUNDS, _SHRINK, _POINTS = 60, 0.7, 21


def largest_deviation(index: Floats, target: Floats) -> Floats:
    """Return the largest difference of the curves of eta and k, (..., 2), from reflectances at `COSINES`, (...)."""
    curve = conductor_fresnel(COSINES, index[..., :1], index[..., 1:])
    return np.asarray(np.abs(curve - target).max(axis=-1))


# Gulbrandsen 2014, section 3. The search is over r, the reflectance at normal incidence, and u, the position of eta in
# its range for r. Good fits have nearly the same r.
def nearest_index(target: Floats) -> Floats:
    """Return the eta and k, (2,), with the least deviation from reflectances at `COSINES`, by shrinking grids."""
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


# Trent 2017, section 4.2. His integral of p has the band's width as a factor, with which the result is not a mean.
def band_means(name: str) -> Floats:
    """Return the means of eta and of k, (3, 2), over three bands, weighted by p."""
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
    """Return the table."""
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
    eta, k = index.T
    return {"eta": _round(eta), "k": _round(k), "deviation": _round(largest_deviation(index, target.T))}


def _round(values: Iterable[float]) -> list[float]:
    return [float(f"{round(float(value), 8):.5g}") for value in values]


if __name__ == "__main__":
    METAL_TABLE_FILE.write_text(json.dumps(make_table(), indent=1) + "\n")
