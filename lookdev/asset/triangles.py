"""Polygons as triangles, split as Cycles splits them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.mesh import Mesh
from lookdev.asset.normals import area_vectors, face_starts

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def triangulated(mesh: Mesh) -> Mesh:
    """Return a mesh with a face for each of its triangles."""
    triangles, faces = corner_triangles(mesh)
    corners = triangles.ravel()
    return replace(
        mesh,
        corner_points=mesh.corner_points[corners],
        face_sizes=np.full(len(faces), 3, np.int32),
        face_slots=mesh.face_slots[faces],
        normals=mesh.normals[corners],
        tangents=None if mesh.tangents is None else mesh.tangents[corners],
        uvs={name: uv[corners] for name, uv in mesh.uvs.items()},
        primvars={name: values[corners] for name, values in mesh.primvars.items()},
    )


def corner_triangles(mesh: Mesh) -> tuple[Ints, Ints]:
    """Return the corners (T, 3) and the face (T,) of each triangle of a mesh.

    A polygon is a fan about its first corner where that stays inside it; else a quad is split along its other diagonal,
    and a larger polygon by ear clipping.
    """
    sizes, starts = mesh.face_sizes.astype(np.int64), face_starts(mesh.face_sizes)
    positions = mesh.points[mesh.corner_points].astype(np.float64)
    counts = sizes - 2
    faces = np.repeat(np.arange(len(sizes)), counts)
    ends = np.cumsum(counts)
    number = np.arange(len(faces)) - np.repeat(ends - counts, counts)
    first = starts[faces]
    triangles = np.stack([first, first + number + 1, first + number + 2], axis=-1)
    corners = positions[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Of a quad, Blender compares the two halves with each other.
    whole = area_vectors(positions, mesh.face_sizes)[faces]
    other = np.roll(areas, 1, axis=0)
    outside = np.where(
        sizes[faces] == 4, (number == 1) & ((areas * other).sum(axis=-1) < 0.0), (areas * whole).sum(axis=-1) < 0.0
    )
    for face in np.unique(faces[outside & (sizes[faces] > 3)]):
        mine = starts[face] + np.arange(sizes[face])
        if sizes[face] == 4:
            split = mine[[[0, 1, 3], [1, 2, 3]]]
        else:
            normal = area_vectors(positions[mine], np.array([sizes[face]], np.int32))[0]
            split = mine[_ears(positions[mine], normal)]
        triangles[ends[face] - counts[face] : ends[face]] = split
    return triangles, faces


def _ears(polygon: Floats, normal: Floats) -> Ints:
    """Cut a polygon (n, 3) into n - 2 triangles: at each step the empty triangle of the best shape."""
    # Projected along the axis nearest to the normal, counter-clockwise.
    axis = int(np.abs(normal).argmax())
    kept = [(axis + 1) % 3, (axis + 2) % 3]
    flat = polygon[:, kept if normal[axis] > 0.0 else kept[::-1]]
    left = np.arange(len(polygon))
    ears = []
    while len(left) > 3:
        before, after = np.roll(left, 1), np.roll(left, -1)
        a, b, c, p = flat[before, None], flat[left, None], flat[after, None], flat[None, left]
        inside = (_turn(a, b, p) >= 0.0) & (_turn(b, c, p) >= 0.0) & (_turn(c, a, p) >= 0.0)
        inside &= (left != before[:, None]) & (left != left[:, None]) & (left != after[:, None])
        longest = np.max([((x - y) ** 2).sum(axis=-1)[:, 0] for x, y in ((a, b), (b, c), (c, a))], axis=0)
        # A polygon that crosses itself may have no ear: then the best shape is cut all the same.
        shape = _turn(a, b, c)[:, 0] / np.where(longest > 0.0, longest, 1.0) - 2.0 * inside.any(axis=1)
        best = int(shape.argmax())
        ears.append([before[best], left[best], after[best]])
        left = np.delete(left, best)
    return np.array([*ears, left], np.int64)


def _turn(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return twice the area of plane triangles, positive counter-clockwise."""
    ab, ac = b - a, c - a
    return np.asarray(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])
