"""Normals of polygons and of their corners, computed from the points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lookdev.arrays import Floats, Indices, Ints, Ints32, Reals

AnyInts = Ints | Ints32 | Indices
_Number = TypeVar("_Number", bound=np.generic)

_BLOCK_CORNERS = 1 << 13  # of the faces in a slice of `blocks`
_BATCH_CORNERS = 1 << 18  # of the meshes in a slice of `batch_slices`
_FEW_CORNERS = 7  # of a face; NumPy adds that few numbers one after the other, whatever their layout


def concatenate(arrays: Sequence[NDArray[_Number]]) -> NDArray[_Number]:
    """Concatenate arrays; a single array is returned without a copy."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def run_starts(lengths: AnyInts) -> Indices:
    """Return the start (k,) of each of consecutive runs, such as the corners of faces, from their lengths (k,)."""
    return np.cumsum(lengths, dtype=np.intp) - lengths


def next_corners(face_sizes: AnyInts) -> Indices:
    """Return the index (m,) of the next corner around the face, for each corner."""
    ends = np.cumsum(face_sizes, dtype=np.intp)
    following = np.arange(1, (int(ends[-1]) if len(ends) else 0) + 1)
    following[ends - 1] = ends - face_sizes
    return following


def blocks(face_sizes: AnyInts) -> Iterator[tuple[slice, slice]]:
    """Yield slices of faces and of their corners; arrays over one slice fit into the processor's cache."""
    ends = np.cumsum(face_sizes, dtype=np.intp)
    face = corner = 0
    while face < len(ends):
        stop = max(int(np.searchsorted(ends, corner + _BLOCK_CORNERS, side="right")), face + 1)
        yield slice(face, stop), slice(corner, int(ends[stop - 1]))
        face, corner = stop, int(ends[stop - 1])


def batch_slices(corners: Sequence[int]) -> Iterator[slice]:
    """Yield slices of meshes by their numbers of corners: large enough to outweigh NumPy's calls, small in memory."""
    start = total = 0
    for number, count in enumerate(corners):
        total += count
        if total >= _BATCH_CORNERS or number == len(corners) - 1:
            yield slice(start, number + 1)
            start, total = number + 1, 0


def area_vectors(corner_positions: Floats, face_sizes: AnyInts) -> Floats:
    """Return each face's area times its unit normal (f, 3), by Newell's method; faces need not be planar.

    `corner_positions` is (m, 3), counter-clockwise when seen from outside.
    """
    if len(face_sizes) and (size := face_sizes[0]) <= _FEW_CORNERS and (face_sizes == size).all():
        return _same_size_area_vectors(corner_positions.reshape(-1, size, 3))
    starts = run_starts(face_sizes)
    # Relative to a corner of the face: far from the origin the cross products cancel.
    local = corner_positions - np.repeat(corner_positions[starts], face_sizes, axis=0)
    x, y, z = local.T
    u, v, w = local[next_corners(face_sizes)].T
    crosses = np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
    return np.asarray(0.5 * np.add.reduceat(crosses, starts, axis=0) + 0.0)


def _same_size_area_vectors(corner_positions: Floats) -> Floats:
    """Return `area_vectors` of faces with equal numbers of corners (f, n, 3): the same bits in a third of the time."""
    by_corner = np.ascontiguousarray(corner_positions.transpose(2, 1, 0))
    x, y, z = local = by_corner - by_corner[:, :1]
    u, v, w = np.roll(local, -1, axis=1)
    crosses = y * w - z * v, z * u - x * w, x * v - y * u
    # Adding 0 makes every zero positive: its sign depends on the layout.
    return np.asarray(0.5 * np.stack([component.sum(axis=0) for component in crosses], axis=-1) + 0.0)


def normalize_or(vectors: Floats, fallback: Reals) -> Floats:
    """Normalise vectors (..., 3); a vector of length 0 becomes `fallback` (broadcast)."""
    # Squares of lengths and areas of float32 data neither overflow nor underflow in float64.
    squares = dot(vectors, vectors)
    has_length = squares > 0.0
    if has_length.all():
        return np.asarray(vectors / np.sqrt(squares))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(has_length, vectors / np.sqrt(squares), fallback)


def dot(a: Floats, b: Floats) -> Floats:
    """Return the dot product over the last axis, which becomes an axis of length 1."""
    return np.asarray(np.einsum("...i,...i", a, b)[..., None])


def sum_by(group: AnyInts, vectors: Floats, count: int) -> Floats:
    """Return the sum (count, k) of the vectors (m, k) of each group (m,)."""
    return np.stack([np.bincount(group, column, count) for column in vectors.T], axis=-1).astype(np.float64)


def flat_normals(areas: Floats, face_sizes: AnyInts) -> Floats:
    """Return unit normals (m, 3), constant over each face, from `area_vectors`; +z for a face without area."""
    return np.repeat(normalize_or(areas, np.array([0.0, 0.0, 1.0])), face_sizes, axis=0)


def smooth_normals(areas: Floats, corner_points: AnyInts, face_sizes: AnyInts, point_count: int) -> Floats:
    """Return unit normals (m, 3): the area-weighted mean over the faces of a point; if that is 0, the face's own."""
    sums = sum_by(corner_points, np.repeat(areas, face_sizes, axis=0), point_count)
    return normalize_or(sums[corner_points], flat_normals(areas, face_sizes))
