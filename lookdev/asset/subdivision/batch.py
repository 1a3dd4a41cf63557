"""Cages of an asset, refined: those that share their rules together, so that many small ones cost little."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lookdev.asset.mesh import Interpolation, Mesh, Subdivision
from lookdev.asset.subdivision.cage import Control, Tags, tags
from lookdev.asset.subdivision.refine import Refined, refine_cage
from lookdev.asset.subdivision.topology import Index
from lookdev.errors import AssetError

_BATCH = 1_000_000
"""Refined corners that are made at once: small cages share the cost of a call, and what is freed is used again."""


def refine(mesh: Mesh, level: int) -> Mesh:
    """Return a cage refined `level` times, its points on the limit surface, with the limit surface's normals.

    Level 0 is the cage's own polygons with area-weighted normals, smooth but for infinitely sharp edges (of scheme
    bilinear: flat). Faces that are holes are gone, so are points without faces; faces keep their slots. UV sets and
    primvars are refined by their interpolation, that of names that `Subdivision.interpolation` lacks is faceVarying.
    A mesh without subdivision is returned as it is.

    Raises
    ------
    AssetError
        A tag of the cage is wrong (`cage.tags`), or no face is left.
    """
    return refine_all([mesh], [level])[0]


def refine_all(meshes: Sequence[Mesh], levels: Sequence[int]) -> list[Mesh]:
    """Return `refine` of each mesh at its level."""
    refined = list(meshes)
    for numbers, level in batches(meshes, levels):
        batch = [meshes[i] for i in numbers]
        for number, mesh in zip(numbers, _refine_batch(batch, level), strict=True):
            refined[number] = mesh
    return refined


def batches(meshes: Sequence[Mesh], levels: Sequence[int]) -> Iterator[tuple[list[int], int]]:
    """Yield the numbers of cages of the same level, rules and kinds of values, at most `_BATCH` corners together."""
    groups: dict[tuple[Any, ...], list[int]] = {}
    for number, (mesh, level) in enumerate(zip(meshes, levels, strict=True)):
        if (rules := mesh.subdivision) is not None:
            kinds = tuple((kind, values.shape[1:]) for kind, values in _values(mesh, rules))
            own = (rules.scheme, rules.interpolate_boundary, rules.face_varying, rules.triangle_rule)
            groups.setdefault((level, *own, kinds), []).append(number)
    for (level, *_), numbers in groups.items():
        corners = np.cumsum([len(meshes[i].corner_points) * 4**level for i in numbers])
        cuts = np.flatnonzero(np.diff(corners // _BATCH)) + 1
        for group in np.split(np.array(numbers), cuts):
            yield group.tolist(), level


def _values(mesh: Mesh, rules: Subdivision) -> list[tuple[Interpolation, Any]]:
    """Return the interpolation and the values at corners of each UV set, then of each primvar."""
    both = [*mesh.uvs.items(), *mesh.primvars.items()]
    return [(rules.interpolation.get(name, "faceVarying"), values) for name, values in both]


def _refine_batch(meshes: list[Mesh], level: int) -> list[Mesh]:
    """Return cages that share rules and kinds of values, refined."""
    rules = meshes[0].subdivision
    assert rules is not None, "a batch has cages only"
    refined = refine_cage(joined(meshes), rules, level)
    face_counts = [len(mesh.face_sizes) for mesh in meshes]
    face_mesh = np.repeat(np.arange(len(meshes)), face_counts)[refined.origin]
    faces = np.searchsorted(face_mesh, np.arange(len(meshes) + 1))
    corners = np.concatenate([[0], np.cumsum(refined.sizes)])[faces]
    order, rank, points = _points_by_mesh(refined, np.repeat(face_mesh, refined.sizes), len(meshes))
    slots = np.concatenate([mesh.face_slots for mesh in meshes])[refined.origin]
    positions = refined.points[order]
    result = []
    for i, mesh in enumerate(meshes):
        if faces[i] == faces[i + 1]:
            raise AssetError(_nothing_left(mesh))
        own = slice(corners[i], corners[i + 1])
        uvs = dict(zip(mesh.uvs, [values[own] for values in refined.values], strict=False))
        others = [values[own] for values in refined.values[len(uvs) :]]
        shaped = [each.reshape(-1, *old.shape[1:]) for each, old in zip(others, mesh.primvars.values(), strict=True)]
        result.append(
            replace(
                mesh,
                points=positions[points[i] : points[i + 1]],
                corner_points=(rank[refined.corners[own]] - points[i]).astype(np.int32),
                face_sizes=refined.sizes[faces[i] : faces[i + 1]].astype(np.int32),
                face_slots=slots[faces[i] : faces[i + 1]],
                normals=refined.normals[own],
                tangents=None,
                uvs=uvs,
                primvars=dict(zip(mesh.primvars, shaped, strict=True)),
                subdivision=None,
            )
        )
    return result


def joined(meshes: list[Mesh]) -> Control:
    """Return several cages as one."""
    tagged = [tags(mesh) for mesh in meshes]
    columns = [_values(mesh, mesh.subdivision) for mesh in meshes if mesh.subdivision is not None]
    points = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    faces = np.cumsum([0, *(len(mesh.face_sizes) for mesh in meshes)])
    return Control(
        points=np.concatenate([mesh.points for mesh in meshes]).astype(np.float64),
        corners=np.concatenate([mesh.corner_points.astype(np.intp) + points[i] for i, mesh in enumerate(meshes)]),
        sizes=np.concatenate([mesh.face_sizes for mesh in meshes]).astype(np.intp),
        tags=Tags(
            np.concatenate([each.crease_edges + points[i] for i, each in enumerate(tagged)]),
            np.concatenate([each.crease_sharpness for each in tagged]),
            np.concatenate([each.corner_points + points[i] for i, each in enumerate(tagged)]),
            np.concatenate([each.corner_sharpness for each in tagged]),
            np.concatenate([each.holes + faces[i] for i, each in enumerate(tagged)]),
        ),
        values=[
            (same[0][0], np.concatenate([values.reshape(len(values), -1) for _, values in same]).astype(np.float64))
            for same in zip(*columns, strict=True)
        ],
    )


def _points_by_mesh(refined: Refined, corner_mesh: Index, count: int) -> tuple[Index, Index, Index]:
    """Return the points in the order of their meshes, each point's place in it, and where each mesh's begin.

    Points that no face has are in front.
    """
    owner = np.full(len(refined.points), -1)
    owner[refined.corners] = corner_mesh
    order = np.argsort(owner, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return order, rank, np.searchsorted(owner[order], np.arange(count + 1))


def _nothing_left(mesh: Mesh) -> str:
    assert mesh.subdivision is not None
    rule = ", which with interpolateBoundary 'none' those at a boundary are too"
    why = rule if mesh.subdivision.interpolate_boundary == "none" else ""
    return f"{mesh.name}: every face of the subdivision surface is a hole{why}"
