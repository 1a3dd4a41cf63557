"""Evaluates the curves of UsdGeom.BasisCurves and NurbsCurves: points and derivatives as weighted sums of vertices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Floats, Indices, Reals
from lookdev.asset.normals import run_starts
from lookdev.errors import AssetError

# The weight of each vertex of a segment is a polynomial in t, the parameter from 0 to 1 in the segment. Rows: the
# coefficients of t^3, t^2, t and 1. Columns: the vertices of the segment.
BASES = {
    "linear": np.array([[0, 0], [0, 0], [-1, 1], [1, 0]]),
    "bezier": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]]),
    "bspline": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]]) / 6,
    "catmullRom": np.array([[-1, 3, -3, 1], [2, -5, 4, -1], [-1, 0, 1, 0], [0, 2, 0, 0]]) / 2,
}
WRAPS = ("nonperiodic", "periodic", "pinned")


@dataclass(frozen=True, eq=False)
class Splines:
    """Several curves, each of which is a chain of smooth segments.

    `vertex_counts` and `segment_counts` (c,) are the numbers of vertices and segments of each curve. Vertices and
    segments are numbered through all curves.

    `evaluate(segments, t)` evaluates r samples. `segments` (r,) is the segment of each sample, sorted, and `t` (r,) is
    the sample's parameter in this segment, from 0 to 1. The function returns three arrays (r, k) for the k vertices
    that determine a sample: the vertices' indices, weights and rates. A sample's value is the sum of the vertices'
    values times the weights. Its derivative by t is the sum of the vertices' values times the rates.

    The curves are all closed if `periodic`. If `pinned`, each curve has a phantom vertex before its first vertex and
    one after its last. The indices of phantom vertices follow the indices of all vertices: first the phantoms before
    the curves, then the phantoms after the curves. `varying` is False if USD does not define the interpolation
    `varying` for the curves.
    """

    vertex_counts: Indices
    segment_counts: Indices
    evaluate: Callable[[Indices, Floats], tuple[Indices, Floats, Floats]]
    periodic: bool = False
    pinned: bool = False
    varying: bool = True

    def with_phantoms(self, values: Reals) -> Reals:
        """Return the values (n, ...) of the vertices, followed by the values of the phantom vertices.

        Phantom values are extrapolated linearly, as UsdGeom defines.
        """
        if not self.pinned:
            return values
        first = run_starts(self.vertex_counts)
        last = first + self.vertex_counts - 1
        before, after = 2 * values[first] - values[first + 1], 2 * values[last] - values[last - 1]
        return np.asarray(np.concatenate([values, before, after]))


def basis_splines(basis: str, wrap: str, counts: Indices, where: str) -> Splines:
    """Return curves of a basis in `BASES` and a wrap in `WRAPS`, from their numbers of vertices, `counts` (c,).

    An error message names the curves by the prim path `where`.

    Raises
    ------
    AssetError
        The vertices of a curve do not make whole segments.
    """
    is_linear, periodic = basis == "linear", wrap == "periodic"
    step = 3 if basis == "bezier" else 1  # the vertices from the start of one segment to the start of the next
    pinned = wrap == "pinned" and basis in ("bspline", "catmullRom")
    fewest = 3 if periodic else 2 if is_linear or pinned else 4
    wrong = (counts < fewest) | ((counts - fewest) % step != 0)
    if wrong.any():
        curve = int(wrong.argmax())
        rule = f"{fewest} or more" if step == 1 else ", ".join(str(fewest + i * step) for i in range(3)) + ", ..."
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
        """Evaluate samples, as `Splines` describes."""
        # `local` is the number of each vertex in its curve. The phantom vertices before and after the curve have the
        # numbers -1 and `counts`.
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
    """Return NURBS curves from the numbers of their vertices, `counts` (c,), their orders (c,) and all their knots.

    `ranges` (c, 2) restrict the parameters of the curves, and `weights` (n,) are the weights of the vertices; each of
    the two may be empty. A segment lies between two consecutive different knots. An error message names the curves by
    the prim path `where`.

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
    # For each curve, the parameters at the ends of its segments.
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
        """Evaluate samples, as `Splines` describes."""
        low, high = lows[segments], highs[segments]
        # The end of a segment is evaluated just before its knot, because the curve can have a corner at the knot.
        parameters = np.minimum(low + t * (high - low), np.nextafter(high, low))
        index = np.zeros((len(t), width), np.intp)
        values, rates = np.zeros((2, len(t), width))
        # The samples of each curve are consecutive; SciPy evaluates them together.
        present, starts = np.unique(curves[segments], return_index=True)
        for curve, start, stop in zip(present, starts, np.append(starts[1:], len(t)), strict=True):
            rows, order = slice(start, stop), int(orders[curve])
            own_knots, u = curve_knots[curve], parameters[rows]
            basis = BSpline.design_matrix(u, own_knots, order - 1)
            vertices = basis.indices.reshape(-1, order)
            value = basis.data.reshape(-1, order)
            lower = BSpline.design_matrix(u, own_knots, order - 2).data.reshape(-1, order - 1)
            # de Boor: B'_j = p (B_j / (u_j+p - u_j) - B_j+1 / (u_j+p+1 - u_j+1)). B'_j is the derivative of basis
            # function j of degree p = order - 1; the B on the right have degree p - 1, and the u_j are the knots.
            part = (order - 1) * lower / (own_knots[vertices[:, 1:] + order - 1] - own_knots[vertices[:, 1:]])
            rate = np.pad(part, ((0, 0), (1, 0))) - np.pad(part, ((0, 0), (0, 1)))
            if len(weights):
                # The rational basis, weight * B over its sum, and its derivative by the quotient rule.
                weight = weights[first[curve] + vertices]
                value, rate = value * weight, rate * weight
                total, change = value.sum(axis=1, keepdims=True), rate.sum(axis=1, keepdims=True)
                value, rate = value / total, (rate - value * change / total) / total
            index[rows, :order], values[rows, :order], rates[rows, :order] = first[curve] + vertices, value, rate
        return index, values, rates * (high - low)[:, None]

    return Splines(counts, segment_counts, evaluate, varying=False)
