"""From shapes, as files and primitives have them, to meshes: the faces that are kept, and their normals.

What varies over a shape is put at the corners of its faces. Points that no face uses are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.faces import Faces, first_in_each, raise_all
from lookdev.asset.mesh import Floats, Mesh, Subdivision
from lookdev.asset.normals import area_vectors, batches, blocks, face_starts, sum_by, together, unit_or
from lookdev.asset.shape import LARGEST, Attribute, Doubles, Index, Shape
from lookdev.errors import AssetError


def finish(shapes: Sequence[Shape], y_up: bool = False) -> list[Mesh | None]:
    """Return a mesh for each shape, None where no face is left; its `face_slots` are the parts of the shape.

    With `y_up` the shapes' y axis becomes the meshes' z axis, and their z axis the -y axis. Normals that mostly point
    against the faces' winding are flipped: in USD the winding decides. A mesh with a subdivision has the smooth normals
    of its control cage.

    Raises
    ------
    AssetError
        Counts, indices and sizes of a shape do not agree, or a number is not finite; a line for each fault.
    """
    meshes: list[Mesh | None] = []
    faults: list[str] = []
    for batch in batches([len(shape.face_points) for shape in shapes]):
        try:
            meshes += _finish(shapes[batch], y_up)
        except AssetError:
            faults += _faults(shapes[batch], y_up)
    raise_all(faults)
    return meshes


def _faults(shapes: Sequence[Shape], y_up: bool) -> Iterator[str]:
    """Yield what is wrong with each of some shapes: a fault of one hides later ones of others."""
    for shape in shapes:
        try:
            _finish([shape], y_up)
        except AssetError as error:
            yield str(error)


def _finish(shapes: Sequence[Shape], y_up: bool) -> list[Mesh | None]:
    faces = Faces.of(shapes)
    if len(faces.sizes) == 0:
        return [None] * len(shapes)
    number, kept = _used_points(faces)
    points, corner_points = together([each.points for each in shapes]), faces.corner_points
    if len(kept) < len(points):
        points, corner_points = points[kept], number[corner_points]
    point_starts = np.searchsorted(kept, faces.all_points)
    if y_up:
        points = _upright(points)
    single = _single(points, shapes, kept, faces.all_points)
    attributes = _attributes(shapes, faces)
    normals = _normals(shapes, faces, points, corner_points, y_up)
    uvs = [_uvs(shape, values) for shape, values in zip(shapes, attributes, strict=True)]
    local = corner_points.astype(np.int32)
    if len(shapes) > 1:
        local -= np.repeat(point_starts[:-1].astype(np.int32), np.diff(faces.corners))
    sizes = faces.sizes.astype(np.int32)

    meshes: list[Mesh | None] = []
    for i, shape in enumerate(shapes):
        of_faces = slice(faces.faces[i], faces.faces[i + 1])
        of_corners = slice(faces.corners[i], faces.corners[i + 1])
        if faces.holes[of_faces].all():  # also where there are none
            meshes.append(None)
            continue
        slots = np.zeros(of_faces.stop - of_faces.start, np.int32)
        if shape.parts is not None:
            slots = shape.parts[faces.face_source[of_faces] - faces.all_faces[i]].astype(np.int32)
        subdivision = shape.subdivision
        if subdivision is not None:
            renumbered = number[faces.all_points[i] : faces.all_points[i + 1]] - point_starts[i]
            subdivision = _renumbered(shape, subdivision, renumbered, np.flatnonzero(faces.holes[of_faces]))
        meshes.append(
            Mesh(
                name=shape.name,
                points=single[point_starts[i] : point_starts[i + 1]],
                corner_points=local[of_corners],
                face_sizes=sizes[of_faces],
                face_slots=slots,
                normals=normals[of_corners],
                tangents=None,
                uvs=uvs[i],
                primvars={each.name: attributes[i][each.name] for each in shape.attributes if not each.is_uv},
                subdivision=subdivision,
                default_uv=shape.default_uv if shape.default_uv in uvs[i] else "",
            )
        )
    return meshes


def _used_points(faces: Faces) -> tuple[Index, Index]:
    """Return the number of each point (n,) among those that a face uses, else -1, and the used points' numbers."""
    used = np.zeros(faces.all_points[-1], bool)
    used[faces.corner_points] = True
    return np.where(used, np.cumsum(used) - 1, -1), np.flatnonzero(used)


def _upright(vectors: NDArray[Any]) -> NDArray[Any]:
    """Return vectors (n, 3) of a space with y up in one with z up."""
    return np.stack([vectors[:, 0], -vectors[:, 2], vectors[:, 1]], axis=-1)


def _single(points: Doubles, shapes: Sequence[Shape], kept: Index, begins: Index) -> Floats:
    # A number that is none is not within any bounds.
    if not (points.max() <= LARGEST and points.min() >= -LARGEST):
        bounded = np.abs(points) <= LARGEST
        raise_all(
            f"{shapes[i].name}: points[{j}] is not a number of metres within +-{LARGEST:g}"
            for i, j in first_in_each(kept[~bounded.all(axis=1)], begins)
        )
    return points.astype(np.float32)


def _attributes(shapes: Sequence[Shape], faces: Faces) -> list[dict[str, Floats]]:
    """Return the attributes of each shape, by name, at its corners; those of one name are computed together."""
    groups: dict[tuple[str, tuple[int, ...]], list[tuple[int, Attribute]]] = {}
    for number, shape in enumerate(shapes):
        for each in shape.attributes:
            groups.setdefault((each.name, each.values.shape[1:]), []).append((number, each))
    result: list[dict[str, Floats]] = [{} for _ in shapes]
    for given in groups.values():
        for (number, each), values in zip(given, faces.at_corners(given), strict=True):
            result[number][each.name] = values
    return result


def _normals(shapes: Sequence[Shape], faces: Faces, points: Doubles, corner_points: Index, y_up: bool) -> Floats:
    """Return unit normals (m, 3): those of the shape, its facets' or smooth ones."""
    smooth = np.array([each.normals is None and not each.flat for each in shapes])
    given = [(i, each.normals) for i, each in enumerate(shapes) if each.normals is not None]
    flat = np.empty((len(faces.sizes), 3), np.float32)
    areas = np.empty(flat.shape) if smooth.any() or given else None
    for some, corners in blocks(faces.sizes):
        own = area_vectors(points.take(corner_points[corners], axis=0), faces.sizes[some])
        flat[some] = unit_or(own, np.array([0.0, 0.0, 1.0]))
        if areas is not None:
            areas[some] = own
    if areas is not None and smooth.any():
        sums = sum_by(corner_points, np.repeat(areas, faces.sizes, axis=0), len(points))
        units = unit_or(sums, np.zeros(3)).astype(np.float32)
        shared = (sums != 0.0).any(axis=1)
        if smooth.all() and shared.all():
            return np.asarray(units[corner_points])
        here = np.repeat(smooth, np.diff(faces.corners)) & shared[corner_points]
    normals = np.repeat(flat, faces.sizes, axis=0)
    if smooth.any():
        normals[here] = units[corner_points[here]]
    for (i, _), authored in zip(given, faces.at_corners(given) if given else (), strict=True):
        of_faces, of_corners = slice(*faces.faces[i : i + 2]), slice(*faces.corners[i : i + 2])
        sizes = faces.sizes[of_faces]
        if areas is not None and len(sizes):
            vectors = _upright(authored) if y_up else authored
            along = (np.add.reduceat(vectors, face_starts(sizes), dtype=np.float64) * areas[of_faces]).sum()
            sign = -1.0 if along < 0.0 else 1.0
            mine = normals[of_corners]
            for _, some in blocks(sizes):
                mine[some] = unit_or(sign * vectors[some].astype(np.float64), mine[some])
    return normals


def _uvs(shape: Shape, values: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return the UV sets of a shape, the default one first."""
    names = sorted((each.name for each in shape.attributes if each.is_uv), key=lambda name: name != shape.default_uv)
    return {name: values[name] for name in names}


def _renumbered(shape: Shape, rules: Subdivision, number: Index, holes: Index) -> Subdivision:
    """Return the rules of a cage by its new numbers: `number` (n,) of each point, negative where no face uses it."""
    edges, corners = number[rules.crease_edges], number[rules.corner_points]
    creased = (edges >= 0).all(axis=1) & (rules.crease_sharpness > 0.0)
    cornered = (corners >= 0) & (rules.corner_sharpness > 0.0)
    return replace(
        rules,
        crease_edges=edges[creased].astype(np.int32),
        crease_sharpness=rules.crease_sharpness[creased],
        corner_points=corners[cornered].astype(np.int32),
        corner_sharpness=rules.corner_sharpness[cornered],
        holes=holes.astype(np.int32),
        interpolation={each.name: each.interpolation for each in shape.attributes},
    )
