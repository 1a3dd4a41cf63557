"""Importance sampling of measured data: tables of half vectors, one for each cell of views, with a cosine lobe beside.

A table has the mean, at some points of each cell of half vectors, of f above a floor, times the cosine and the Jacobian
``4 wi . wm`` from directions of the light to half vectors (Walter et al. 2007, eq. 14). Its density over solid angle is
linear between the elevations where cells meet, and constant in the azimuths of a cell. The floor, below which little of
f is, is left to the cosine lobe, which samples it exactly; that lobe also bounds the weights ``f cos / pdf`` where a
table misses a highlight. A highlight keeps its place among half vectors as the view moves, so few views suffice: a view
takes the table of its cell, the mean over some views of it.

Cells are even in azimuth and in the root of theta_h, as MERL's. "Linear" is in ``sin^2(theta_h / 2)``, which is even in
solid angle, and does not cancel where the cosine would.

- Walter, B. et al. 2007. Microfacet Models for Refraction through Rough Surfaces. EGSR.
- Lawrence, J. et al. 2004. Efficient BRDF Importance Sampling Using a Factored Representation. SIGGRAPH.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.brdf.lobes import Directions
from lookdev.brdf.measured.grids import HALF_PI, Anisotropic, Floats, Grid, arc_tangent
from lookdev.brdf.microfacet import sample_cosine
from lookdev.brdf.mixture import BELOW_ONE
from lookdev.brdf.table import Table, look_up
from lookdev.brdf.vectors import TINY, Array, reflect, vector

# By whether the data have a direction.
_CELLS = {False: (256, 16), True: (128, 32)}  # elevations and azimuths of half vectors: powers of two, for bisection
_INSIDE = {False: (2, 2), True: (1, 2)}  # places of half vectors in a cell
_VIEWS = {False: (64, 1), True: (16, 16)}  # elevations and azimuths of views

_BESIDE = 0.1  # least part of a cell's density in the cells beside it, which the horizon may cut
_FLOOR = 0.02  # part of the projected hemisphere in which f is below the floor
_COSINE = (3e-5, 0.99)  # least and largest share of the cosine lobe
_LOWEST = 1e-3  # cosine of the lowest view for which a table is made


@dataclass(frozen=True, eq=False)
class Proposal:
    """The tables of views: a row for each.

    `density` (views, thetas + 1) is over solid angle of half vectors, at the elevations where cells meet; `part`
    (views * thetas, phis) is the factor of it in each azimuth. `marginal` (views, thetas + 1) and `conditional`
    (views * thetas, phis + 1) are the cumulative distributions at the beginnings of cells. `albedo` (views, 3) is the
    directional albedo, `cosine` (views, 1) the share of the cosine lobe. With `directed` azimuths are from the tangent,
    else from the view.
    """

    cosine: Table
    density: Table
    part: Table
    marginal: Table
    conditional: Table
    albedo: Floats
    directed: bool

    def pdf(self, d: Directions) -> Array:
        """Return the pdf (...) of `sample` over solid angle."""
        thetas, phis = _CELLS[self.directed]
        x, y = d.wm[..., 0], d.wm[..., 1]
        across = x * x + y * y
        theta = arc_tangent(np.sqrt(across), d.wm[..., 2])
        i = np.clip(np.floor(np.sqrt(theta / HALF_PI) * float(thetas)), 0.0, thetas - 1.0)
        low, high = _square(i, thetas), _square(i + 1.0, thetas)
        # sin^2(theta/2), from what does not cancel where theta is small.
        at = np.clip((0.5 * across / (1.0 + d.wm[..., 2]) - low) / (high - low), 0.0, 1.0)
        along, beside = self._axis(d.wo)
        phi = arc_tangent(along * y - beside * x, along * x + beside * y)
        j = np.clip(np.floor((phi + np.pi) * (0.5 * phis / np.pi)), 0.0, phis - 1.0)
        view = self._view(d.wo)
        begin, end = look_up(self.density, view, i), look_up(self.density, view, i + 1.0)
        halves = (begin + at * (end - begin)) * look_up(self.part, view * float(thetas) + i, j)
        cosine = self._cosine(view)
        density: Array = cosine * (1.0 / np.pi) * d.cos_theta_i + (1.0 - cosine) * 0.25 * halves / d.cos_theta_d
        return density

    def sample(self, wo: Array, u1: Array, u2: Array) -> Array:
        """Draw directions to the light (..., 3), which may be below the horizon."""
        thetas, phis = _CELLS[self.directed]
        view = self._view(wo)
        cosine = self._cosine(view)
        u = np.clip((u1 - cosine) / (1.0 - cosine), 0.0, BELOW_ONE)
        i, up = _bisected(self.marginal, view, u)
        j, around = _bisected(self.conditional, view * float(thetas) + i, u2)
        begin, end = look_up(self.density, view, i), look_up(self.density, view, i + 1.0)
        root = np.sqrt(begin * begin + up * (end * end - begin * begin))
        low, high = _square(i, thetas), _square(i + 1.0, thetas)
        s = low + up * (begin + end) / np.maximum(begin + root, TINY) * (high - low)
        sine, phi = 2.0 * np.sqrt(s * (1.0 - s)), (j + around) * (2.0 * np.pi / phis) - np.pi
        x, y = sine * np.cos(phi), sine * np.sin(phi)
        along, beside = self._axis(wo)
        wm = vector(along * x - beside * y, beside * x + along * y, 1.0 - 2.0 * s)
        by_cosine = sample_cosine(np.minimum(u1 / cosine, BELOW_ONE), u2)
        return np.where(np.expand_dims(u1 < cosine, -1), by_cosine, reflect(wo, wm))

    def _axis(self, wo: Array) -> tuple[Any, Any]:
        """Return x and y of the direction from which the azimuths of half vectors are."""
        if self.directed:
            return 1.0, 0.0
        x, y = wo[..., 0], wo[..., 1]
        length = np.sqrt(x * x + y * y)
        upright = length < TINY
        divisor = np.where(upright, 1.0, length)
        return np.where(upright, 1.0, x / divisor), np.where(upright, 0.0, y / divisor)

    def _cosine(self, view: Array) -> Array:
        return look_up(self.cosine, view, 0.0 * view)

    def _view(self, wo: Array) -> Array:
        """Return the row of a view."""
        thetas, phis = _VIEWS[self.directed]
        x, y = wo[..., 0], wo[..., 1]
        theta = arc_tangent(np.sqrt(x * x + y * y), wo[..., 2])
        row: Array = np.clip(np.floor(theta * (thetas / HALF_PI)), 0.0, thetas - 1.0)
        if not self.directed:
            return row
        column: Array = np.clip(np.floor((arc_tangent(y, x) + np.pi) * (0.5 * phis / np.pi)), 0.0, phis - 1.0)
        return row * float(phis) + column


def _bisected(cumulative: Table, row: Array, u: Array) -> tuple[Array, Array]:
    """Return the cell of numbers in [0, 1) and their places in it, by the cumulative distribution of a row."""
    count = cumulative.values.shape[1] - 1
    cell: Any = 0.0 * u
    step = count // 2
    while step:
        cell = np.where(look_up(cumulative, row, cell + float(step)) <= u, cell + float(step), cell)
        step //= 2
    begin, end = look_up(cumulative, row, cell), look_up(cumulative, row, cell + 1.0)
    return cell, np.clip((u - begin) / np.maximum(end - begin, TINY), 0.0, BELOW_ONE)


def _square(edge: Any, thetas: int) -> Any:
    """Return sin^2(theta_h / 2) where cells meet."""
    root = np.sin(0.5 * HALF_PI / thetas**2 * edge * edge)
    return root * root


def make_proposal(grid: Grid) -> Proposal:
    """Make the tables of measured data."""
    directed = isinstance(grid, Anisotropic)
    (thetas, phis), inside = _CELLS[directed], _INSIDE[directed]
    squares = np.asarray(_square(np.arange(thetas + 1.0), thetas))
    solid = np.diff(squares) * (4.0 * np.pi / phis)
    places = _half_vectors(squares[:-1], np.diff(squares), phis, inside)
    edges = _half_vectors(squares, 0.0, phis, (1, inside[1]))
    density, parts, albedo, cosine = [], [], [], []
    for views in _view_cells(directed):
        f, weight = _values(grid, views, places)
        weight *= (solid / prod(inside))[:, None, None, None] / len(views)
        color = (f * weight[..., None]).sum(axis=(0, 1, 2, 3, 4))
        bright = f.mean(axis=-1)
        # What rounding alone lifts above the floor is none of a highlight.
        floor = _quantile(bright, weight, _FLOOR) * (1.0 + 1e-9)
        shares = (np.maximum(bright - floor, 0.0) * weight).sum(axis=(0, 2, 4))
        total, least, most = color.mean(), *_COSINE
        cosine.append(np.clip(np.pi * floor / total, least, most) if total > 0.0 else most)
        f, weight = _values(grid, views, edges)
        met = (np.maximum(f.mean(axis=-1) - floor, 0.0) * weight).mean(axis=(0, 2, 3, 4))
        density.append(_met(met, shares.sum(axis=-1) / (solid * phis), solid * phis))
        parts.append(np.maximum(shares, _BESIDE * np.maximum(np.roll(shares, 1, axis=1), np.roll(shares, -1, axis=1))))
        albedo.append(color)
    nodes, conditional = np.stack(density), _cumulative(np.concatenate(parts))
    return Proposal(
        density=Table(nodes),
        part=Table(np.diff(conditional, axis=-1) * phis),
        marginal=Table(_cumulative(0.5 * (nodes[:, 1:] + nodes[:, :-1]) * solid)),
        conditional=Table(conditional),
        albedo=np.stack(albedo),
        cosine=Table(np.array(cosine)[:, None]),
        directed=directed,
    )


def _met(met: Floats, mean: Floats, solid: Floats) -> Floats:
    """Return the density where cells of solid angles (thetas,) meet, by its values there.

    It is raised where the mean of a cell beside is much brighter.
    """
    beside = 0.25 * (np.append(mean, mean[-1]) + np.append(mean[0], mean))
    found = np.maximum(met, beside)
    # Of a view without any highlight every cell is as good.
    found = found if found.any() else np.ones_like(found)
    return np.asarray(found / (0.5 * (found[1:] + found[:-1]) * solid).sum())


def _quantile(values: Floats, weights: Floats, part: float) -> float:
    """Return the value below which that part of the weights is."""
    order = np.argsort(values, axis=None)
    sums = np.cumsum(weights.ravel()[order])
    return float(values.ravel()[order[np.searchsorted(sums, part * sums[-1])]])


def _half_vectors(squares: Floats, sizes: Floats | float, phis: int, inside: tuple[int, int]) -> Floats:
    """Return half vectors (thetas, inside, phis, inside, 3) in cells, even in solid angle."""
    up, around = ((np.arange(count) + 0.5) / count for count in inside)
    s = (squares[:, None] + np.reshape(sizes, (-1, 1)) * up)[..., None, None]
    phi = (np.arange(phis)[:, None] + around) * (2.0 * np.pi / phis) - np.pi
    sine = 2.0 * np.sqrt(s * (1.0 - s))
    x, y = sine * np.cos(phi), sine * np.sin(phi)
    return np.stack([x, y, np.broadcast_to(1.0 - 2.0 * s, x.shape)], axis=-1)


def _view_cells(directed: bool) -> Iterator[list[Floats]]:
    """Yield views in each cell, in the order of the rows."""
    thetas, phis = _VIEWS[directed]
    for row in range(thetas):
        for column in range(phis):
            views = []
            for inside in (0.25, 0.75):
                theta = min((row + inside) * HALF_PI / thetas, np.arccos(_LOWEST))
                phi = (column + 1.0 - inside) * 2.0 * np.pi / phis - np.pi if directed else 0.0
                views.append(np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]))
            yield views


def _values(grid: Grid, views: Sequence[Floats], wm: Floats) -> tuple[Floats, Floats]:
    """Return f (views, ..., 3) at half vectors, and the cosine times the Jacobian; 0 where the light is below."""
    wo = np.stack([np.broadcast_to(view, wm.shape) for view in views])
    wi: Any = reflect(wo, wm)
    valid = (wi[..., 2] > 0.0) & ((wm * wo).sum(axis=-1) > 0.0)
    f, weight = np.zeros(wo.shape), np.zeros(valid.shape)
    d = Directions.of(wo[valid], wi[valid])
    f[valid], weight[valid] = grid.f(d, "linear"), d.cos_theta_i * 4.0 * d.cos_theta_d
    return f, weight


def _cumulative(shares: NDArray[np.float64]) -> Floats:
    """Return the cumulative distribution (n, cells + 1) of rows of shares; even for a row without any."""
    total = shares.sum(axis=-1, keepdims=True)
    even = np.where(total > 0.0, shares / np.where(total > 0.0, total, 1.0), 1.0 / shares.shape[-1])
    sums: Floats = np.concatenate([np.zeros((len(shares), 1)), np.cumsum(even, axis=-1)], axis=-1)
    # In float32 too the last cell with a share ends at 1, which no number reaches.
    return np.asarray(sums / sums[:, -1:])
