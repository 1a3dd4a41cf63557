"""Quadrature over directions for lobes of any width, as in `lookdev.brdf.quadrature`, in bins and with an error bound.

With ``t = tan^2 theta_h`` the first coordinate of a cell is ``a = log(1 + t / t0) / L``, the second the azimuth of the
half vector. A direction above the horizon has ``|wo + wi| <= 2`` and ``(wo + wi)_z > wo_z``, so a = 1 is at
``tan theta_h = 2 / wo_z``. A lobe is integrated in its own frame, where it is a reflection.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Floats, Indices
from lookdev.brdf import Lobe
from lookdev.brdf.lobes import DirectionPair

# Half the smallest alpha that the models allow, squared.
_T0 = 0.0005**2
CELLS = (112, 96)
_NODES = 2
# Midpoints along each side of a cell that the horizon crosses.
_EDGE_NODES = 12
BINS = (56, 24)


@dataclass(frozen=True)
class Integral:
    """The integral of a function over each bin (56 * 24,), its sum, and a bound of the sum's error."""

    bins: Floats
    total: float
    error: float


class HalfVectorGrid:
    """Directions on the grid for one viewing direction `wo` (3,), with `cells`, multiples of `BINS`."""

    def __init__(self, wo: Floats, cells: tuple[int, int] = CELLS) -> None:
        self.wo = wo
        self._cells = cells
        self._length = np.log1p((2.0 / wo[2]) ** 2 / _T0)
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        corner = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1).reshape(-1, 2)
        self._bin = (corner // (cells[0] // BINS[0], cells[1] // BINS[1])) @ (BINS[1], 1)
        wi, weight = self._rule(corner, 0.5 * (nodes + 1.0), 0.5 * weights)
        above = (wi[..., 2] > 0.0) & (weight > 0.0)
        self._inside = above.all(axis=-1)
        self._edge = above.any(axis=-1) & ~self._inside
        self._inner = wi[self._inside], weight[self._inside]
        midpoints = (np.arange(_EDGE_NODES) + 0.5) / _EDGE_NODES
        self._outer = self._rule(corner[self._edge], midpoints, np.full(_EDGE_NODES, 1.0 / _EDGE_NODES))

    def _rule(self, corner: Indices, nodes: Floats, weights: Floats) -> tuple[Floats, Floats]:
        """Return directions (cells, n, 3) and quadrature weights in steradians (cells, n)."""
        a = (corner[:, 0, None] + nodes) / self._cells[0]
        phi = 2.0 * np.pi * (corner[:, 1, None] + nodes) / self._cells[1]
        grown = np.exp(a * self._length)
        t = _T0 * (grown - 1.0)
        # d omega_h = sin theta_h d theta_h d phi = dt d phi / (2 (1 + t)^(3/2)).
        density = _T0 * grown * self._length / (2.0 * (1.0 + t) ** 1.5)
        cos_h = 1.0 / np.sqrt(1.0 + t)
        sin_h = np.sqrt(t) * cos_h
        shape = (len(corner), len(nodes), len(nodes))
        sin_part = np.stack([np.cos(phi), np.sin(phi)], axis=-1)[:, None] * sin_h[:, :, None, None]
        wm = np.concatenate([sin_part, np.broadcast_to(cos_h[:, :, None, None], (*shape, 1))], axis=-1)
        cos_d = wm @ self.wo
        # d omega_i = 4 (wi . wm) d omega_h, Walter et al. 2007, eq. 14.
        area = (density * weights)[:, :, None] * weights * (2.0 * np.pi / (self._cells[0] * self._cells[1]))
        wi = 2.0 * cos_d[..., None] * wm - self.wo
        # If the horizon runs between cells, no cell contains its edge.
        flat = (len(corner), len(nodes) ** 2)
        return wi.reshape(*flat, 3), (4.0 * np.maximum(cos_d, 0.0) * area).reshape(flat)

    def integrate(self, function: Callable[[Floats, Floats], Floats]) -> Integral:
        """Integrate ``function(wo, wi)``, zero below the horizon, over solid angle."""
        inner, outer = (
            (function(np.broadcast_to(self.wo, wi.shape), wi) * weight).sum(axis=-1)
            for wi, weight in (self._inner, self._outer)
        )
        cells = np.zeros(self._bin.size)
        cells[self._inside], cells[self._edge] = inner, outer
        # In a cell that the horizon crosses, n x n midpoints leave about 1 / n of the cell uncertain.
        return Integral(np.bincount(self._bin, cells), float(cells.sum()), float(outer.sum()) / _EDGE_NODES)

    def total(self, function: Callable[[Floats, Floats], Floats]) -> Floats:
        """Integrate ``function(wo, wi)``, (..., n), zero below the horizon, over solid angle, (n,)."""
        parts = (
            function(np.broadcast_to(self.wo, wi.shape), wi) * w[..., None] for wi, w in (self._inner, self._outer)
        )
        return sum(part.sum(axis=(0, 1)) for part in parts)

    def bin_of(self, wi: Floats) -> Indices:
        """Return the bin of each direction (n, 3) above the horizon."""
        half = self.wo + wi
        t = (half[:, 0] ** 2 + half[:, 1] ** 2) / half[:, 2] ** 2
        a = np.log1p(t / _T0) / self._length
        phi = np.arctan2(half[:, 1], half[:, 0]) / (2.0 * np.pi) % 1.0
        row, column = (np.minimum((x * n).astype(np.intp), n - 1) for x, n in zip((a, phi), BINS, strict=True))
        return row * BINS[1] + column


def half_vector_view(lobe: Lobe, wo: Floats) -> Floats:
    """Return the view (3,) in the lobe's frame that determines the half vectors of the lobe."""
    if lobe.name in ("specularTransmission", "refraction") or lobe.model == "lafortune":
        # The centre of the highlight, where the half vector is the normal, mirrors the refracted view. A lobe of
        # Lafortune's model has its own direction, which may be below the horizon.
        middle = np.ravel(lobe.sample(np.zeros(1), np.zeros(1)))
        if middle[2] > 0.0:
            return middle * [-1.0, -1.0, 1.0]
    return np.ravel(lobe.frame.to_local(wo))


def f_cosine(lobe: Lobe, wo: Floats, wi: Floats) -> Floats:
    """Return f times the cosine to the lobe's normal, (..., 3), at directions in the lobe's frame.

    Of a lobe that does not cross it, the surface's horizon cuts a part off.
    """
    local = np.broadcast_to(lobe.frame.to_local(wo), wi.shape)
    above = (wi[..., 2] > 0.0) & (lobe.crosses_surface | (lobe.frame.from_local(wi)[..., 2] > 0.0))
    return lobe.evaluate(DirectionPair.from_directions(local, wi)) * np.where(above, wi[..., 2], 0.0)[..., None]
