"""Normals of polygons and of their corners, from points alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.mesh import Ints

Doubles = NDArray[np.float64]


def face_starts(face_sizes: Ints) -> NDArray[np.intp]:
    """Return the index (f,) of each face's first corner."""
    return np.cumsum(face_sizes, dtype=np.intp) - face_sizes


def next_corners(face_sizes: Ints) -> NDArray[np.intp]:
    """Return the index (m,) of the corner that follows each one around its face."""
    following = np.arange(1, int(face_sizes.sum()) + 1)
    starts = face_starts(face_sizes)
    following[starts + face_sizes - 1] = starts
    return following


def area_vectors(corner_positions: Doubles, face_sizes: Ints) -> Doubles:
    """Return each face's area times its unit normal (f, 3), by Newell's method; faces need not be planar.

    `corner_positions` is (m, 3), counter-clockwise seen from outside.
    """
    starts = face_starts(face_sizes)
    # Relative to a corner of the face: far from the origin the cross products cancel.
    local = corner_positions - np.repeat(corner_positions[starts], face_sizes, axis=0)
    crosses = np.cross(local, local[next_corners(face_sizes)])
    return np.asarray(0.5 * np.add.reduceat(crosses, starts, axis=0))


def unit_or(vectors: Doubles, fallback: Doubles) -> Doubles:
    """Normalise vectors (..., 3); a vector of length 0 becomes `fallback` (broadcast)."""
    # Squares of lengths and areas of float32 data neither overflow nor underflow in float64.
    squares = dot(vectors, vectors)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(squares > 0.0, vectors / np.sqrt(squares), fallback)


def dot(a: Doubles, b: Doubles) -> Doubles:
    """Return the dot product over the last axis, kept as an axis of length 1."""
    return np.asarray(np.einsum("...i,...i", a, b)[..., None])


def sum_by(group: NDArray[np.signedinteger[Any]], vectors: Doubles, count: int) -> Doubles:
    """Return the sum (count, 3) of the vectors (m, 3) of each group (m,)."""
    sums = [np.bincount(group, vectors[:, i], count) for i in range(3)]
    return np.stack(sums, axis=-1).astype(np.float64)


def flat_normals(areas: Doubles, face_sizes: Ints) -> Doubles:
    """Return unit normals (m, 3) that are constant over each face, from `area_vectors`; +z without area."""
    return np.repeat(unit_or(areas, np.array([0.0, 0.0, 1.0])), face_sizes, axis=0)


def smooth_normals(areas: Doubles, corner_points: Ints, face_sizes: Ints, point_count: int) -> Doubles:
    """Return unit normals (m, 3): at each point the area-weighted mean of its faces' normals; where 0, the face's."""
    sums = sum_by(corner_points, np.repeat(areas, face_sizes, axis=0), point_count)
    return unit_or(sums[corner_points], flat_normals(areas, face_sizes))
