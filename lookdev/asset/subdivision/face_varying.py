"""Values at corners, such as UVs, as a topology of their own: one point for each value that a point has.

By OpenSubdiv's rules (its documentation, "Face-Varying Interpolation Rules"), values are refined as the surface is,
with the seams between them as boundaries, and the rule decides which values at seams are corners. So they have
half-edges of their own, with the sharpness of the surface's edges and points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.asset.mesh import FaceVaryingRule
from lookdev.asset.subdivision.cage import Cage
from lookdev.asset.subdivision.topology import Doubles, Flags, Index, Joints, Level, connect

_DEPENDENT: tuple[FaceVaryingRule, ...] = ("cornersPlus1", "cornersPlus2")


def weld(points: Index, values: Doubles, count: int) -> tuple[Index, Index]:
    """Return the value (m,) of each corner and the point (v,) of each value, the first of each point by its number.

    points (m,) < `count` and values (m, k) of the corners. Values of one point that are equal are one.
    """
    some = np.zeros((count, values.shape[1]))
    some[points] = values
    other = np.flatnonzero((values != some[points]).any(axis=1))
    numbers = points.copy()
    if len(other) == 0:
        return numbers, np.arange(count)
    rows = np.column_stack([points[other], values[other]])
    _, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    numbers[other] = count + number.ravel()
    return numbers, np.concatenate([np.arange(count), points[other][first]])


def value_level(cage: Cage, values: Index, of_value: Index, rule: FaceVaryingRule) -> Level:
    """Return the half-edges of values: their numbers (m,) at corners and their points (v,), as `weld` returns them."""
    surface = cage.level
    level, joints = connect(values, surface.sizes, len(of_value))
    own, of_surface = level.edge_sharpness[level.edges], surface.edge_sharpness[surface.edges]
    level.edge_sharpness[level.edges] = np.maximum(own, of_surface)
    sharpness = surface.point_sharpness[of_value]
    spans = _spans(level, joints, surface)
    seam = _at_seams(level, surface)[of_value]
    siblings = np.bincount(of_value[spans.used], minlength=len(surface.point_sharpness))[of_value]

    sharp = seam & ((spans.fans > 1) | ~cage.manifold[of_value])
    if rule != "none":
        sharp |= spans.faces == 1
    if rule in _DEPENDENT:
        broken = spans.used & ((spans.fans > 1) | (spans.sharp > 0))
        sharp |= seam & ((siblings > 2) | ((siblings == 2) & _at_point(broken, of_value)))
    if rule == "cornersPlus2":
        sharp |= (siblings == 2) & _at_point(spans.faces == 1, of_value)
    on_boundary = np.zeros(len(surface.point_sharpness), bool)
    on_boundary[surface.ends[surface.boundary]] = True
    if rule in ("cornersPlus2", "boundaries"):
        sharp |= seam & (siblings == 1) & ~on_boundary[of_value]
    if rule == "boundaries":
        sharp |= seam | on_boundary[of_value]
    if rule in _DEPENDENT:
        pair = seam & (siblings == 2) & (sharpness == 0.0)
        sharpness = np.where(pair, _depending(spans, of_value), sharpness)
    level.point_sharpness[:] = np.where(sharp, np.inf, sharpness)
    return level


@dataclass(frozen=True, eq=False)
class _Spans:
    """The faces that have each value (v,): whether there are any, how many, and in how many fans.

    `sharp` is the number of infinitely sharp edges between them; `soft` the sharpness of a corner that
    fades as the semi-sharp ones do.
    """

    used: Flags
    faces: Index
    fans: Index
    sharp: Index
    soft: Doubles


def _spans(level: Level, joints: Joints, surface: Level) -> _Spans:
    count = len(level.point_sharpness)
    faces = np.bincount(level.points, minlength=count)
    inner = level.twins >= 0
    ends, sharpness = level.points[inner], surface.edge_sharpness[surface.edges[inner]]
    semi = (sharpness > 0.0) & np.isfinite(sharpness)
    sharp = np.bincount(ends[np.isinf(sharpness)], minlength=count)
    # Those that fade last do so together; the corner's weight is then the mean of what is left of them.
    last = np.zeros(count)
    np.maximum.at(last, ends[semi], np.ceil(sharpness[semi]))
    final = semi & (np.ceil(sharpness) == last[ends])
    total = np.bincount(ends[final], sharpness[final], count)
    soft = total / np.maximum(np.bincount(ends[final], minlength=count), 1)
    return _Spans(faces > 0, faces, joints.fans, sharp, soft)


def _at_seams(level: Level, surface: Level) -> Flags:
    """Return which points (n,) of the surface are ends of an edge that is a seam."""
    seams = (level.twins < 0) & (surface.twins >= 0)
    seams |= _twisted_seams(level, surface)
    at_seams = np.zeros(len(surface.point_sharpness), bool)
    at_seams[surface.ends[surface.edges[seams]]] = True
    return at_seams


def _twisted_seams(level: Level, surface: Level) -> Flags:
    """Return the half-edges (m,) of edges of three or more faces whose values are not all the same."""
    first = np.empty(len(surface.ends), np.intp)
    first[surface.edges] = level.edges
    differs = np.zeros(len(surface.ends), bool)
    differs[surface.edges[level.edges != first[surface.edges]]] = True
    return differs[surface.edges]


def _at_point(marked: Flags, of_value: Index) -> Flags:
    """Return for each value whether a value of its point is marked."""
    points = np.zeros(int(of_value.max()) + 1, bool)
    points[of_value[marked]] = True
    return points[of_value]


def _depending(spans: _Spans, of_value: Index) -> Doubles:
    """Return the sharpness of each value, of two at a point, that has no semi-sharp edge where the other has one."""
    highest = np.zeros(int(of_value.max()) + 1)
    np.maximum.at(highest, of_value, spans.soft)
    return np.where(spans.soft > 0.0, 0.0, highest[of_value])
