"""Builds half-edges for face-varying values, such as UVs, which can differ between the faces at a point.

In these half-edges, each distinct value at a point of the surface is a point. By OpenSubdiv's rules (its documentation,
"Face-Varying Interpolation Rules"), values are refined as the surface is. A seam, where the values on both sides of an
edge differ, is a boundary. USD's rule (`FaceVaryingRule`) determines which values at seams are sharp corners. Values
therefore have half-edges of their own, with the sharpness of the surface's edges and points.

There are v values, and n points of the surface. `level` is the half-edges of the values, and `surface` the half-edges
of the surface; both have the same corners (m,).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Bools, Floats, Indices
from lookdev.asset.mesh import FaceVaryingRule
from lookdev.asset.subdivision.cage import Cage
from lookdev.asset.subdivision.topology import Connectivity, HalfEdges, connect

_CORNERS_PLUS_RULES: tuple[FaceVaryingRule, ...] = ("cornersPlus1", "cornersPlus2")


def weld(points: Indices, values: Floats, count: int) -> tuple[Indices, Indices]:
    """Return the number (m,) of the value at each corner, and the point (v,) of each value.

    `points` (m,) and `values` (m, k) are the point and the value at each corner; points are numbers below `count`.
    Equal values at one point become one value. One value of each point has the number of the point; further values have
    numbers from `count` on.
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


def connect_values(cage: Cage, value_numbers: Indices, value_points: Indices, rule: FaceVaryingRule) -> HalfEdges:
    """Return the half-edges of values by a rule; `value_numbers` (m,) and `value_points` (v,) are `weld`'s results."""
    surface = cage.half_edges
    level, connectivity = connect(value_numbers, surface.sizes, len(value_points))
    value_sharpness, surface_sharpness = level.edge_sharpness[level.edges], surface.edge_sharpness[surface.edges]
    level.edge_sharpness[level.edges] = np.maximum(value_sharpness, surface_sharpness)
    sharpness = surface.point_sharpness[value_points]
    fans = _find_fans(level, connectivity, surface)
    at_seam = _seam_points(level, surface)[value_points]
    # `siblings` (v,) is the number of values at the point of each value.
    siblings = np.bincount(value_points[fans.is_used], minlength=len(surface.point_sharpness))[value_points]

    # Marks values that become infinitely sharp corners.
    is_corner_value = at_seam & ((fans.fan_count > 1) | ~cage.is_manifold[value_points])
    if rule != "none":
        is_corner_value |= fans.face_count == 1
    if rule in _CORNERS_PLUS_RULES:
        is_divided = fans.is_used & ((fans.fan_count > 1) | (fans.sharp_edge_count > 0))
        is_corner_value |= at_seam & ((siblings > 2) | ((siblings == 2) & _shares_point(is_divided, value_points)))
    if rule == "cornersPlus2":
        is_corner_value |= (siblings == 2) & _shares_point(fans.face_count == 1, value_points)
    on_boundary = np.zeros(len(surface.point_sharpness), bool)
    on_boundary[surface.ends[surface.boundary]] = True
    # A seam ends at an inner point that has a single value.
    if rule in ("cornersPlus2", "boundaries"):
        is_corner_value |= at_seam & (siblings == 1) & ~on_boundary[value_points]
    if rule == "boundaries":
        is_corner_value |= at_seam | on_boundary[value_points]
    if rule in _CORNERS_PLUS_RULES:
        is_pair = at_seam & (siblings == 2) & (sharpness == 0.0)
        sharpness = np.where(is_pair, _dependent_sharpness(fans, value_points), sharpness)
    level.point_sharpness[:] = np.where(is_corner_value, np.inf, sharpness)
    return level


@dataclass(frozen=True, eq=False)
class _ValueFans:
    """The faces around each value, which are the faces with the value at a corner. All arrays are (v,).

    - is_used: whether there are any such faces
    - face_count: the number of these faces
    - fan_count: the number of fans that they form; the faces of a fan are connected by edges
    - sharp_edge_count: the number of infinitely sharp edges between the faces
    - corner_sharpness: the sharpness of a corner that becomes smooth together with the semi-sharp edges between the
      faces; 0 without such edges
    """

    is_used: Bools
    face_count: Indices
    fan_count: Indices
    sharp_edge_count: Indices
    corner_sharpness: Floats


def _find_fans(level: HalfEdges, connectivity: Connectivity, surface: HalfEdges) -> _ValueFans:
    """Return the faces around each value; `connectivity` is the connectivity of `level`, the values."""
    count = len(level.point_sharpness)
    faces = np.bincount(level.points, minlength=count)
    inner = level.twins >= 0
    ends, sharpness = level.points[inner], surface.edge_sharpness[surface.edges[inner]]
    is_semi_sharp = (sharpness > 0.0) & np.isfinite(sharpness)
    sharp_edge_count = np.bincount(ends[np.isinf(sharpness)], minlength=count)
    # Of the semi-sharp edges at a value, the edges whose sharpness, rounded up, is the largest become smooth last, all
    # in the same refinement. In this refinement, the weight of the corner is the mean of the sharpness that remains.
    last = np.zeros(count)
    np.maximum.at(last, ends[is_semi_sharp], np.ceil(sharpness[is_semi_sharp]))
    final = is_semi_sharp & (np.ceil(sharpness) == last[ends])
    total = np.bincount(ends[final], sharpness[final], count)
    corner_sharpness = total / np.maximum(np.bincount(ends[final], minlength=count), 1)
    return _ValueFans(faces > 0, faces, connectivity.fan_counts, sharp_edge_count, corner_sharpness)


def _seam_points(level: HalfEdges, surface: HalfEdges) -> Bools:
    """Return which points (n,) of the surface are ends of a seam."""
    seams = (level.twins < 0) & (surface.twins >= 0)
    seams |= _nonmanifold_seams(level, surface)
    is_seam_point = np.zeros(len(surface.point_sharpness), bool)
    is_seam_point[surface.ends[surface.edges[seams]]] = True
    return is_seam_point


def _nonmanifold_seams(level: HalfEdges, surface: HalfEdges) -> Bools:
    """Return which half-edges (m,) are on an edge of the surface that corresponds to several edges of values.

    This finds the seams at edges of three or more faces, where half-edges of the surface have no twins.
    """
    first = np.empty(len(surface.ends), np.intp)
    first[surface.edges] = level.edges
    differs = np.zeros(len(surface.ends), bool)
    differs[surface.edges[level.edges != first[surface.edges]]] = True
    return differs[surface.edges]


def _shares_point(is_marked: Bools, value_points: Indices) -> Bools:
    """Return which values (v,) are at a point with at least one marked value."""
    points = np.zeros(int(value_points.max()) + 1, bool)
    points[value_points[is_marked]] = True
    return points[value_points]


def _dependent_sharpness(fans: _ValueFans, value_points: Indices) -> Floats:
    """Return, for values at points with two values, the corner sharpness (v,) that one value takes from the other.

    A value without semi-sharp edges has the `corner_sharpness` of the other value at its point. The sharpness of a
    value with semi-sharp edges is 0.
    """
    highest = np.zeros(int(value_points.max()) + 1)
    np.maximum.at(highest, value_points, fans.corner_sharpness)
    return np.where(fans.corner_sharpness > 0.0, 0.0, highest[value_points])
