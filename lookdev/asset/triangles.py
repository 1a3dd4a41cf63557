"""Splits polygons into triangles, in the same way as Cycles."""

from __future__ import annotations

import numpy as np

from lookdev.arrays import Floats, Ints
from lookdev.asset.mesh import Mesh
from lookdev.asset.normals import area_vectors, run_starts


def triangulate(mesh: Mesh) -> Mesh:
    """Return a mesh with its polygons split into triangles."""
    triangles, faces = corner_triangles(mesh)
    return mesh.with_corners(triangles.ravel(), np.full(len(faces), 3, np.int32), faces)


def corner_triangles(mesh: Mesh) -> tuple[Ints, Ints]:
    """Return the corners (t, 3) of each of the mesh's t triangles, and the face (t,) that the triangle comes from.

    Corners are indices into the mesh's arrays over corners. A polygon becomes a fan about its first corner if the fan
    stays inside the polygon. Otherwise a quad is split along its other diagonal, and a larger polygon by ear clipping.
    """
    sizes, starts = mesh.face_sizes.astype(np.int64), run_starts(mesh.face_sizes)
    positions = mesh.points[mesh.corner_points].astype(np.float64)
    # The number of triangles of each face, and the face of each triangle.
    counts = sizes - 2
    faces = np.repeat(np.arange(len(sizes)), counts)
    ends = np.cumsum(counts)
    # The number of each triangle in the fan of its face.
    number = np.arange(len(faces)) - np.repeat(ends - counts, counts)
    first = starts[faces]
    triangles = np.stack([first, first + number + 1, first + number + 2], axis=-1)
    corners = positions[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # A fan leaves its polygon if the winding of a triangle is opposite to the polygon's. For a quad, Blender compares
    # the two triangles with each other instead: where `number` is 1, the triangle is the second of a quad, and `other`
    # is the area vector of the first.
    whole = area_vectors(positions, mesh.face_sizes)[faces]
    other = np.roll(areas, 1, axis=0)
    outside = np.where(
        sizes[faces] == 4, (number == 1) & ((areas * other).sum(axis=-1) < 0.0), (areas * whole).sum(axis=-1) < 0.0
    )
    for face in np.unique(faces[outside & (sizes[faces] > 3)]):
        corner_numbers = starts[face] + np.arange(sizes[face])
        if sizes[face] == 4:
            split = corner_numbers[[[0, 1, 3], [1, 2, 3]]]
        else:
            normal = area_vectors(positions[corner_numbers], np.array([sizes[face]], np.int32))[0]
            split = corner_numbers[_clip_ears(positions[corner_numbers], normal)]
        triangles[ends[face] - counts[face] : ends[face]] = split
    return triangles, faces


def _clip_ears(polygon: Floats, normal: Floats) -> Ints:
    """Return n - 2 triangles (n - 2, 3) of a polygon (n, 3), as numbers of its corners.

    Each step cuts off an ear, which is a triangle of three consecutive corners that contains no other corner. Of all
    ears, the best-shaped is cut off: its area is the largest, relative to the square of its longest side.
    """
    # The polygon is projected along the axis nearest to the normal, so that it is a counter-clockwise plane polygon.
    axis = int(np.abs(normal).argmax())
    axes = [(axis + 1) % 3, (axis + 2) % 3]
    flat = polygon[:, axes if normal[axis] > 0.0 else axes[::-1]]
    remaining = np.arange(len(polygon))
    ears = []
    while len(remaining) > 3:
        before, after = np.roll(remaining, 1), np.roll(remaining, -1)
        # The corners a, b, c of the triangle at each remaining corner, and all remaining corners p.
        a, b, c, p = flat[before, None], flat[remaining, None], flat[after, None], flat[None, remaining]
        inside = (
            (_signed_double_area(a, b, p) >= 0.0)
            & (_signed_double_area(b, c, p) >= 0.0)
            & (_signed_double_area(c, a, p) >= 0.0)
        )
        inside &= (remaining != before[:, None]) & (remaining != remaining[:, None]) & (remaining != after[:, None])
        longest = np.max([((x - y) ** 2).sum(axis=-1)[:, 0] for x, y in ((a, b), (b, c), (c, a))], axis=0)
        # A triangle with a corner inside gets a penalty of 2, more than shapes can differ. A self-intersecting polygon
        # may have only such triangles; then the best-shaped of them is cut off.
        shape = _signed_double_area(a, b, c)[:, 0] / np.where(longest > 0.0, longest, 1.0) - 2.0 * inside.any(axis=1)
        best = int(shape.argmax())
        ears.append([before[best], remaining[best], after[best]])
        remaining = np.delete(remaining, best)
    return np.array([*ears, remaining], np.int64)


def _signed_double_area(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return twice the signed area of triangles with corners (..., 2); it is positive if they are counter-clockwise."""
    ab, ac = b - a, c - a
    return np.asarray(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])
