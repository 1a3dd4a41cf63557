"""Importance sampling of measured data: half vectors are drawn from tables, and some directions from a cosine lobe.

The hemisphere of views is divided into cells, and so is the hemisphere of half vectors. A view uses the table of its
cell. This table is the mean over some views in the cell. A highlight has nearly the same half vectors for all views, so
few cells of views suffice.

The floor of f is a small quantile of its values over the projected hemisphere. The table has a number for each cell of
half vectors: the mean, over some points of the cell, of ``(f - floor) cos`` times the Jacobian ``4 wi . wm`` from
directions of the light to half vectors (Walter et al. 2007, eq. 14). Where f is below the floor, 0 is taken. The cosine
lobe samples the floor exactly. It also bounds the weights ``f cos / pdf`` where a table misses a highlight.

Cells of half vectors have equal steps of azimuth, and of the square root of theta_h, as in MERL's files. The density
over solid angle is constant over the azimuths of a cell. Between the cell's edges in theta_h, it is linear in
``sin^2(theta_h / 2)``. Equal steps of this number are equal solid angles. The cosine also has this property, but
cancels.

- Walter, B. et al. 2007. Microfacet Models for Refraction through Rough Surfaces. EGSR.
- Lawrence, J. et al. 2004. Efficient BRDF Importance Sampling Using a Factored Representation. SIGGRAPH.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import prod

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.angles import spherical_direction
from lookdev.brdf.lobes import DirectionPair
from lookdev.brdf.measured.grids import HALF_PI, AnisotropicGrid, MeasurementGrid, arc_tangent
from lookdev.brdf.microfacet import sample_cosine
from lookdev.brdf.mixture import ONE_MINUS_EPSILON
from lookdev.brdf.table import NumberTable, look_up
from lookdev.brdf.vectors import TINY, Array, Real, reflect, vector

# The numbers of cells along theta and phi, the angle to the normal and the azimuth; the keys are whether the data are
# anisotropic (`Proposal.is_anisotropic`).
_HALF_VECTOR_CELLS = {False: (256, 16), True: (128, 32)}  # cells of half vectors: powers of two, for bisection
_POINTS_PER_CELL = {False: (2, 2), True: (1, 2)}  # half vectors in a cell at which f is evaluated
_VIEW_CELLS = {False: (64, 1), True: (16, 16)}  # cells of views

_MIN_NEIGHBOUR_RATIO = 0.1  # least density relative to the neighbouring cells, as the horizon may cut a cell
_FLOOR_FRACTION = 0.02  # share of the projected hemisphere where f is below the floor
_COSINE_SHARES = (3e-5, 0.99)  # least and largest share of the cosine lobe
_MIN_VIEW_COSINE = 1e-3  # least cosine to the normal of the views for which tables are made


@dataclass(frozen=True, eq=False)
class Proposal:
    """The tables for importance sampling of one measurement.

    `views` is the number of cells of views, `thetas` and `phis` are the numbers of cells of half vectors along theta_h
    and phi_h.

    Attributes
    ----------
    cosine : (views, 1)
        The share of the cosine lobe.
    density : (views, thetas + 1)
        The density of half vectors over solid angle, as a mean over the azimuth, at the edges of cells in theta_h.
    azimuth_factor : (views * thetas, phis)
        The factor of `density` in each cell of azimuth.
    marginal : (views, thetas + 1)
        The cumulative distribution of the cells in theta_h, from 0 to 1.
    conditional : (views * thetas, phis + 1)
        The cumulative distribution of the cells in azimuth for given theta_h, from 0 to 1.
    albedo : (views, 3)
        The directional albedo.
    is_anisotropic
        Whether azimuths are measured from the tangent. Otherwise they are measured from the view.
    """

    cosine: NumberTable
    density: NumberTable
    azimuth_factor: NumberTable
    marginal: NumberTable
    conditional: NumberTable
    albedo: Floats
    is_anisotropic: bool

    def pdf(self, d: DirectionPair) -> Array:
        """Return the pdf (...) of `sample` over solid angle."""
        thetas, phis = _HALF_VECTOR_CELLS[self.is_anisotropic]
        x, y = d.wm[..., 0], d.wm[..., 1]
        sin2 = x * x + y * y
        theta = arc_tangent(np.sqrt(sin2), d.wm[..., 2])
        i = np.clip(np.floor(np.sqrt(theta / HALF_PI) * float(thetas)), 0.0, thetas - 1.0)
        low, high = _edge_sin2(i, thetas), _edge_sin2(i + 1.0, thetas)
        # sin^2(theta / 2), in a form that does not cancel for small theta.
        fraction = np.clip((0.5 * sin2 / (1.0 + d.wm[..., 2]) - low) / (high - low), 0.0, 1.0)
        axis_x, axis_y = self._axis(d.wo)
        phi = arc_tangent(axis_x * y - axis_y * x, axis_x * x + axis_y * y)
        j = np.clip(np.floor((phi + np.pi) * (0.5 * phis / np.pi)), 0.0, phis - 1.0)
        view = self._view(d.wo)
        begin, end = look_up(self.density, view, i), look_up(self.density, view, i + 1.0)
        half_vector_density = (begin + fraction * (end - begin)) * look_up(
            self.azimuth_factor, view * float(thetas) + i, j
        )
        cosine_share = self._cosine(view)
        density: Array = (
            cosine_share * (1.0 / np.pi) * d.cos_theta_i
            + (1.0 - cosine_share) * 0.25 * half_vector_density / d.cos_theta_d
        )
        return density

    def sample(self, wo: Array, u1: Array, u2: Array) -> Array:
        """Draw directions to the light (..., 3) for views (..., 3); they may be below the horizon."""
        thetas, phis = _HALF_VECTOR_CELLS[self.is_anisotropic]
        view = self._view(wo)
        cosine_share = self._cosine(view)
        # i and j are the numbers of a cell along theta_h and azimuth, `up` and `around` positions in the cell. s is
        # sin^2(theta_h / 2) of the half vector.
        u = np.clip((u1 - cosine_share) / (1.0 - cosine_share), 0.0, ONE_MINUS_EPSILON)
        i, up = _bisect(self.marginal, view, u)
        j, around = _bisect(self.conditional, view * float(thetas) + i, u2)
        begin, end = look_up(self.density, view, i), look_up(self.density, view, i + 1.0)
        root = np.sqrt(begin * begin + up * (end * end - begin * begin))
        low, high = _edge_sin2(i, thetas), _edge_sin2(i + 1.0, thetas)
        s = low + up * (begin + end) / np.maximum(begin + root, TINY) * (high - low)
        sine, phi = 2.0 * np.sqrt(s * (1.0 - s)), (j + around) * (2.0 * np.pi / phis) - np.pi
        x, y = sine * np.cos(phi), sine * np.sin(phi)
        axis_x, axis_y = self._axis(wo)
        wm = vector(axis_x * x - axis_y * y, axis_y * x + axis_x * y, 1.0 - 2.0 * s)
        cosine_sample = sample_cosine(np.minimum(u1 / cosine_share, ONE_MINUS_EPSILON), u2)
        return np.where(np.expand_dims(u1 < cosine_share, -1), cosine_sample, reflect(wo, wm))

    def _axis(self, wo: Array) -> tuple[Real, Real]:
        """Return x and y of the horizontal unit vector from which the azimuths of half vectors are measured."""
        if self.is_anisotropic:
            return 1.0, 0.0
        x, y = wo[..., 0], wo[..., 1]
        length = np.sqrt(x * x + y * y)
        is_vertical = length < TINY
        divisor = np.where(is_vertical, 1.0, length)
        return np.where(is_vertical, 1.0, x / divisor), np.where(is_vertical, 0.0, y / divisor)

    def _cosine(self, view: Array) -> Array:
        """Return the share of the cosine lobe (...) for cells of views, given by their rows in the tables."""
        return look_up(self.cosine, view, 0.0 * view)

    def _view(self, wo: Array) -> Array:
        """Return the rows (...) of the tables for views (..., 3): the numbers of their cells."""
        thetas, phis = _VIEW_CELLS[self.is_anisotropic]
        x, y = wo[..., 0], wo[..., 1]
        theta = arc_tangent(np.sqrt(x * x + y * y), wo[..., 2])
        row: Array = np.clip(np.floor(theta * (thetas / HALF_PI)), 0.0, thetas - 1.0)
        if not self.is_anisotropic:
            return row
        column: Array = np.clip(np.floor((arc_tangent(y, x) + np.pi) * (0.5 * phis / np.pi)), 0.0, phis - 1.0)
        return row * float(phis) + column


def _bisect(cumulative: NumberTable, row: Array, u: Array) -> tuple[Array, Array]:
    """Return the cells that uniform numbers u in [0, 1) select, and the positions of the numbers in their cells.

    `cumulative` has the cumulative distributions of the cells, one in each row. Positions are in [0, 1).
    """
    count = cumulative.values.shape[1] - 1
    cell: Array = 0.0 * u
    step = count // 2
    while step:
        cell = np.where(look_up(cumulative, row, cell + float(step)) <= u, cell + float(step), cell)
        step //= 2
    begin, end = look_up(cumulative, row, cell), look_up(cumulative, row, cell + 1.0)
    return cell, np.clip((u - begin) / np.maximum(end - begin, TINY), 0.0, ONE_MINUS_EPSILON)


def _edge_sin2(edge: Array, thetas: int) -> Array:
    """Return sin^2(theta_h / 2) at an edge between cells in theta_h, by the number of the edge, 0 to `thetas`."""
    root: Array = np.sin(0.5 * HALF_PI / thetas**2 * edge * edge)
    return root * root


def make_proposal(grid: MeasurementGrid) -> Proposal:
    """Return the sampling tables of measured data."""
    is_anisotropic = isinstance(grid, AnisotropicGrid)
    (thetas, phis), points = _HALF_VECTOR_CELLS[is_anisotropic], _POINTS_PER_CELL[is_anisotropic]
    squares = np.asarray(_edge_sin2(np.arange(thetas + 1.0), thetas))  # sin^2(theta_h / 2) at the edges of cells
    solid_angle = np.diff(squares) * (4.0 * np.pi / phis)  # of a cell, for each cell in theta_h
    half_vectors = _half_vectors(squares[:-1], np.diff(squares), phis, points)
    edges = _half_vectors(squares, 0.0, phis, (1, points[1]))
    density, cell_shares, albedo, cosine = [], [], [], []
    for views in _view_cells(is_anisotropic):
        f, weight = _evaluate_views(grid, views, half_vectors)
        weight *= (solid_angle / prod(points))[:, None, None, None] / len(views)
        color = (f * weight[..., None]).sum(axis=(0, 1, 2, 3, 4))
        # `shares` (thetas, phis) are the numbers of the table, for each cell of half vectors.
        brightness = f.mean(axis=-1)
        # The factor excludes from the tables values that are above the floor only by rounding.
        floor = _quantile(brightness, weight, _FLOOR_FRACTION) * (1.0 + 1e-9)
        shares = (np.maximum(brightness - floor, 0.0) * weight).sum(axis=(0, 2, 4))
        total, least, most = color.mean(), *_COSINE_SHARES
        cosine.append(np.clip(np.pi * floor / total, least, most) if total > 0.0 else most)
        f, weight = _evaluate_views(grid, views, edges)
        at_edges = (np.maximum(f.mean(axis=-1) - floor, 0.0) * weight).mean(axis=(0, 2, 3, 4))
        ring_solid_angle = solid_angle * phis  # of all cells of the same theta_h
        density.append(_edge_density(at_edges, shares.sum(axis=-1) / ring_solid_angle, ring_solid_angle))
        cell_shares.append(
            np.maximum(
                shares, _MIN_NEIGHBOUR_RATIO * np.maximum(np.roll(shares, 1, axis=1), np.roll(shares, -1, axis=1))
            )
        )
        albedo.append(color)
    nodes, conditional = np.stack(density), _cumulative(np.concatenate(cell_shares))
    widths: Floats = np.diff(conditional, axis=-1)
    return Proposal(
        density=NumberTable(nodes),
        azimuth_factor=NumberTable(widths * phis),
        marginal=NumberTable(_cumulative(0.5 * (nodes[:, 1:] + nodes[:, :-1]) * solid_angle)),
        conditional=NumberTable(conditional),
        albedo=np.stack(albedo),
        cosine=NumberTable(np.array(cosine)[:, None]),
        is_anisotropic=is_anisotropic,
    )


def _edge_density(at_edges: Floats, mean: Floats, solid: Floats) -> Floats:
    """Return the density (thetas + 1,) at the edges of cells in theta_h, normalised to the integral 1.

    `at_edges` (thetas + 1,) is the density before it is normalised, `mean` (thetas,) its mean in each cell, and `solid`
    (thetas,) the solid angle of each cell. A value is raised where the mean of a neighbouring cell is much higher.
    """
    neighbours = 0.25 * (np.append(mean, mean[-1]) + np.append(mean[0], mean))
    density = np.maximum(at_edges, neighbours)
    # For a view without a highlight, the density is uniform.
    density = density if density.any() else np.ones_like(density)
    return np.asarray(density / (0.5 * (density[1:] + density[:-1]) * solid).sum())


def _quantile(values: Floats, weights: Floats, part: float) -> float:
    """Return the weighted quantile of values: the values below it have the share `part` of all weights."""
    order = np.argsort(values, axis=None)
    sums = np.cumsum(weights.ravel()[order])
    return float(values.ravel()[order[np.searchsorted(sums, part * sums[-1])]])


def _half_vectors(squares: Floats, sizes: Floats | float, phis: int, points: tuple[int, int]) -> Floats:
    """Return half vectors (thetas, points[0], phis, points[1], 3) in all cells, in equal steps of solid angle.

    `points` are the numbers of half vectors in a cell along theta_h and azimuth. `squares` (thetas,) is
    sin^2(theta_h / 2) at the beginning of each cell, and `sizes` its increase over the cell.
    """
    up, around = ((np.arange(count) + 0.5) / count for count in points)
    s = (squares[:, None] + np.reshape(sizes, (-1, 1)) * up)[..., None, None]
    phi = (np.arange(phis)[:, None] + around) * (2.0 * np.pi / phis) - np.pi
    sine = 2.0 * np.sqrt(s * (1.0 - s))
    x, y = sine * np.cos(phi), sine * np.sin(phi)
    return np.stack([x, y, np.broadcast_to(1.0 - 2.0 * s, x.shape)], axis=-1)


def _view_cells(is_anisotropic: bool) -> Iterator[list[Floats]]:
    """Yield some views (3,) in each cell of views, in the order of the tables' rows."""
    thetas, phis = _VIEW_CELLS[is_anisotropic]
    for row in range(thetas):
        for column in range(phis):
            views = []
            for offset in (0.25, 0.75):
                theta = min((row + offset) * HALF_PI / thetas, np.arccos(_MIN_VIEW_COSINE))
                phi = (column + 1.0 - offset) * 2.0 * np.pi / phis - np.pi if is_anisotropic else 0.0
                views.append(spherical_direction(theta, phi))
            yield views


def _evaluate_views(grid: MeasurementGrid, views: Sequence[Floats], wm: Floats) -> tuple[Floats, Floats]:
    """Return f (views, ..., 3) at half vectors (..., 3), and the cosine times the Jacobian, (views, ...).

    Both are 0 where the light is below the horizon.
    """
    wo = np.stack([np.broadcast_to(view, wm.shape) for view in views])
    wi = np.asarray(reflect(wo, wm))
    valid = (wi[..., 2] > 0.0) & ((wm * wo).sum(axis=-1) > 0.0)
    f, weight = np.zeros(wo.shape), np.zeros(valid.shape)
    d = DirectionPair.from_directions(wo[valid], wi[valid])
    f[valid], weight[valid] = grid.f(d, "linear"), d.cos_theta_i * 4.0 * d.cos_theta_d
    return f, weight


def _cumulative(shares: Floats) -> Floats:
    """Return the cumulative distribution (n, cells + 1) of rows of shares; a row of zeros gives a uniform one."""
    total = shares.sum(axis=-1, keepdims=True)
    normalised = np.where(total > 0.0, shares / np.where(total > 0.0, total, 1.0), 1.0 / shares.shape[-1])
    sums: Floats = np.concatenate([np.zeros((len(shares), 1)), np.cumsum(normalised, axis=-1)], axis=-1)
    # In float32, too, the last cell with a share ends at 1, which no uniform number reaches.
    return np.asarray(sums / sums[:, -1:])
