"""Refines one control mesh with all its values: UV sets and primvars, each by its own interpolation rule.

Values that are refined in the same way are columns of one array and share half-edges.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lookdev.arrays import Bools, Floats, Floats32, Indices
from lookdev.asset.mesh import Subdivision
from lookdev.asset.normals import area_vectors, flat_normals
from lookdev.asset.subdivision.cage import Cage, ControlMesh, build_cage
from lookdev.asset.subdivision.face_varying import connect_values, weld
from lookdev.asset.subdivision.limit import complete_normals, limit_surface
from lookdev.asset.subdivision.rules import Rules, interpolate
from lookdev.asset.subdivision.topology import HalfEdges, parent_faces, split_corners, split_faces


@dataclass(frozen=True, eq=False)
class RefinedCage:
    """The visible faces of a refined cage.

    - points (n, 3): on the limit surface, unless the cage is not refined
    - corners (m,): the point at each corner of the faces
    - sizes (f,): the number of corners of each face
    - origin (f,): the face of the cage from which each face comes
    - normals (m, 3): unit normals at the corners
    - values: an array (m, k) at the corners for each entry of `ControlMesh.values`
    """

    points: Floats32
    corners: Indices
    sizes: Indices
    origin: Indices
    normals: Floats32
    values: list[Floats32]


@dataclass(frozen=True, eq=False)
class _ValueGroup:
    """Values that share half-edges: UV sets, primvars or positions, side by side as the columns of `values` (n, k).

    `columns` has a pair for each UV set, primvar or position, in order: the index in `ControlMesh.values`, or -1 for
    positions, and the number of columns. With `linear_boundary`, values along a boundary are refined linearly.
    """

    half_edges: HalfEdges
    values: Floats
    columns: list[tuple[int, int]]
    linear_boundary: bool = False

    def with_column(self, number: int, values: Floats) -> _ValueGroup:
        """Return the group with k more columns, `values` (n, k), for the entry `number` of `ControlMesh.values`."""
        columns = [*self.columns, (number, values.shape[1])]
        return replace(self, values=np.hstack([self.values, values]), columns=columns)


def mask_rules(subdivision: Subdivision) -> Rules:
    """Return the rules that determine the masks of a subdivision surface."""
    smooth_triangles = subdivision.scheme == "catmullClark" and subdivision.triangle_rule == "smooth"
    return Rules(subdivision.scheme, smooth_triangles)


def refine_cage(control: ControlMesh, subdivision: Subdivision, level: int) -> RefinedCage:
    """Return a cage refined `level` times by the rules of `subdivision` and the tags of `control`."""
    rules, cage = mask_rules(subdivision), build_cage(control, subdivision)
    if level == 0:
        columns = [values.astype(np.float32) for _, values in control.values]
        normals = _polygon_normals(cage.half_edges, control.points, rules)
        return _visible_faces(cage, cage.half_edges, control.points, normals, np.arange(len(control.sizes)), columns)

    surface, seam_groups, linear_values = _group_values(control, cage, rules, subdivision)
    # The refined values at the corners, for each entry of `control.values`.
    corner_columns = [np.zeros(0, np.float32)] * len(control.values)
    origin, half_edges, values = np.arange(len(control.sizes)), surface.half_edges, surface.values
    for _ in range(level):
        values = interpolate(half_edges, values, rules)
        linear_values = {
            number: split_corners(half_edges, corner_values, rules.triangles)
            for number, corner_values in linear_values.items()
        }
        origin = origin[parent_faces(half_edges, rules.triangles)]
        half_edges = split_faces(half_edges, rules.triangles)
    values, normals = limit_surface(half_edges, values, rules)
    complete_normals(half_edges, values[:, :3], normals)
    _assign_columns(half_edges, values, surface.columns, corner_columns)
    for number, corner_values in linear_values.items():
        corner_columns[number] = corner_values.astype(np.float32)
    for group in seam_groups:
        _assign_columns(*_refine_group(group, rules, level), group.columns, corner_columns)
    # Values that are constant over a face are taken from the face's first corner in the cage.
    first = np.cumsum(control.sizes) - control.sizes
    for number, (interpolation, corner_values) in enumerate(control.values):
        if interpolation in ("constant", "uniform"):
            face_values = corner_values[first].astype(np.float32)[origin]
            corner_columns[number] = np.repeat(face_values, half_edges.sizes, axis=0)
    return _visible_faces(cage, half_edges, values[:, :3], normals, origin, corner_columns)


def refined_values(control: ControlMesh, subdivision: Subdivision) -> tuple[Bools, list[Floats32]]:
    """Return which faces (f,) of a cage are visible, and the values at the corners of all faces of level 1.

    There is an array (m, k) for each entry of `control.values`, at the m corners of visible and hidden faces. The array
    is empty for values that are constant over a face.
    """
    rules, cage = mask_rules(subdivision), build_cage(control, subdivision)
    surface, seam_groups, linear_values = _group_values(control, cage, rules, subdivision)
    corner_columns = [np.zeros((0, 0), np.float32) for _ in control.values]
    for number, corner_values in linear_values.items():
        corner_columns[number] = split_corners(cage.half_edges, corner_values, rules.triangles).astype(np.float32)
    for group in (surface, *seam_groups):
        if any(number >= 0 for number, _ in group.columns):
            _assign_columns(*_refine_group(group, rules, 1), group.columns, corner_columns)
    return ~cage.is_hidden, corner_columns


def _group_values(
    control: ControlMesh, cage: Cage, rules: Rules, subdivision: Subdivision
) -> tuple[_ValueGroup, list[_ValueGroup], dict[int, Floats]]:
    """Group the values of a cage by the way in which they are refined.

    Return three results: the group of the positions and of values that are refined with them; the groups that have
    half-edges of their own because of seams; and the values (m, k) at corners that are refined linearly over each face,
    by their index in `control.values`. Values that are constant over a face are in none of the results.
    """
    count, rule = len(control.points), subdivision.face_varying
    surface, seam_groups = _ValueGroup(cage.half_edges, control.points, [(-1, 3)]), dict[bytes, _ValueGroup]()
    linear_values: dict[int, Floats] = {}
    for number, (interpolation, values) in enumerate(control.values):
        if interpolation in ("constant", "uniform"):
            continue
        if rules.scheme == "bilinear" or interpolation == "varying" or (interpolation, rule) == ("faceVarying", "all"):
            linear_values[number] = values
        elif interpolation == "vertex":
            surface = surface.with_column(number, _scatter_corner_values(control.corners, values, count))
        else:
            # Values with the same seams have the same numbers at the corners, and share half-edges.
            value_numbers, value_points = weld(control.corners, values, count)
            key = value_numbers.tobytes()
            if key not in seam_groups:
                half_edges = connect_values(cage, value_numbers, value_points, rule)
                seam_groups[key] = _ValueGroup(half_edges, np.zeros((len(value_points), 0)), [], rule == "boundaries")
            column = _scatter_corner_values(value_numbers, values, len(value_points))
            seam_groups[key] = seam_groups[key].with_column(number, column)
    for key, group in list(seam_groups.items()):
        # A group without seams that has the same sharp points as the surface is refined with the positions.
        sharpness = group.half_edges.point_sharpness
        if len(group.values) == count and np.array_equal(sharpness, cage.half_edges.point_sharpness):
            columns = [*surface.columns, *group.columns]
            surface = replace(surface, values=np.hstack([surface.values, group.values]), columns=columns)
            del seam_groups[key]
    return surface, list(seam_groups.values()), linear_values


def _scatter_corner_values(rows: Indices, values: Floats, count: int) -> Floats:
    """Return an array (count, k) in which row `rows[i]` is the value of corner i, from the values (m, k) at corners.

    Corners with the same row have equal values.
    """
    scattered = np.zeros((count, values.shape[1]))
    scattered[rows] = values
    return scattered


def _refine_group(group: _ValueGroup, rules: Rules, level: int) -> tuple[HalfEdges, Floats]:
    """Return the half-edges of a group after `level` refinements, and the limit (n, k) of its values."""
    half_edges, values = group.half_edges, group.values
    for _ in range(level):
        values = interpolate(half_edges, values, rules)
        parent, half_edges = half_edges, split_faces(half_edges, rules.triangles)
        if group.linear_boundary:
            # The points of edges come after the points of the parent level. An infinitely sharp point does not move.
            boundary_points = len(parent.point_sharpness) + np.flatnonzero(parent.boundary)
            half_edges.point_sharpness[boundary_points] = np.inf
    return half_edges, limit_surface(half_edges, values, rules, needs_normals=False)[0]


def _assign_columns(
    half_edges: HalfEdges, values: Floats, columns: list[tuple[int, int]], corner_columns: list[Floats32]
) -> None:
    """Write the values of a group to `corner_columns`: arrays (m, k) over corners, by index in `ControlMesh.values`.

    `values` (n, k) and `columns` are as in `_ValueGroup`.
    """
    start = 0
    for number, width in columns:
        if number >= 0:
            corner_columns[number] = values[:, start : start + width].astype(np.float32)[half_edges.points]
        start += width


def _polygon_normals(half_edges: HalfEdges, points: Floats, rules: Rules) -> Floats32:
    """Return the normals (m, 3) at the corners of an unrefined cage: flat if bilinear, otherwise smooth."""
    if rules.scheme == "bilinear":
        areas = area_vectors(points[half_edges.points], half_edges.sizes)
        return flat_normals(areas, half_edges.sizes).astype(np.float32)
    normals = np.zeros((len(half_edges.points), 3), np.float32)
    complete_normals(half_edges, points, normals)
    return normals


def _visible_faces(
    cage: Cage, half_edges: HalfEdges, points: Floats, normals: Floats32, origin: Indices, values: list[Floats32]
) -> RefinedCage:
    """Return the refined faces, except those that come from hidden faces of the cage."""
    is_visible = ~cage.is_hidden[origin]
    corners: Bools | slice = slice(None) if is_visible.all() else is_visible[half_edges.faces]
    return RefinedCage(
        points=points.astype(np.float32),
        corners=half_edges.points[corners],
        sizes=half_edges.sizes[is_visible],
        origin=origin[is_visible],
        normals=normals[corners],
        values=[columns[corners] for columns in values],
    )
