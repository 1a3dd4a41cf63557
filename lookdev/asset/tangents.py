"""Computes a mesh's tangents at its face corners, and their handedness, for looks that read them.

A tangent is the direction in which u grows at constant v. As in MikkTSpace (Mikkelsen, "Simulation of Wrinkled Surfaces
Revisited", 2008), it is the average over the corners that agree in position, normal, UV and UV orientation. A mirrored
or rotated UV island therefore keeps its own tangents along its seam. There are two simplifications. A face has one
tangent, which is exact for a triangle and the mean over a larger polygon. The faces around a corner have equal weights.

Without UVs, tangents follow the longitude about the vertical axis through the middle of the mesh's bounding box.

Arrays are as in `Mesh`, with n points, f faces and m corners. `following` (m,) is the index of the next corner
around the face (`next_corners`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lookdev.arrays import Floats, Floats32, Indices, Reals
from lookdev.asset.mesh import Mesh
from lookdev.asset.normals import (
    AnyInts,
    batch_slices,
    dot,
    face_blocks,
    next_corners,
    normalize_or,
    run_starts,
    sum_by,
)
from lookdev.brdf import vectors

_ROUNDS = 8  # the rounds in which `_group_corners` compares values, before it compares hashes


def perpendicular(normals: Floats) -> Floats:
    """Return a unit vector (..., 3) perpendicular to each unit normal."""
    return np.asarray(vectors.perpendicular(normals))


def tangents_of(meshes: Sequence[Mesh]) -> list[Floats32]:
    """Return the tangents (m, 3) of each mesh; `corner_tangents` computes them for a mesh without tangents."""
    tangents = {i: mesh.tangents for i, mesh in enumerate(meshes) if mesh.tangents is not None}
    for has_uvs in (True, False):
        missing = [i for i, mesh in enumerate(meshes) if i not in tangents and bool(mesh.uvs) == has_uvs]
        for batch in batch_slices([len(meshes[i].corner_points) for i in missing]):
            tangents |= zip(missing[batch], _batch_tangents([meshes[i] for i in missing[batch]]), strict=True)
    return [tangents[i] for i in range(len(meshes))]


def _batch_tangents(meshes: Sequence[Mesh]) -> list[Floats32]:
    """Return the computed tangents (m, 3) of each of several meshes, which all have UVs, or all have none."""
    points, corners = np.array([(len(mesh.points), len(mesh.corner_points)) for mesh in meshes]).T
    first_points = (np.cumsum(points) - points).astype(np.int32)
    uvs = [next(iter(mesh.uvs.values())) for mesh in meshes if mesh.uvs]
    joined_tangents = corner_tangents(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate([mesh.corner_points for mesh in meshes]) + np.repeat(first_points, corners),
        np.concatenate([mesh.face_sizes for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate(uvs) if uvs else None,
        np.repeat(np.arange(len(meshes)), points),
    )
    return np.split(joined_tangents, np.cumsum(corners)[:-1])


def corner_tangents(
    points: Reals,
    corner_points: AnyInts,
    face_sizes: AnyInts,
    normals: Floats32,
    uvs: Floats32 | None,
    meshes: AnyInts | None = None,
) -> Floats32:
    """Return unit tangents (m, 3), orthogonal to the corner normals, from arrays as in `Mesh` and `uvs` (m, 2).

    Without `uvs`, the tangents follow the longitude. Where the UVs cover no area, or the tangents of the faces around a
    corner cancel, the tangent is `perpendicular` to the normal. The arrays may be concatenated from several meshes;
    `meshes` (n,) is then the number of each point's mesh, from 0.
    """
    if uvs is None:
        return _longitude_tangents(points.astype(np.float64), corner_points, face_sizes, normals, meshes)
    orientation, tangents = np.empty(len(face_sizes)), np.empty((len(corner_points), 3))
    for faces, corners in face_blocks(face_sizes):
        sizes, uv = face_sizes[faces], uvs[corners].astype(np.float64)
        following = next_corners(sizes)
        orientation[faces] = _orientation(sizes, following, uv)
        positions = points[corner_points[corners]].astype(np.float64)
        by_face = _face_tangents(positions, sizes, following, uv, orientation[faces])
        tangents[corners] = _orthogonalize(np.repeat(by_face, sizes, axis=0), normals[corners].astype(np.float64))
    # `group` (m,) is the number of each corner's group, and `example` (g,) one corner of each group.
    positions = _number_positions(points, meshes)[corner_points]
    group, example = _group_corners(positions, normals, uvs, np.repeat(orientation.astype(np.int8), face_sizes))
    sums = sum_by(group, tangents, len(example))
    means = np.empty((len(example), 3), np.float32)
    for _, block in face_blocks(np.ones(len(example), np.intp)):
        # A sum of unit vectors that is shorter than 1e-6 is rounding error, and becomes 0.
        reliable_sums = sums[block] * (dot(sums[block], sums[block]) > 1e-12)
        # The corners of a group have equal normals, to which the mean is orthogonal except for rounding.
        n = normals[example[block]].astype(np.float64)
        means[block] = normalize_or(_orthogonalize(reliable_sums, n), perpendicular(n))
    return means[group]


def mix_bits(key: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return a hash of each 64-bit key, by the finaliser of SplitMix64 (Steele et al. 2014)."""
    key = key * np.uint64(0x9E3779B97F4A7C15)
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))


def handedness(mesh: Mesh) -> Floats32:
    """Return the handedness (m,) at each corner: 1 if v grows along cross(normal, tangent), -1 if UVs are mirrored.

    The UVs are those of the mesh's first UV set. The sign is constant over a face. The sign is 1 for a face whose UVs
    cover no area, and for a mesh without UVs. Normal maps need the sign: their green channel tilts normals towards
    increasing v.
    """
    uvs = next(iter(mesh.uvs.values()), np.zeros((len(mesh.corner_points), 2))).astype(np.float64)
    sign = np.where(_orientation(mesh.face_sizes, next_corners(mesh.face_sizes), uvs) < 0.0, -1.0, 1.0)
    return np.repeat(sign, mesh.face_sizes).astype(np.float32)


def _orientation(face_sizes: AnyInts, following: AnyInts, uvs: Floats) -> Floats:
    """Return the orientation (f,) of each face's UVs: 1 with the face's winding, -1 if mirrored, 0 without area."""
    starts = run_starts(face_sizes)
    first = np.repeat(uvs[starts], face_sizes, axis=0)
    u, v = (uvs - first).T
    uv_area = np.add.reduceat(u * v[following] - u[following] * v, starts)
    extent = np.maximum.reduceat(np.maximum(np.abs(u), np.abs(v)), starts)
    # UVs are float32. An area that is smaller than their rounding errors has no orientation.
    rounding = np.finfo(np.float32).eps * extent * np.maximum(np.abs(first[starts]).max(axis=-1), extent)
    return np.where(np.abs(uv_area) > rounding, np.sign(uv_area), 0.0)


def _face_tangents(
    positions: Floats, face_sizes: AnyInts, following: AnyInts, uvs: Floats, orientation: Floats
) -> Floats:
    """Return each face's tangent (f, 3), which is not a unit vector; it is zero for a face without orientation.

    `positions` (m, 3) and `uvs` (m, 2) are given at the corners. Let P be the position and N the face's normal. By
    Stokes' theorem, the integral of v dP around a face is the integral of N x grad v over the face. The tangent dP/du
    points along grad v x N if the UVs have the face's winding, and against it if they are mirrored.
    """
    starts = run_starts(face_sizes)
    v = uvs[:, 1] - np.repeat(uvs[starts, 1], face_sizes)
    circulation = (0.5 * (v + v[following]))[:, None] * (positions[following] - positions)
    return np.asarray(-orientation[:, None] * np.add.reduceat(circulation, starts, axis=0))


def _orthogonalize(vectors: Floats, normals: Floats) -> Floats:
    """Return the vectors (k, 3) orthogonalised against their unit normals (Gram-Schmidt) and normalised.

    A vector of length 0, or one along its normal, becomes zero.
    """
    unit = normalize_or(vectors, np.zeros(3))
    remainder = unit - dot(unit, normals) * normals
    remainder *= dot(remainder, remainder) > 1e-12
    return normalize_or(remainder, np.zeros(3))


def _longitude_tangents(
    points: Floats, corner_points: AnyInts, face_sizes: AnyInts, normals: Floats32, meshes: AnyInts | None
) -> Floats32:
    """Return unit tangents (m, 3) around the vertical axis of each mesh, counter-clockwise seen from above.

    On the axis, the tangent is `perpendicular` to the normal. `meshes` (n,) is as in `corner_tangents`.
    """
    starts = np.flatnonzero(np.diff(meshes, prepend=-1)) if meshes is not None else np.zeros(1, np.intp)
    middle = 0.5 * (np.minimum.reduceat(points, starts) + np.maximum.reduceat(points, starts))
    x, y, z = (points - np.repeat(middle, np.diff(np.append(starts, len(points))), axis=0)).T
    around = np.stack([-y, x, 0.0 * z], axis=-1)
    tangents = np.empty((len(corner_points), 3), np.float32)
    for _, corners in face_blocks(face_sizes):
        n = normals[corners].astype(np.float64)
        # The vectors are orthogonalised twice, since the normals have unit length only to float32 precision.
        by_corner = _orthogonalize(_orthogonalize(around[corner_points[corners]], n), n)
        tangents[corners] = normalize_or(by_corner, perpendicular(n))
    return tangents


def _number_positions(points: Reals, meshes: AnyInts | None) -> Indices:
    """Return a number (n,) for each point, which is the same for points of one mesh at the same position."""
    key = _hash_rows(points) if meshes is None else mix_bits(_hash_rows(points) ^ meshes.astype(np.uint64))
    sorted_keys = np.sort(key)
    if (sorted_keys[1:] != sorted_keys[:-1]).all():
        return np.arange(len(key))
    return np.asarray(np.unique(key, return_inverse=True)[1])


def _group_corners(
    positions: Indices, normals: Floats32, uvs: Floats32, orientation: NDArray[np.int8]
) -> tuple[Indices, Indices]:
    """Group the corners that are equal in position, normal, UV and orientation.

    `positions` (m,) are the numbers of `_number_positions`. Return the number (m,) of each corner's group, and one
    corner (g,) of each of the g groups.

    Each round takes one corner of each position, and groups it with all corners that equal it. Corners that remain
    after `_ROUNDS` rounds, around points with many normals, are compared by a 64-bit hash.
    """
    columns = (*normals.T, *uvs.T, orientation)
    group = np.empty(len(positions), np.intp)
    remaining = np.arange(len(positions))
    examples: list[Indices] = []
    count = 0
    for _ in range(_ROUNDS):
        example = np.full(int(positions.max()) + 1, -1)
        example[positions[remaining]] = remaining
        number = np.cumsum(example >= 0) + (count - 1)
        equal = np.empty(len(remaining), bool)
        for _, block in face_blocks(np.ones(len(remaining), np.intp)):
            corner, other = remaining[block], example[positions[remaining[block]]]
            equal[block] = np.logical_and.reduce([column[corner] == column[other] for column in columns])
        group[remaining[equal]] = number[positions[remaining[equal]]]
        examples.append(example[example >= 0])
        count += len(examples[-1])
        remaining = remaining[~equal]
        if len(remaining) == 0:
            return group, np.concatenate(examples)
    key = mix_bits(
        _hash_rows(np.column_stack([column[remaining] for column in columns])) ^ positions[remaining].astype(np.uint64)
    )
    _, first, numbers = np.unique(key, return_index=True, return_inverse=True)
    group[remaining] = numbers + count
    return group, np.concatenate([*examples, remaining[first]])


def _hash_rows(rows: Reals) -> NDArray[np.uint64]:
    """Return a hash (k,) of each row of an array (k, w), from the row's values in float32."""
    single = rows.astype(np.float32) + np.float32(0.0)  # -0 becomes 0
    key = np.zeros(len(single), np.uint64)
    for column in single.view(np.uint32).T:
        key = mix_bits(key ^ column)
    return key
