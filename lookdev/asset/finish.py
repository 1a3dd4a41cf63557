"""Converts shapes to meshes for the readers of USD files.

A mesh has the valid faces of its shape (`faces`), and all attributes and the normals at the corners of these faces.
Points that no valid face uses are dropped.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from lookdev.arrays import Floats, Floats32, Indices
from lookdev.asset.faces import Faces, first_in_runs, raise_faults
from lookdev.asset.mesh import Mesh, Subdivision
from lookdev.asset.normals import area_vectors, batch_slices, concatenate, face_blocks, normalize_or, run_starts, sum_by
from lookdev.asset.shape import MAX_COORDINATE, Attribute, PolygonShape
from lookdev.errors import AssetError

_Vectors = TypeVar("_Vectors", Floats, Floats32)


def make_meshes(shapes: Sequence[PolygonShape], y_up: bool = False) -> list[Mesh | None]:
    """Return a mesh for each shape, None for a shape without a valid face.

    The `face_slots` of a mesh are the part numbers in `PolygonShape.face_parts`; the caller replaces them by slots of
    the asset. With `y_up` the shapes' y axis becomes the meshes' z axis, and the shapes' z axis the meshes' -y axis. In
    USD the winding decides which side is outside: a shape's authored normals are all flipped if they mostly point
    against the winding. A mesh with a subdivision has the smooth normals of its control cage.

    Raises
    ------
    AssetError
        Counts, indices and sizes of a shape do not agree, or a number is not finite. The message has a line for each
        fault.
    """
    meshes: list[Mesh | None] = []
    faults: list[str] = []
    for batch in batch_slices([len(shape.face_points) for shape in shapes]):
        try:
            meshes += _make_batch(shapes[batch], y_up)
        except AssetError:
            faults += _shape_faults(shapes[batch], y_up)
    raise_faults(faults)
    return meshes


def _shape_faults(shapes: Sequence[PolygonShape], y_up: bool) -> Iterator[str]:
    """Yield the faults of shapes, converted one at a time; in a batch, a fault of one shape can hide other faults."""
    for shape in shapes:
        try:
            _make_batch([shape], y_up)
        except AssetError as error:
            yield str(error)


def _make_batch(shapes: Sequence[PolygonShape], y_up: bool) -> list[Mesh | None]:
    """Return the same meshes as `make_meshes`; the shapes' arrays are concatenated and processed together."""
    faces = Faces.collect(shapes)
    if len(faces.sizes) == 0:
        return [None] * len(shapes)
    # Only used points are kept. `point_numbers` is the number of each point among the used points, and `point_starts`
    # the number of each shape's first used point.
    point_numbers, used_points = _used_points(faces)
    points, corner_points = concatenate([shape.points for shape in shapes]), faces.corner_points
    if len(used_points) < len(points):
        points, corner_points = points[used_points], point_numbers[corner_points]
    point_starts = np.searchsorted(used_points, faces.all_point_starts)
    if y_up:
        points = _to_z_up(points)
    float32_points = _single_precision(points, shapes, used_points, faces.all_point_starts)
    attributes = _corner_attributes(shapes, faces)
    normals = _corner_normals(shapes, faces, points, corner_points, y_up)
    uvs = [_uv_sets(shape, values) for shape, values in zip(shapes, attributes, strict=True)]
    mesh_corner_points = corner_points.astype(np.int32)
    if len(shapes) > 1:
        mesh_corner_points -= np.repeat(point_starts[:-1].astype(np.int32), np.diff(faces.corner_starts))
    sizes = faces.sizes.astype(np.int32)

    meshes: list[Mesh | None] = []
    for i, (shape, values) in enumerate(zip(shapes, attributes, strict=True)):
        face_slice = slice(faces.face_starts[i], faces.face_starts[i + 1])
        corner_slice = slice(faces.corner_starts[i], faces.corner_starts[i + 1])
        if faces.holes[face_slice].all():  # all faces are holes, or there are none
            meshes.append(None)
            continue
        slots = np.zeros(face_slice.stop - face_slice.start, np.int32)
        if shape.face_parts is not None:
            slots = shape.face_parts[faces.face_source[face_slice] - faces.all_face_starts[i]].astype(np.int32)
        subdivision = shape.subdivision
        if subdivision is not None:
            new_numbers = point_numbers[faces.all_point_starts[i] : faces.all_point_starts[i + 1]] - point_starts[i]
            subdivision = _renumber_rules(shape, subdivision, new_numbers, np.flatnonzero(faces.holes[face_slice]))
        meshes.append(
            Mesh(
                name=shape.name,
                points=float32_points[point_starts[i] : point_starts[i + 1]],
                corner_points=mesh_corner_points[corner_slice],
                face_sizes=sizes[face_slice],
                face_slots=slots,
                normals=normals[corner_slice],
                tangents=None,
                uvs=uvs[i],
                primvars={
                    attribute.name: values[attribute.name] for attribute in shape.attributes if not attribute.is_uv
                },
                subdivision=subdivision,
                default_uv=shape.default_uv if shape.default_uv in uvs[i] else "",
            )
        )
    return meshes


def _used_points(faces: Faces) -> tuple[Indices, Indices]:
    """Return the new number of each point (n,), -1 if no face uses it, and the indices of the used points."""
    is_used = np.zeros(faces.all_point_starts[-1], bool)
    is_used[faces.corner_points] = True
    return np.where(is_used, np.cumsum(is_used) - 1, -1), np.flatnonzero(is_used)


def _to_z_up(vectors: _Vectors) -> _Vectors:
    """Convert vectors (n, 3) from y up to z up."""
    return np.asarray(np.stack([vectors[:, 0], -vectors[:, 2], vectors[:, 1]], axis=-1))


def _single_precision(
    points: Floats, shapes: Sequence[PolygonShape], used_points: Indices, begins: Indices
) -> Floats32:
    """Return the used points (n, 3) in single precision; raise AssetError if a coordinate is not finite or too large.

    `used_points` (n,) is the index of each used point among all points of the s shapes. `begins` (s + 1,) is the index
    of the first point of each shape.
    """
    # A NaN fails the first comparison, and so raises an error.
    if not (points.max() <= MAX_COORDINATE and points.min() >= -MAX_COORDINATE):
        is_bounded = np.abs(points) <= MAX_COORDINATE
        raise_faults(
            f"{shapes[i].name}: points[{j}] is not a number of metres within +-{MAX_COORDINATE:g}"
            for i, j in first_in_runs(used_points[~is_bounded.all(axis=1)], begins)
        )
    return points.astype(np.float32)


def _corner_attributes(shapes: Sequence[PolygonShape], faces: Faces) -> list[dict[str, Floats32]]:
    """Return a dictionary for each shape, from an attribute's name to its values at the corners of the valid faces.

    Attributes of equal name and width are processed together.
    """
    # By name and width: pairs of the number of a shape and an attribute of that shape.
    groups: dict[tuple[str, tuple[int, ...]], list[tuple[int, Attribute]]] = {}
    for number, shape in enumerate(shapes):
        for attribute in shape.attributes:
            groups.setdefault((attribute.name, attribute.values.shape[1:]), []).append((number, attribute))
    result: list[dict[str, Floats32]] = [{} for _ in shapes]
    for attributes in groups.values():
        for (number, attribute), values in zip(attributes, faces.corner_values(attributes), strict=True):
            result[number][attribute.name] = values
    return result


def _corner_normals(
    shapes: Sequence[PolygonShape], faces: Faces, points: Floats, corner_points: Indices, y_up: bool
) -> Floats32:
    """Return unit normals (m, 3) at the corners: authored, flat or smooth normals, as `PolygonShape` describes.

    `points` (n, 3) are the used points, and `corner_points` (m,) indexes them. Where an authored normal has no length,
    or a smooth normal is not defined, the corner has the normal of its face.
    """
    # `smooth` (s,) is whether each shape gets smooth normals. `authored` has the numbers and the normals of the shapes
    # with authored normals. `flat` has the unit normal of each face, and `areas` the area vector of each face.
    smooth = np.array([shape.normals is None and not shape.flat for shape in shapes])
    authored = [(i, shape.normals) for i, shape in enumerate(shapes) if shape.normals is not None]
    flat = np.empty((len(faces.sizes), 3), np.float32)
    areas = np.empty(flat.shape) if smooth.any() or authored else None
    for block, corners in face_blocks(faces.sizes):
        block_areas = area_vectors(points.take(corner_points[corners], axis=0), faces.sizes[block])
        flat[block] = normalize_or(block_areas, np.array([0.0, 0.0, 1.0]))
        if areas is not None:
            areas[block] = block_areas
    if areas is not None and smooth.any():
        # `units` has the smooth unit normal of each point; `has_normal` is whether it is defined.
        sums = sum_by(corner_points, np.repeat(areas, faces.sizes, axis=0), len(points))
        units = normalize_or(sums, np.zeros(3)).astype(np.float32)
        has_normal = (sums != 0.0).any(axis=1)
        if smooth.all() and has_normal.all():
            return np.asarray(units[corner_points])
        is_smooth = np.repeat(smooth, np.diff(faces.corner_starts)) & has_normal[corner_points]
    normals = np.repeat(flat, faces.sizes, axis=0)
    if smooth.any():
        normals[is_smooth] = units[corner_points[is_smooth]]
    for (i, _), values in zip(authored, faces.corner_values(authored) if authored else (), strict=True):
        face_slice, corner_slice = slice(*faces.face_starts[i : i + 2]), slice(*faces.corner_starts[i : i + 2])
        sizes = faces.sizes[face_slice]
        if areas is not None and len(sizes):
            vectors = _to_z_up(values) if y_up else values
            agreement = (np.add.reduceat(vectors, run_starts(sizes), dtype=np.float64) * areas[face_slice]).sum()
            # If the agreement is negative, the authored normals mostly point against the winding.
            sign = -1.0 if agreement < 0.0 else 1.0
            shape_normals = normals[corner_slice]
            for _, block in face_blocks(sizes):
                shape_normals[block] = normalize_or(sign * vectors[block].astype(np.float64), shape_normals[block])
    return normals


def _uv_sets(shape: PolygonShape, values: Mapping[str, Floats32]) -> dict[str, Floats32]:
    """Return a shape's UV sets, from each name to its values (m, 2) at corners; the default set comes first."""
    names = sorted(
        (attribute.name for attribute in shape.attributes if attribute.is_uv), key=lambda name: name != shape.default_uv
    )
    return {name: values[name] for name in names}


def _renumber_rules(shape: PolygonShape, rules: Subdivision, point_numbers: Indices, holes: Indices) -> Subdivision:
    """Return the subdivision rules of a cage whose points have new numbers, with the shape's interpolations.

    Creases and corners of sharpness 0 are left out, and also those at points that no face uses. `point_numbers` (n,) is
    the new number of each point of the shape, negative if no face uses the point. `holes` (h,) are the numbers of the
    faces that are holes.
    """
    edges, corners = point_numbers[rules.crease_edges], point_numbers[rules.corner_points]
    has_crease = (edges >= 0).all(axis=1) & (rules.crease_sharpness > 0.0)
    has_corner = (corners >= 0) & (rules.corner_sharpness > 0.0)
    return replace(
        rules,
        crease_edges=edges[has_crease].astype(np.int32),
        crease_sharpness=rules.crease_sharpness[has_crease],
        corner_points=corners[has_corner].astype(np.int32),
        corner_sharpness=rules.corner_sharpness[has_corner],
        holes=holes.astype(np.int32),
        interpolation={attribute.name: attribute.interpolation for attribute in shape.attributes},
    )
