"""The topology of values at corners, such as UVs: it has a point for each distinct value at a point of the surface.

By OpenSubdiv's rules (its documentation, "Face-Varying Interpolation Rules"), values are refined as the surface is,
with seams between them as boundaries, and the rule determines which values at seams are corners. Values therefore have
half-edges of their own, with the sharpness of the surface's edges and points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Bools, Floats, Indices
from lookdev.asset.mesh import FaceVaryingRule
from lookdev.asset.subdivision.cage import Cage
from lookdev.asset.subdivision.topology import Joints, Level, connect

_DEPENDENT: tuple[FaceVaryingRule, ...] = ("cornersPlus1", "cornersPlus2")


def weld(points: Indices, values: Floats, count: int) -> tuple[Indices, Indices]:
    """Return the number of the value (m,) of each corner, and the point (v,) of each value.

    points (m,) < `count` and values (m, k) are those of the corners. Equal values of one point become one value. The
    first value of each point has the number of the point.
    """
    first_values = np.zeros((count, values.shape[1]))
    first_values[points] = values
    other = np.flatnonzero((values != first_values[points]).any(axis=1))
    numbers = points.copy()
    if len(other) == 0:
        return numbers, np.arange(count)
    rows = np.column_stack([points[other], values[other]])
    _, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    numbers[other] = count + number.ravel()
    return numbers, np.concatenate([np.arange(count), points[other][first]])


def value_level(cage: Cage, values: Indices, value_points: Indices, rule: FaceVaryingRule) -> Level:
    """Return the half-edges of values, from their numbers (m,) at corners and their points (v,), as from `weld`."""
    surface = cage.level
    level, joints = connect(values, surface.sizes, len(value_points))
    value_sharpness, surface_sharpness = level.edge_sharpness[level.edges], surface.edge_sharpness[surface.edges]
    level.edge_sharpness[level.edges] = np.maximum(value_sharpness, surface_sharpness)
    sharpness = surface.point_sharpness[value_points]
    spans = _find_spans(level, joints, surface)
    at_seam = _at_seams(level, surface)[value_points]
    siblings = np.bincount(value_points[spans.used], minlength=len(surface.point_sharpness))[value_points]

    sharp = at_seam & ((spans.fans > 1) | ~cage.manifold[value_points])
    if rule != "none":
        sharp |= spans.faces == 1
    if rule in _DEPENDENT:
        is_divided = spans.used & ((spans.fans > 1) | (spans.sharp > 0))
        sharp |= at_seam & ((siblings > 2) | ((siblings == 2) & _shares_point(is_divided, value_points)))
    if rule == "cornersPlus2":
        sharp |= (siblings == 2) & _shares_point(spans.faces == 1, value_points)
    on_boundary = np.zeros(len(surface.point_sharpness), bool)
    on_boundary[surface.ends[surface.boundary]] = True
    if rule in ("cornersPlus2", "boundaries"):
        sharp |= at_seam & (siblings == 1) & ~on_boundary[value_points]
    if rule == "boundaries":
        sharp |= at_seam | on_boundary[value_points]
    if rule in _DEPENDENT:
        is_pair = at_seam & (siblings == 2) & (sharpness == 0.0)
        sharpness = np.where(is_pair, _dependent_sharpness(spans, value_points), sharpness)
    level.point_sharpness[:] = np.where(sharp, np.inf, sharpness)
    return level


@dataclass(frozen=True, eq=False)
class _Spans:
    """The faces that have each value (v,): whether any has it, their number, and the number of their fans.

    `sharp` is the number of infinitely sharp edges between the faces; `soft` is the sharpness of a corner that decays
    as the semi-sharp edges between them do.
    """

    used: Bools
    faces: Indices
    fans: Indices
    sharp: Indices
    soft: Floats


def _find_spans(level: Level, joints: Joints, surface: Level) -> _Spans:
    count = len(level.point_sharpness)
    faces = np.bincount(level.points, minlength=count)
    inner = level.twins >= 0
    ends, sharpness = level.points[inner], surface.edge_sharpness[surface.edges[inner]]
    semi = (sharpness > 0.0) & np.isfinite(sharpness)
    sharp = np.bincount(ends[np.isinf(sharpness)], minlength=count)
    # The edges that decay last do so together; the corner's weight is then the mean of their remaining sharpness.
    last = np.zeros(count)
    np.maximum.at(last, ends[semi], np.ceil(sharpness[semi]))
    final = semi & (np.ceil(sharpness) == last[ends])
    total = np.bincount(ends[final], sharpness[final], count)
    soft = total / np.maximum(np.bincount(ends[final], minlength=count), 1)
    return _Spans(faces > 0, faces, joints.fans, sharp, soft)


def _at_seams(level: Level, surface: Level) -> Bools:
    """Return which points (n,) of the surface are ends of a seam."""
    seams = (level.twins < 0) & (surface.twins >= 0)
    seams |= _twisted_seams(level, surface)
    at_seams = np.zeros(len(surface.point_sharpness), bool)
    at_seams[surface.ends[surface.edges[seams]]] = True
    return at_seams


def _twisted_seams(level: Level, surface: Level) -> Bools:
    """Return which half-edges (m,) are on edges of three or more faces with different values."""
    first = np.empty(len(surface.ends), np.intp)
    first[surface.edges] = level.edges
    differs = np.zeros(len(surface.ends), bool)
    differs[surface.edges[level.edges != first[surface.edges]]] = True
    return differs[surface.edges]


def _shares_point(is_marked: Bools, value_points: Indices) -> Bools:
    """Return which values (v,) have a marked value at their point."""
    points = np.zeros(int(value_points.max()) + 1, bool)
    points[value_points[is_marked]] = True
    return points[value_points]


def _dependent_sharpness(spans: _Spans, value_points: Indices) -> Floats:
    """Return the sharpness (v,) of values without semi-sharp edges from the other value at their point, else 0."""
    highest = np.zeros(int(value_points.max()) + 1)
    np.maximum.at(highest, value_points, spans.soft)
    return np.where(spans.soft > 0.0, 0.0, highest[value_points])
