"""Computes the points of the next level, by the masks of Catmull and Clark (1978) and of Loop (1987).

Creases and corners can be sharp or semi-sharp. They follow DeRose, Kass and Truong, "Subdivision Surfaces in Character
Animation" (1998), section 3, in the form that OpenSubdiv documents. A point is a corner if it is sharp or if more than
two sharp edges meet at it; it is on a crease if exactly two meet; otherwise it is smooth. Sharpness falls by 1 at each
level. If the kind of a point thereby changes, such as from a corner to a smooth point, the masks of both kinds are
blended.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Bools, Floats, Indices
from lookdev.asset.mesh import Scheme
from lookdev.asset.normals import run_starts, sum_by
from lookdev.asset.subdivision.topology import HalfEdges

_TRIANGLE_WEIGHT = 0.470
"""The weight of a triangle's centroid in an edge's new point with USD's triangle rule `smooth`; normally it is 1/4."""


@dataclass(frozen=True)
class Rules:
    """The rules that determine masks: the scheme, and the triangle rule.

    With `smooth_triangles`, which only the scheme catmullClark has, triangles have the weight `_TRIANGLE_WEIGHT` in the
    new points of their edges.
    """

    scheme: Scheme
    smooth_triangles: bool = False

    @property
    def triangles(self) -> bool:
        """Whether faces are split into triangles; otherwise they are split into quads."""
        return self.scheme == "loop"


def interpolate(level: HalfEdges, values: Floats, rules: Rules) -> Floats:
    """Return the values (n', k) at the points of the next level, from the values (n, k) at the points of `level`.

    The points of the next level are the old points, then a point for each edge and, except with the scheme loop, a
    point for each face.
    """
    ends = values[level.ends[:, 0]], values[level.ends[:, 1]]
    edge_points = 0.5 * (ends[0] + ends[1])
    if rules.scheme == "loop":
        _smooth_loop_edges(level, values, edge_points)
        return np.concatenate([_refine_points(level, values, values[level.points[level.next]], rules), edge_points])
    means = np.add.reduceat(values[level.points], run_starts(level.sizes), axis=0) / level.sizes[:, None]
    if rules.scheme == "bilinear":
        return np.concatenate([values, edge_points, means])
    _smooth_edges(level, means, edge_points, rules)
    around = values[level.points[level.next]] + means[level.faces]
    return np.concatenate([_refine_points(level, values, around, rules), edge_points, means])


def _soft_edges(level: HalfEdges) -> tuple[Indices, Indices, Floats]:
    """Return the edges (k,) of sharpness below 1, one half-edge (k,) of each, and their sharpness (k, 1).

    These edges have two faces, since boundaries and edges of more faces are infinitely sharp.
    """
    edges = np.flatnonzero(level.edge_sharpness < 1.0)
    half_edges = np.zeros(len(level.ends), np.intp)
    half_edges[level.edges] = np.arange(len(level.edges))
    return edges, half_edges[edges], level.edge_sharpness[edges, None]


def _smooth_edges(level: HalfEdges, means: Floats, edge_points: Floats, rules: Rules) -> None:
    """Replace the edges' middles in `edge_points` (e, k) by new points where an edge's sharpness is below 1.

    A smooth edge's point is the mean of its ends and of both faces' centroids, `means` (f, k) (Catmull and Clark 1978).
    With a sharpness between 0 and 1, the point is interpolated between this mean and the edge's middle.
    """
    edges, half_edges, sharpness = _soft_edges(level)
    a, b = level.faces[half_edges], level.faces[level.twins[half_edges]]
    weight: Floats | float = 0.25
    if rules.smooth_triangles:
        face_weight = np.where(level.sizes == 3, _TRIANGLE_WEIGHT, 0.25)
        weight = 0.5 * (face_weight[a] + face_weight[b])[:, None]
    smooth = (1.0 - 2.0 * weight) * edge_points[edges] + weight * (means[a] + means[b])
    edge_points[edges] = sharpness * edge_points[edges] + (1.0 - sharpness) * smooth


def _smooth_loop_edges(level: HalfEdges, values: Floats, edge_points: Floats) -> None:
    """Replace the edges' middles in `edge_points` (e, k) by new points where an edge's sharpness is below 1.

    A smooth edge's point has weights of 3/8 for both ends and 1/8 for both opposite points (Loop 1987). With a
    sharpness between 0 and 1, the new point is interpolated between this point and the edge's middle.
    """
    edges, half_edges, sharpness = _soft_edges(level)
    opposite = level.points[level.previous]
    across = values[opposite[half_edges]] + values[opposite[level.twins[half_edges]]]
    smooth = 0.75 * edge_points[edges] + 0.125 * across
    edge_points[edges] = sharpness * edge_points[edges] + (1.0 - sharpness) * smooth


def _refine_points(level: HalfEdges, values: Floats, around: Floats, rules: Rules) -> Floats:
    """Return the values (n, k) of the old points at the next level.

    `around` (m, k) has a term for each corner. The new value of a smooth point contains the sum of the terms of the
    corners at the point.
    """
    is_corner, is_crease = _corners_and_creases(level, 0.0)
    # At the next level, sharpness is less by 1: features that are now sharper than 1 are then still sharp.
    stays_corner, becomes_crease = _corners_and_creases(level, 1.0)
    present_weight = np.where(
        (is_corner == stays_corner) & (is_crease == becomes_crease), 1.0, _transition_weights(level)
    )
    # The weights (n,) of the masks of a corner, of a crease and of a smooth point.
    corner = present_weight * is_corner + (1.0 - present_weight) * stays_corner
    crease = present_weight * is_crease + (1.0 - present_weight) * becomes_crease
    smooth = 1.0 - corner - crease
    point_weight, ring_weight = smooth_weights(np.bincount(level.points, minlength=len(values)), rules)
    result: Floats = (corner + 0.75 * crease + smooth * point_weight)[:, None] * values
    result += (smooth * ring_weight)[:, None] * sum_by(level.points, around, len(values))
    # Add the other ends of the two edges of a crease. These are the sharp edges, or, at a point that is on a crease
    # only at the next level, the edges that stay sharp.
    threshold = np.where(is_crease, 0.0, 1.0)
    for this, other in (level.ends.T, level.ends.T[::-1]):
        edges = np.flatnonzero((level.edge_sharpness > threshold[this]) & (crease[this] > 0.0))
        if len(edges):
            point = this[edges]
            result += sum_by(point, 0.125 * crease[point, None] * values[other[edges]], len(values))
    return result


def _corners_and_creases(level: HalfEdges, above: float) -> tuple[Bools, Bools]:
    """Return which points (n,) are corners and which are on creases; sharpness up to `above` counts as smooth."""
    edges = level.sharp_edges(above)
    corner = (level.point_sharpness > above) | (edges > 2)
    return corner, (edges == 2) & ~corner


def _transition_weights(level: HalfEdges) -> Floats:
    """Return the weight (n,) of a point's present mask if it has another mask at the next level.

    The sharpness of the point and of its edges falls to 0 at the next level if it is at most 1. The weight is the mean
    of those values that are above 0 and fall to 0.
    """
    is_fading_edge = (level.edge_sharpness > 0.0) & (level.edge_sharpness <= 1.0)
    ends, sharpness = level.ends[is_fading_edge].ravel(), np.repeat(level.edge_sharpness[is_fading_edge], 2)
    is_fading_point = (level.point_sharpness > 0.0) & (level.point_sharpness <= 1.0)
    count = len(level.point_sharpness)
    total = np.bincount(ends, sharpness, count) + np.where(is_fading_point, level.point_sharpness, 0.0)
    return np.asarray(total / np.maximum(np.bincount(ends, minlength=count) + is_fading_point, 1))


def smooth_weights(valence: Indices, rules: Rules) -> tuple[Floats, Floats]:
    """Return, for smooth points, the weight (n,) of the old value in the new one, and the weight (n,) of each term.

    `valence` (n,) is the number of faces around each point. The terms are the `around` of `_refine_points`.
    """
    n = np.maximum(valence, 1).astype(np.float64)
    if rules.scheme == "loop":
        # Loop 1987, in the form of Warren: (5/8 - (3/8 + cos(2 pi / n) / 4)^2) / n.
        ring = (0.625 - (0.375 + 0.25 * np.cos(2.0 * np.pi / n)) ** 2) / n
        return 1.0 - n * ring, ring
    return (n - 2.0) / n, 1.0 / n**2
