"""Make the table of metals by name: ``python -m lookdev.brdf.metal_fits`` writes it.

For each metal and each of `lookdev.brdf.metal.METAL_COLORS`, eta and k of each channel, and their deviation: the
largest difference of the conductor's curve from the reflectance that the metal's spectra give
(`lookdev.brdf.conductor.metal_curve`), clipped to [0, 1], at angles of incidence from 0 to 90 degrees. `outside` is by
how much that reflectance leaves [0, 1] at most, below 0 and above 1.

``"nearest"`` has the smallest deviation: the light of all wavelengths that a channel counts, some of them negatively,
has no index of its own. ``"bands"`` are means over bands of wavelengths.

- Gulbrandsen, O. 2014. Artist Friendly Metallic Fresnel. JCGT 3(4).
- Trent, A. 2017. Rendering Notes, section 4.2.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.brdf.conductor import METALS, metal_curve, metal_indices
from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.brdf.metal import INTERFACE, METAL_TABLE

Floats = NDArray[np.float64]

COSINES: Floats = np.cos(np.radians(np.arange(91.0)))
"""Of the angles at which curves are compared."""

_BANDS = ((620.0, 740.0), (495.0, 570.0), (450.0, 495.0))  # nm; red, green, blue
_ROUNDS, _CLOSER, _POINTS = 60, 0.7, 21


def deviation(index: Floats, target: Floats) -> Floats:
    """Return the largest difference of the curves of eta and k, (..., 2), from reflectances at `COSINES`, (...)."""
    curve = conductor_fresnel(COSINES, index[..., :1], index[..., 1:])
    return np.asarray(np.abs(curve - target).max(axis=-1))


# Gulbrandsen 2014, section 3: by the reflectance r at normal incidence and eta, as good fits are alike in r.
def nearest(target: Floats) -> Floats:
    """Return the eta and k, (2,), with the least deviation from reflectances at `COSINES`: a grid that closes in."""
    ranges = np.array([INTERFACE[name].hard for name in ("eta", "k")]).T

    def index(r: Floats, u: Floats) -> Floats:
        least = (1.0 - np.sqrt(r)) / (1.0 + np.sqrt(r))
        eta = least ** (1.0 - 2.0 * u)  # from that to its inverse, where k is 0
        k = np.sqrt(np.maximum(r * (eta + 1.0) ** 2 - (eta - 1.0) ** 2, 0.0) / (1.0 - r))
        return np.asarray(np.clip(np.stack([eta, k], axis=-1), *ranges))

    place, width = np.array([target[0], 0.5]), np.array([0.1, 0.5])
    for _ in range(_ROUNDS):
        axes = np.clip(np.linspace(-1.0, 1.0, _POINTS)[:, None] * width + place, 0.0, (1.0 - 1e-6, 1.0)).T
        grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        place, width = grid[np.argmin(deviation(index(*grid.T), target))], _CLOSER * width
    return index(*place)


# Trent 2017, section 4.2, whose integral of p is multiplied by the width of the band: then it is no mean.
def bands(name: str) -> Floats:
    """Return the means of eta and of k, (3, 2), over three bands, weighted by p."""
    rows = []
    for low, high in _BANDS:
        x = np.linspace(0.0, 1.0, 241)
        p = np.exp(-((x - 0.5) ** 2))
        p[[0, -1]] *= 0.5  # the trapezoid rule
        rows.append([(p * np.asarray(each)).sum() / p.sum() for each in metal_indices(name, low + (high - low) * x)])
    return np.array(rows)


def make_table() -> dict[str, Any]:
    """Return the table."""
    table = {}
    for name in METALS:
        curve = np.asarray(metal_curve(name, COSINES))
        target = np.clip(curve, 0.0, 1.0)
        found = {"nearest": np.stack([nearest(channel) for channel in target.T]), "bands": bands(name)}
        table[name] = {
            color: {
                "eta": _rounded(index[:, 0]),
                "k": _rounded(index[:, 1]),
                "deviation": _rounded(deviation(index, target.T)),
            }
            for color, index in found.items()
        } | {"outside": _rounded([max(-curve.min(), 0.0), max(curve.max() - 1.0, 0.0)])}
    return table


def _rounded(values: Any) -> list[float]:
    return [float(f"{round(float(value), 8):.5g}") for value in values]


if __name__ == "__main__":
    METAL_TABLE.write_text(json.dumps(make_table(), indent=1) + "\n")
