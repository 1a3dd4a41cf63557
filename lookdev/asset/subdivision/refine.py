"""One cage, with all its values, refined: which value follows which rule."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lookdev.asset.mesh import Floats, Subdivision
from lookdev.asset.normals import area_vectors, flat_normals
from lookdev.asset.subdivision.cage import Cage, Control, build_cage
from lookdev.asset.subdivision.face_varying import value_level, weld
from lookdev.asset.subdivision.limit import complete_normals, limit
from lookdev.asset.subdivision.rules import Rules, interpolate
from lookdev.asset.subdivision.topology import Doubles, Flags, Index, Level, parent_faces, split, split_corners


@dataclass(frozen=True, eq=False)
class Refined:
    """The faces that are shown: points (n, 3), corners (m,), sizes (f,), normals (m, 3), values (m, k), all in order.

    origin (f,) is the face of the cage that each face comes from.
    """

    points: Floats
    corners: Index
    sizes: Index
    origin: Index
    normals: Floats
    values: list[Floats]


@dataclass(frozen=True, eq=False)
class _Stack:
    """Values (n, k) that are refined by the same half-edges; the numbers of those in the columns, and their widths."""

    level: Level
    values: Doubles
    columns: list[tuple[int, int]]
    linear_boundary: bool = False

    def with_values(self, number: int, values: Doubles) -> _Stack:
        """Return the stack with more columns."""
        columns = [*self.columns, (number, values.shape[1])]
        return replace(self, values=np.hstack([self.values, values]), columns=columns)


def masks_of(subdivision: Subdivision) -> Rules:
    """Return what the masks of a subdivision surface depend on."""
    smooth_triangles = subdivision.scheme == "catmullClark" and subdivision.triangle_rule == "smooth"
    return Rules(subdivision.scheme, smooth_triangles)


def refine_cage(control: Control, subdivision: Subdivision, level: int) -> Refined:
    """Return a cage refined `level` times by the rules of `subdivision`, whose tags are those of `control`."""
    rules, cage = masks_of(subdivision), build_cage(control, subdivision)
    if level == 0:
        columns = [values.astype(np.float32) for _, values in control.values]
        normals = _polygon_normals(cage.level, control.points, rules)
        return _shown(cage, cage.level, control.points, normals, np.arange(len(control.sizes)), columns)

    surface, others, linear = _sorted(control, cage, rules, subdivision)
    at_corners: list[Any] = [None] * len(control.values)
    origin, half_edges, values = np.arange(len(control.sizes)), surface.level, surface.values
    for _ in range(level):
        values = interpolate(half_edges, values, rules)
        linear = {number: split_corners(half_edges, each, rules.triangles) for number, each in linear.items()}
        origin = origin[parent_faces(half_edges, rules.triangles)]
        half_edges = split(half_edges, rules.triangles)
    values, normals = limit(half_edges, values, rules)
    complete_normals(half_edges, values[:, :3], normals)
    _spread(half_edges, values, surface.columns, at_corners)
    for number, each in linear.items():
        at_corners[number] = each.astype(np.float32)
    for stack in others:
        _spread(*_values_refined(stack, rules, level), stack.columns, at_corners)
    first = np.cumsum(control.sizes) - control.sizes
    for number, (interpolation, each) in enumerate(control.values):
        if interpolation in ("constant", "uniform"):
            at_corners[number] = np.repeat(each[first].astype(np.float32)[origin], half_edges.sizes, axis=0)
    return _shown(cage, half_edges, values[:, :3], normals, origin, at_corners)


def refined_values(control: Control, subdivision: Subdivision) -> tuple[Flags, list[Floats]]:
    """Return which faces (f,) of a cage are shown, and what `refine_cage` returns as values at level 1, of all faces.

    Values that are constant over a face are empty.
    """
    rules, cage = masks_of(subdivision), build_cage(control, subdivision)
    surface, others, linear = _sorted(control, cage, rules, subdivision)
    at_corners = [np.zeros((0, 0), np.float32) for _ in control.values]
    for number, each in linear.items():
        at_corners[number] = split_corners(cage.level, each, rules.triangles).astype(np.float32)
    for stack in (surface, *others):
        if any(number >= 0 for number, _ in stack.columns):
            _spread(*_values_refined(stack, rules, 1), stack.columns, at_corners)
    return ~cage.hidden, at_corners


def _sorted(
    control: Control, cage: Cage, rules: Rules, subdivision: Subdivision
) -> tuple[_Stack, list[_Stack], dict[int, Doubles]]:
    """Return the values by how they are refined: with the points, by half-edges of their own, linear over each face."""
    count, rule = len(control.points), subdivision.face_varying
    surface, others = _Stack(cage.level, control.points, [(-1, 3)]), dict[bytes, _Stack]()
    linear: dict[int, Doubles] = {}
    for number, (interpolation, values) in enumerate(control.values):
        if interpolation in ("constant", "uniform"):
            continue
        if rules.scheme == "bilinear" or interpolation == "varying" or (interpolation, rule) == ("faceVarying", "all"):
            linear[number] = values
        elif interpolation == "vertex":
            surface = surface.with_values(number, _by_number(control.corners, values, count))
        else:
            numbers, of_value = weld(control.corners, values, count)
            key = numbers.tobytes()
            if key not in others:
                level = value_level(cage, numbers, of_value, rule)
                others[key] = _Stack(level, np.zeros((len(of_value), 0)), [], rule == "boundaries")
            others[key] = others[key].with_values(number, _by_number(numbers, values, len(of_value)))
    for key, stack in list(others.items()):
        # Values without a seam, and without a corner of their own, are refined as those at points are.
        if len(stack.values) == count and np.array_equal(stack.level.point_sharpness, cage.level.point_sharpness):
            columns = [*surface.columns, *stack.columns]
            surface = replace(surface, values=np.hstack([surface.values, stack.values]), columns=columns)
            del others[key]
    return surface, list(others.values()), linear


def _by_number(numbers: Index, values: Doubles, count: int) -> Doubles:
    """Return the values (count, k) of the points or values that corners (m,) have in common."""
    single = np.zeros((count, values.shape[1]))
    single[numbers] = values
    return single


def _values_refined(stack: _Stack, rules: Rules, level: int) -> tuple[Level, Doubles]:
    """Return the half-edges and the limit of values with half-edges of their own."""
    half_edges, values = stack.level, stack.values
    for _ in range(level):
        values = interpolate(half_edges, values, rules)
        parent, half_edges = half_edges, split(half_edges, rules.triangles)
        if stack.linear_boundary:
            ends = len(parent.point_sharpness) + np.flatnonzero(parent.boundary)
            half_edges.point_sharpness[ends] = np.inf
    return half_edges, limit(half_edges, values, rules, has_normals=False)[0]


def _spread(level: Level, values: Doubles, columns: list[tuple[int, int]], at_corners: list[Any]) -> None:
    """Put the columns of a stack, at its corners, where they belong."""
    start = 0
    for number, width in columns:
        if number >= 0:
            at_corners[number] = values[:, start : start + width].astype(np.float32)[level.points]
        start += width


def _polygon_normals(level: Level, points: Doubles, rules: Rules) -> Floats:
    """Return the normals (m, 3) of the cage's own polygons."""
    if rules.scheme == "bilinear":
        return flat_normals(area_vectors(points[level.points], level.sizes), level.sizes).astype(np.float32)
    normals = np.zeros((len(level.points), 3), np.float32)
    complete_normals(level, points, normals)
    return normals


def _shown(cage: Cage, level: Level, points: Doubles, normals: Floats, origin: Index, values: list[Floats]) -> Refined:
    """Return the refined faces, without those that come from hidden ones."""
    shown = ~cage.hidden[origin]
    corners: Flags | slice = slice(None) if shown.all() else shown[level.faces]
    return Refined(
        points=points.astype(np.float32),
        corners=level.points[corners],
        sizes=level.sizes[shown],
        origin=origin[shown],
        normals=normals[corners],
        values=[each[corners] for each in values],
    )
