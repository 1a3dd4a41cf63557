"""Curves in the bases of UsdGeom.BasisCurves, and NURBS curves, as weights of their vertices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Floats, Indices, Reals
from lookdev.asset.normals import run_starts
from lookdev.errors import AssetError

# Rows: the coefficients of t^3, t^2, t and 1; columns: the vertices of a segment.
BASES = {
    "linear": np.array([[0, 0], [0, 0], [-1, 1], [1, 0]]),
    "bezier": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]]),
    "bspline": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]]) / 6,
    "catmullRom": np.array([[-1, 3, -3, 1], [2, -5, 4, -1], [-1, 0, 1, 0], [0, 2, 0, 0]]) / 2,
}
WRAPS = ("nonperiodic", "periodic", "pinned")


@dataclass(frozen=True, eq=False)
class Splines:
    """Curves (c,) of smooth segments between vertices.

    `evaluate(segments, t)` takes samples (r,), sorted by segment, at t in 0..1 of their segments, and returns vertex
    indices, weights and rates (r, k). A sample's value is the sum of the vertices' values times the weights; its
    derivative by t is the sum with the rates. With `pinned` ends, phantom vertices follow the others: first those
    before each curve, then those after each. `varying` is False if interpolation `varying` is not defined for the
    curves.
    """

    vertex_counts: Indices
    segment_counts: Indices
    evaluate: Callable[[Indices, Floats], tuple[Indices, Floats, Floats]]
    periodic: bool = False
    pinned: bool = False
    varying: bool = True

    def with_phantoms(self, values: Reals) -> Reals:
        """Return the values (n, ...) of the vertices and of the phantom vertices, which UsdGeom extrapolates."""
        if not self.pinned:
            return values
        first = run_starts(self.vertex_counts)
        last = first + self.vertex_counts - 1
        before, after = 2 * values[first] - values[first + 1], 2 * values[last] - values[last - 1]
        return np.asarray(np.concatenate([values, before, after]))


def basis_splines(basis: str, wrap: str, counts: Indices, where: str) -> Splines:
    """Return curves of a basis in `BASES` and a wrap in `WRAPS`, with the given numbers of vertices (c,).

    Raises
    ------
    AssetError
        The vertices of a curve do not make whole segments.
    """
    is_linear, periodic = basis == "linear", wrap == "periodic"
    step = 3 if basis == "bezier" else 1
    pinned = wrap == "pinned" and basis in ("bspline", "catmullRom")
    fewest = 3 if periodic else 2 if is_linear or pinned else 4
    wrong = (counts < fewest) | ((counts - fewest) % step != 0)
    if wrong.any():
        curve = int(wrong.argmax())
        rule = f"at least {fewest}" + (f", or {fewest} and a multiple of {step} more" if step > 1 else "")
        raise AssetError(
            f"{where}: curveVertexCounts[{curve}] is {counts[curve]}; a {wrap} {basis} curve has {rule} vertices"
        )
    segment_counts = counts // step if periodic else (counts - fewest) // step + 1
    # The curve of each segment, and the segment's number in it.
    curves = np.repeat(np.arange(len(counts)), segment_counts)
    numbers = np.arange(len(curves)) - run_starts(segment_counts)[curves]
    first, total = run_starts(counts), int(counts.sum())
    matrix = BASES[basis]

    def evaluate(segments: Indices, t: Floats) -> tuple[Indices, Floats, Floats]:
        curve = curves[segments][:, None]
        local: Indices = numbers[segments][:, None] * step + np.arange(matrix.shape[1]) - pinned
        if periodic:
            local = local % counts[curve]
        index = first[curve] + local
        index = np.where(local < 0, total + curve, index)
        index = np.where(local >= counts[curve], total + len(counts) + curve, index)
        ones = np.ones_like(t)
        powers = np.stack([t**3, t**2, t, ones], axis=-1)
        slopes = np.stack([3.0 * t**2, 2.0 * t, ones, 0.0 * t], axis=-1)
        return index, powers @ matrix, slopes @ matrix

    return Splines(counts, segment_counts, evaluate, periodic, pinned)


def nurbs_splines(
    counts: Indices, orders: Indices, knots: Floats, ranges: Floats, weights: Floats, where: str
) -> Splines:
    """Return NURBS curves with the given numbers of vertices (c,), orders (c,) and concatenated knots.

    `ranges` (c, 2) restrict the curves' parameters, `weights` (n,) are those of the vertices; both may be empty. A
    segment lies between two consecutive different knots.

    Raises
    ------
    AssetError
        Counts do not agree, an order or a weight is out of its range, knots decrease or a range is empty.
    """
    from scipy.interpolate import BSpline  # the import takes a third of a second, and few files need it

    if len(orders) != len(counts) or (orders < 2).any() or (orders > counts).any():
        raise AssetError(f"{where}: order must be 2 or more and at most the curve's vertices, once for each curve")
    if len(knots) != (counts + orders).sum():
        raise AssetError(f"{where}: there are {len(knots)} knots; vertices and orders need {(counts + orders).sum()}")
    if len(ranges) not in (0, len(counts)):
        raise AssetError(f"{where}: there are {len(ranges)} ranges, but {len(counts)} curves")
    if len(weights) not in (0, counts.sum()) or (weights <= 0.0).any():
        raise AssetError(f"{where}: pointWeights must be positive numbers, one for each of {counts.sum()} points")
    first = run_starts(counts)
    spans: list[Floats] = []
    curve_knots = np.split(knots, np.cumsum(counts + orders)[:-1])
    for curve, own_knots in enumerate(curve_knots):
        low, high = own_knots[orders[curve] - 1], own_knots[counts[curve]]
        if len(ranges):
            low, high = max(low, ranges[curve, 0]), min(high, ranges[curve, 1])
        if (np.diff(own_knots) < 0.0).any() or low >= high:
            raise AssetError(f"{where}: knots of curve {curve} must grow and leave a range between them")
        spans.append(np.unique(np.concatenate([[low], own_knots[(own_knots > low) & (own_knots < high)], [high]])))
    segment_counts = np.array([len(span) - 1 for span in spans], np.intp)
    curves = np.repeat(np.arange(len(counts)), segment_counts)
    lows = np.concatenate([span[:-1] for span in spans])
    highs = np.concatenate([span[1:] for span in spans])
    width = int(orders.max())

    def evaluate(segments: Indices, t: Floats) -> tuple[Indices, Floats, Floats]:
        low, high = lows[segments], highs[segments]
        # A segment's end is evaluated from its own side: a knot can be a corner.
        parameters = np.minimum(low + t * (high - low), np.nextafter(high, low))
        index = np.zeros((len(t), width), np.intp)
        values, rates = np.zeros((2, len(t), width))
        present, starts = np.unique(curves[segments], return_index=True)
        for curve, start, stop in zip(present, starts, np.append(starts[1:], len(t)), strict=True):
            rows, order = slice(start, stop), int(orders[curve])
            own_knots, u = curve_knots[curve], parameters[rows]
            basis = BSpline.design_matrix(u, own_knots, order - 1)
            vertices = basis.indices.reshape(-1, order)
            value = basis.data.reshape(-1, order)
            lower = BSpline.design_matrix(u, own_knots, order - 2).data.reshape(-1, order - 1)
            # de Boor: B'_j = p (B_j / (u_j+p - u_j) - B_j+1 / (u_j+p+1 - u_j+1)), with the B of degree p - 1.
            part = (order - 1) * lower / (own_knots[vertices[:, 1:] + order - 1] - own_knots[vertices[:, 1:]])
            rate = np.pad(part, ((0, 0), (1, 0))) - np.pad(part, ((0, 0), (0, 1)))
            if len(weights):
                weight = weights[first[curve] + vertices]
                value, rate = value * weight, rate * weight
                total, change = value.sum(axis=1, keepdims=True), rate.sum(axis=1, keepdims=True)
                value, rate = value / total, (rate - value * change / total) / total
            index[rows, :order], values[rows, :order], rates[rows, :order] = first[curve] + vertices, value, rate
        return index, values, rates * (high - low)[:, None]

    return Splines(counts, segment_counts, evaluate, varying=False)
