"""Refines the control cages of an asset, in batches, so that small cages cost little.

A batch is several cages with the same rules: they are joined to one control mesh, refined, and split into meshes again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from lookdev.arrays import Floats32, Indices
from lookdev.asset.mesh import Interpolation, Mesh, Subdivision
from lookdev.asset.subdivision.cage import ControlMesh, Tags, read_tags
from lookdev.asset.subdivision.refine import RefinedCage, refine_cage
from lookdev.errors import AssetError

_BATCH_CORNERS = 1_000_000
"""The refined corners of a batch: enough that small cages share the cost of a call, few enough to reuse memory."""


def refine(mesh: Mesh, level: int) -> Mesh:
    """Return a cage refined `level` times, with points on the limit surface and the limit surface's normals.

    Level 0 is the cage's own polygons. Their normals are area-weighted means, smooth except at infinitely sharp edges;
    with scheme bilinear, the normals are flat. Holes and points without faces are dropped. New faces have the slots of
    the faces that they come from. UV sets and primvars are refined by their interpolation, which is faceVarying for a
    name that `Subdivision.interpolation` lacks. A mesh without subdivision is returned unchanged.

    Raises
    ------
    AssetError
        A tag of the cage is wrong (`cage.read_tags`), or no face remains.
    """
    return refine_all([mesh], [level])[0]


def refine_all(meshes: Sequence[Mesh], levels: Sequence[int]) -> list[Mesh]:
    """Return the meshes, each refined to its level as `refine` does."""
    refined = list(meshes)
    for numbers, level in group_cages(meshes, levels):
        batch = [meshes[i] for i in numbers]
        for number, mesh in zip(numbers, _refine_batch(batch, level), strict=True):
            refined[number] = mesh
    return refined


def group_cages(meshes: Sequence[Mesh], levels: Sequence[int]) -> Iterator[tuple[list[int], int]]:
    """Yield batches of cages as pairs: the indices in `meshes` of the batch's cages, and the level of all of them.

    The cages of a batch also have the same rules, and their UV sets and primvars the same interpolations and widths. A
    batch has about `_BATCH_CORNERS` refined corners; a larger cage is not split.
    """
    groups: dict[tuple[int, *tuple[object, ...]], list[int]] = {}
    for number, (mesh, level) in enumerate(zip(meshes, levels, strict=True)):
        if (rules := mesh.subdivision) is not None:
            value_kinds = tuple((interpolation, values.shape[1:]) for interpolation, values in _values(mesh, rules))
            mesh_rules = (rules.scheme, rules.interpolate_boundary, rules.face_varying, rules.triangle_rule)
            groups.setdefault((level, *mesh_rules, value_kinds), []).append(number)
    for (level, *_), numbers in groups.items():
        corners = np.cumsum([len(meshes[i].corner_points) * 4**level for i in numbers])
        cuts = np.flatnonzero(np.diff(corners // _BATCH_CORNERS)) + 1
        for group in np.split(np.array(numbers), cuts):
            yield group.tolist(), level


def _values(mesh: Mesh, subdivision: Subdivision) -> list[tuple[Interpolation, Floats32]]:
    """Return the interpolation and the values at corners of each UV set, then of each primvar."""
    arrays = [*mesh.uvs.items(), *mesh.primvars.items()]
    return [(subdivision.interpolation.get(name, "faceVarying"), values) for name, values in arrays]


def _refine_batch(meshes: list[Mesh], level: int) -> list[Mesh]:
    """Return the refined meshes of a batch of cages, as `group_cages` yields them."""
    subdivision = meshes[0].subdivision
    assert subdivision is not None, "a batch has cages only"
    refined = refine_cage(join_cages(meshes), subdivision, level)
    face_counts = [len(mesh.face_sizes) for mesh in meshes]
    # The mesh of each refined face, and where each mesh starts among the refined faces and corners.
    face_mesh = np.repeat(np.arange(len(meshes)), face_counts)[refined.origin]
    faces = np.searchsorted(face_mesh, np.arange(len(meshes) + 1))
    corners = np.concatenate([[0], np.cumsum(refined.sizes)])[faces]
    order, rank, points = _points_by_mesh(refined, np.repeat(face_mesh, refined.sizes), len(meshes))
    slots = np.concatenate([mesh.face_slots for mesh in meshes])[refined.origin]
    positions = refined.points[order]
    result = []
    for i, mesh in enumerate(meshes):
        if faces[i] == faces[i + 1]:
            raise AssetError(_no_face_message(mesh))
        corner_slice = slice(corners[i], corners[i + 1])
        arrays = iter([values[corner_slice] for values in refined.values])
        result.append(
            replace(
                mesh,
                points=positions[points[i] : points[i + 1]],
                corner_points=(rank[refined.corners[corner_slice]] - points[i]).astype(np.int32),
                face_sizes=refined.sizes[faces[i] : faces[i + 1]].astype(np.int32),
                face_slots=slots[faces[i] : faces[i + 1]],
                normals=refined.normals[corner_slice],
                tangents=None,
                uvs={name: next(arrays) for name in mesh.uvs},
                primvars={name: next(arrays).reshape(-1, *old.shape[1:]) for name, old in mesh.primvars.items()},
                subdivision=None,
            )
        )
    return result


def join_cages(meshes: list[Mesh]) -> ControlMesh:
    """Join several cages with the same rules to one control mesh, in the order of the cages."""
    all_tags = [read_tags(mesh) for mesh in meshes]
    columns = [_values(mesh, mesh.subdivision) for mesh in meshes if mesh.subdivision is not None]
    points = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    faces = np.cumsum([0, *(len(mesh.face_sizes) for mesh in meshes)])
    return ControlMesh(
        points=np.concatenate([mesh.points for mesh in meshes]).astype(np.float64),
        corners=np.concatenate([mesh.corner_points.astype(np.intp) + points[i] for i, mesh in enumerate(meshes)]),
        sizes=np.concatenate([mesh.face_sizes for mesh in meshes]).astype(np.intp),
        tags=Tags(
            np.concatenate([mesh_tags.crease_edges + points[i] for i, mesh_tags in enumerate(all_tags)]),
            np.concatenate([mesh_tags.crease_sharpness for mesh_tags in all_tags]),
            np.concatenate([mesh_tags.corner_points + points[i] for i, mesh_tags in enumerate(all_tags)]),
            np.concatenate([mesh_tags.corner_sharpness for mesh_tags in all_tags]),
            np.concatenate([mesh_tags.holes + faces[i] for i, mesh_tags in enumerate(all_tags)]),
        ),
        values=[
            (column[0][0], np.concatenate([values.reshape(len(values), -1) for _, values in column]).astype(np.float64))
            for column in zip(*columns, strict=True)
        ],
    )


def _points_by_mesh(refined: RefinedCage, corner_mesh: Indices, count: int) -> tuple[Indices, Indices, Indices]:
    """Sort the refined points by mesh; `corner_mesh` (m,) is the mesh of each corner, `count` the number of meshes.

    Return the sorted point numbers (n,), the position of each point in that order (n,), and the position at which each
    mesh starts, followed by the total (count + 1,). Points without a face come first.
    """
    owner = np.full(len(refined.points), -1)
    owner[refined.corners] = corner_mesh
    order = np.argsort(owner, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return order, rank, np.searchsorted(owner[order], np.arange(count + 1))


def _no_face_message(mesh: Mesh) -> str:
    """Return the message for a cage that has only holes."""
    assert mesh.subdivision is not None
    rule = "; interpolateBoundary 'none' makes the faces at a boundary holes, too"
    why = rule if mesh.subdivision.interpolate_boundary == "none" else ""
    return f"{mesh.name}: every face of the subdivision surface is a hole{why}"
