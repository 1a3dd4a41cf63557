"""Computes normals of polygons and of their corners from the points, and has helpers for arrays over faces.

In this module there are f faces, which have m corners altogether. The corners of a face are consecutive in arrays (m,);
`face_sizes` (f,) are the numbers of corners of the faces. A run is a range of consecutive elements of an array.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lookdev.arrays import Floats, Indices, Ints, Ints32, Reals

AnyInts = Ints | Ints32 | Indices
_Number = TypeVar("_Number", bound=np.generic)

_BLOCK_CORNERS = 1 << 13  # the most corners of a slice of several faces that `face_blocks` yields
_BATCH_CORNERS = 1 << 18  # with this many corners, a slice of meshes that `batch_slices` yields is complete
# The most corners of a face for `_same_size_area_vectors`. NumPy adds seven or fewer numbers in their order, regardless
# of their layout in memory.
_FEW_CORNERS = 7


def concatenate(arrays: Sequence[NDArray[_Number]]) -> NDArray[_Number]:
    """Concatenate arrays; a single array is returned without a copy."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def run_starts(lengths: AnyInts) -> Indices:
    """Return the start index (k,) of each of k consecutive runs, such as the corners of faces, from their lengths."""
    return np.cumsum(lengths, dtype=np.intp) - lengths


def next_corners(face_sizes: AnyInts) -> Indices:
    """Return, for each corner, the index (m,) of the next corner around its face."""
    ends = np.cumsum(face_sizes, dtype=np.intp)
    following = np.arange(1, (int(ends[-1]) if len(ends) else 0) + 1)
    following[ends - 1] = ends - face_sizes
    return following


def face_blocks(face_sizes: AnyInts) -> Iterator[tuple[slice, slice]]:
    """Yield pairs of slices: some consecutive faces, and the corners of these faces.

    Arrays over one slice fit into the processor's cache.
    """
    ends = np.cumsum(face_sizes, dtype=np.intp)
    face = corner = 0
    while face < len(ends):
        stop = max(int(np.searchsorted(ends, corner + _BLOCK_CORNERS, side="right")), face + 1)
        yield slice(face, stop), slice(corner, int(ends[stop - 1]))
        face, corner = stop, int(ends[stop - 1])


def batch_slices(corners: Sequence[int]) -> Iterator[slice]:
    """Yield slices of consecutive meshes, from the number of corners of each mesh.

    A slice has enough corners to outweigh the cost of NumPy's calls, and few enough to need little memory.
    """
    start = total = 0
    for number, count in enumerate(corners):
        total += count
        if total >= _BATCH_CORNERS or number == len(corners) - 1:
            yield slice(start, number + 1)
            start, total = number + 1, 0


def area_vectors(corner_positions: Floats, face_sizes: AnyInts) -> Floats:
    """Return each face's area times its unit normal (f, 3), by Newell's method; faces need not be planar.

    `corner_positions` (m, 3) are counter-clockwise when seen from outside.
    """
    if len(face_sizes) and (size := face_sizes[0]) <= _FEW_CORNERS and (face_sizes == size).all():
        return _same_size_area_vectors(corner_positions.reshape(-1, size, 3))
    starts = run_starts(face_sizes)
    # Positions are relative to the first corner of the face: far from the origin, the cross products would cancel.
    local = corner_positions - np.repeat(corner_positions[starts], face_sizes, axis=0)
    x, y, z = local.T
    u, v, w = local[next_corners(face_sizes)].T
    crosses = np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
    return np.asarray(0.5 * np.add.reduceat(crosses, starts, axis=0) + 0.0)


def _same_size_area_vectors(corner_positions: Floats) -> Floats:
    """Return the result of `area_vectors`, bit for bit, in a third of the time, for f faces of n corners each.

    `corner_positions` is (f, n, 3).
    """
    # Axes: coordinate, corner of the face, face.
    by_corner = np.ascontiguousarray(corner_positions.transpose(2, 1, 0))
    x, y, z = local = by_corner - by_corner[:, :1]
    u, v, w = np.roll(local, -1, axis=1)
    crosses = y * w - z * v, z * u - x * w, x * v - y * u
    # Adding 0 makes every zero positive; without it, the sign of a zero depends on the layout of the arrays.
    return np.asarray(0.5 * np.stack([component.sum(axis=0) for component in crosses], axis=-1) + 0.0)


def normalize_or(vectors: Floats, fallback: Reals) -> Floats:
    """Normalise vectors (..., 3); vectors of length 0 are replaced by `fallback`, broadcast to the same shape."""
    # The vectors are lengths or areas of float32 data, whose squares neither overflow nor underflow in float64.
    squares = dot(vectors, vectors)
    has_length = squares > 0.0
    if has_length.all():
        return np.asarray(vectors / np.sqrt(squares))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(has_length, vectors / np.sqrt(squares), fallback)


def dot(a: Floats, b: Floats) -> Floats:
    """Return the dot products of vectors (..., k) over their last axis, with shape (..., 1)."""
    return np.asarray(np.einsum("...i,...i", a, b)[..., None])


def sum_by(group: AnyInts, vectors: Floats, count: int) -> Floats:
    """Return the sums (count, k) of vectors by group; `group` (m,) is the group of each vector (m, k), from 0."""
    return np.stack([np.bincount(group, column, count) for column in vectors.T], axis=-1).astype(np.float64)


def flat_normals(areas: Floats, face_sizes: AnyInts) -> Floats:
    """Return unit normals (m, 3) at corners, constant over each face, from the faces' `area_vectors` (f, 3).

    A face without area has the normal +z.
    """
    return np.repeat(normalize_or(areas, np.array([0.0, 0.0, 1.0])), face_sizes, axis=0)


def smooth_normals(areas: Floats, corner_points: AnyInts, face_sizes: AnyInts, point_count: int) -> Floats:
    """Return unit normals (m, 3) at corners: the area-weighted mean of the normals of all faces around the point.

    `areas` (f, 3) are the `area_vectors`, and `corner_points` (m,) the point at each corner. If the mean is 0, the
    corner has the normal of its face.
    """
    sums = sum_by(corner_points, np.repeat(areas, face_sizes, axis=0), point_count)
    return normalize_or(sums[corner_points], flat_normals(areas, face_sizes))
