"""Refinement of one cage with all its values, each by its own rule."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lookdev.arrays import Bools, Floats, Floats32, Indices
from lookdev.asset.mesh import Subdivision
from lookdev.asset.normals import area_vectors, flat_normals
from lookdev.asset.subdivision.cage import Cage, Control, build_cage
from lookdev.asset.subdivision.face_varying import value_level, weld
from lookdev.asset.subdivision.limit import complete_normals, limit
from lookdev.asset.subdivision.rules import Rules, interpolate
from lookdev.asset.subdivision.topology import Level, parent_faces, split, split_corners


@dataclass(frozen=True, eq=False)
class Refined:
    """The visible faces: points (n, 3), corners (m,) that index into them, sizes (f,), normals (m, 3), values (m, k).

    origin (f,) is the cage's face from which each face comes. `values` has the order of the cage's values.
    """

    points: Floats32
    corners: Indices
    sizes: Indices
    origin: Indices
    normals: Floats32
    values: list[Floats32]


@dataclass(frozen=True, eq=False)
class _Stack:
    """Values (n, k) that share half-edges; `columns` are the numbers and the widths of the values in it."""

    level: Level
    values: Floats
    columns: list[tuple[int, int]]
    linear_boundary: bool = False

    def with_values(self, number: int, values: Floats) -> _Stack:
        """Return the stack with more columns."""
        columns = [*self.columns, (number, values.shape[1])]
        return replace(self, values=np.hstack([self.values, values]), columns=columns)


def mask_rules(subdivision: Subdivision) -> Rules:
    """Return the rules that determine the masks of a subdivision surface."""
    smooth_triangles = subdivision.scheme == "catmullClark" and subdivision.triangle_rule == "smooth"
    return Rules(subdivision.scheme, smooth_triangles)


def refine_cage(control: Control, subdivision: Subdivision, level: int) -> Refined:
    """Return a cage refined `level` times by the rules of `subdivision` and the tags of `control`."""
    rules, cage = mask_rules(subdivision), build_cage(control, subdivision)
    if level == 0:
        columns = [values.astype(np.float32) for _, values in control.values]
        normals = _polygon_normals(cage.level, control.points, rules)
        return _visible_faces(cage, cage.level, control.points, normals, np.arange(len(control.sizes)), columns)

    surface, others, linear = _group_values(control, cage, rules, subdivision)
    at_corners = [np.zeros(0, np.float32)] * len(control.values)
    origin, half_edges, values = np.arange(len(control.sizes)), surface.level, surface.values
    for _ in range(level):
        values = interpolate(half_edges, values, rules)
        linear = {
            number: split_corners(half_edges, corner_values, rules.triangles)
            for number, corner_values in linear.items()
        }
        origin = origin[parent_faces(half_edges, rules.triangles)]
        half_edges = split(half_edges, rules.triangles)
    values, normals = limit(half_edges, values, rules)
    complete_normals(half_edges, values[:, :3], normals)
    _assign_columns(half_edges, values, surface.columns, at_corners)
    for number, corner_values in linear.items():
        at_corners[number] = corner_values.astype(np.float32)
    for stack in others:
        _assign_columns(*_refine_stack(stack, rules, level), stack.columns, at_corners)
    first = np.cumsum(control.sizes) - control.sizes
    for number, (interpolation, corner_values) in enumerate(control.values):
        if interpolation in ("constant", "uniform"):
            at_corners[number] = np.repeat(corner_values[first].astype(np.float32)[origin], half_edges.sizes, axis=0)
    return _visible_faces(cage, half_edges, values[:, :3], normals, origin, at_corners)


def refined_values(control: Control, subdivision: Subdivision) -> tuple[Bools, list[Floats32]]:
    """Return the visible faces (f,) of a cage, and the values of `refine_cage` at level 1, of hidden faces too.

    Values that are constant over a face are empty.
    """
    rules, cage = mask_rules(subdivision), build_cage(control, subdivision)
    surface, others, linear = _group_values(control, cage, rules, subdivision)
    at_corners = [np.zeros((0, 0), np.float32) for _ in control.values]
    for number, corner_values in linear.items():
        at_corners[number] = split_corners(cage.level, corner_values, rules.triangles).astype(np.float32)
    for stack in (surface, *others):
        if any(number >= 0 for number, _ in stack.columns):
            _assign_columns(*_refine_stack(stack, rules, 1), stack.columns, at_corners)
    return ~cage.hidden, at_corners


def _group_values(
    control: Control, cage: Cage, rules: Rules, subdivision: Subdivision
) -> tuple[_Stack, list[_Stack], dict[int, Floats]]:
    """Group values by their refinement: with the points, by half-edges of their own, or linearly over each face."""
    count, rule = len(control.points), subdivision.face_varying
    surface, others = _Stack(cage.level, control.points, [(-1, 3)]), dict[bytes, _Stack]()
    linear: dict[int, Floats] = {}
    for number, (interpolation, values) in enumerate(control.values):
        if interpolation in ("constant", "uniform"):
            continue
        if rules.scheme == "bilinear" or interpolation == "varying" or (interpolation, rule) == ("faceVarying", "all"):
            linear[number] = values
        elif interpolation == "vertex":
            surface = surface.with_values(number, _values_by_number(control.corners, values, count))
        else:
            numbers, value_points = weld(control.corners, values, count)
            key = numbers.tobytes()
            if key not in others:
                level = value_level(cage, numbers, value_points, rule)
                others[key] = _Stack(level, np.zeros((len(value_points), 0)), [], rule == "boundaries")
            others[key] = others[key].with_values(number, _values_by_number(numbers, values, len(value_points)))
    for key, stack in list(others.items()):
        # Values without seams and without corners of their own are refined with the points.
        if len(stack.values) == count and np.array_equal(stack.level.point_sharpness, cage.level.point_sharpness):
            columns = [*surface.columns, *stack.columns]
            surface = replace(surface, values=np.hstack([surface.values, stack.values]), columns=columns)
            del others[key]
    return surface, list(others.values()), linear


def _values_by_number(numbers: Indices, values: Floats, count: int) -> Floats:
    """Return the values (count, k) by number, from those (m, k) at corners; corners of one number share a value."""
    shared = np.zeros((count, values.shape[1]))
    shared[numbers] = values
    return shared


def _refine_stack(stack: _Stack, rules: Rules, level: int) -> tuple[Level, Floats]:
    """Return the half-edges and the limit of a stack after `level` refinements."""
    half_edges, values = stack.level, stack.values
    for _ in range(level):
        values = interpolate(half_edges, values, rules)
        parent, half_edges = half_edges, split(half_edges, rules.triangles)
        if stack.linear_boundary:
            boundary_points = len(parent.point_sharpness) + np.flatnonzero(parent.boundary)
            half_edges.point_sharpness[boundary_points] = np.inf
    return half_edges, limit(half_edges, values, rules, has_normals=False)[0]


def _assign_columns(level: Level, values: Floats, columns: list[tuple[int, int]], at_corners: list[Floats32]) -> None:
    """Write the columns of a stack, at the corners, to `at_corners` by their numbers."""
    start = 0
    for number, width in columns:
        if number >= 0:
            at_corners[number] = values[:, start : start + width].astype(np.float32)[level.points]
        start += width


def _polygon_normals(level: Level, points: Floats, rules: Rules) -> Floats32:
    """Return the normals (m, 3) of the cage's own polygons."""
    if rules.scheme == "bilinear":
        return flat_normals(area_vectors(points[level.points], level.sizes), level.sizes).astype(np.float32)
    normals = np.zeros((len(level.points), 3), np.float32)
    complete_normals(level, points, normals)
    return normals


def _visible_faces(
    cage: Cage, level: Level, points: Floats, normals: Floats32, origin: Indices, values: list[Floats32]
) -> Refined:
    """Return the refined faces except those that come from hidden faces."""
    is_visible = ~cage.hidden[origin]
    corners: Bools | slice = slice(None) if is_visible.all() else is_visible[level.faces]
    return Refined(
        points=points.astype(np.float32),
        corners=level.points[corners],
        sizes=level.sizes[is_visible],
        origin=origin[is_visible],
        normals=normals[corners],
        values=[columns[corners] for columns in values],
    )
