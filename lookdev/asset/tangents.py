"""Tangents of a mesh: the direction in which u grows at constant v, one for each face corner, and their handedness.

As in MikkTSpace (Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008), corners are averaged that share
position, normal, UV and the orientation of their UVs, so that a mirrored or rotated UV island keeps its own direction
along its seam. Two simplifications: a face has one tangent, exact for a triangle and the mean over a larger polygon,
and the faces around a corner have equal weights.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.mesh import Floats, Ints, Mesh
from lookdev.asset.normals import Doubles, dot, face_starts, next_corners, sum_by, unit_or


def perpendicular(normals: Doubles) -> Doubles:
    """Return a unit vector (..., 3) perpendicular to each unit normal, without branches or singularities.

    Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017, listing 3, vector b1.
    """
    x, y, z = normals[..., 0], normals[..., 1], normals[..., 2]
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    return np.stack([1.0 + sign * x * x * a, sign * x * y * a, -sign * x], axis=-1)


def corner_tangents(points: Floats, corner_points: Ints, face_sizes: Ints, normals: Floats, uvs: Floats) -> Floats:
    """Return unit tangents (m, 3), orthogonal to the corner normals, of arrays as in `Mesh`, `uvs` (m, 2).

    Where the UVs cover no area or the faces around a corner cancel, it is `perpendicular` of the normal.
    """
    positions = points[corner_points].astype(np.float64)
    n = normals.astype(np.float64)
    orientation = _orientation(face_sizes, uvs.astype(np.float64))
    faces = _face_tangents(positions, face_sizes, uvs.astype(np.float64), orientation)
    tangents = _orthogonal(np.repeat(faces, face_sizes, axis=0), n)
    group = _groups(positions, n, uvs, np.repeat(orientation, face_sizes))
    sums = sum_by(group, tangents, int(np.max(group)) + 1)[group]
    # A sum of unit vectors shorter than this is rounding.
    sums *= dot(sums, sums) > 1e-12
    # Normals of one group are equal only to float32: project once more for exact orthogonality.
    return unit_or(_orthogonal(sums, n), perpendicular(n)).astype(np.float32)


def handedness(mesh: Mesh) -> Floats:
    """Return 1 for each corner (m,) where v grows along cross(normal, tangent), -1 where the UVs are mirrored.

    Of the mesh's first UV set, constant over a face, 1 where its UVs cover no area. The green channel of a normal map
    leans along increasing v.
    """
    uvs = next(iter(mesh.uvs.values())).astype(np.float64)
    sign = np.where(_orientation(mesh.face_sizes, uvs) < 0.0, -1.0, 1.0)
    return np.repeat(sign, mesh.face_sizes).astype(np.float32)


def _orientation(face_sizes: Ints, uvs: Doubles) -> Doubles:
    """Return each face's sign (f,): 1 where its UVs wind like it, -1 where they are mirrored, 0 without area."""
    starts, following = face_starts(face_sizes), next_corners(face_sizes)
    first = np.repeat(uvs[starts], face_sizes, axis=0)
    u, v = (uvs - first).T
    uv_area = np.add.reduceat(u * v[following] - u[following] * v, starts)
    extent = np.maximum.reduceat(np.maximum(np.abs(u), np.abs(v)), starts)
    # UVs are float32: an area below their rounding has no orientation.
    rounding = np.finfo(np.float32).eps * extent * np.maximum(np.abs(first[starts]).max(axis=-1), extent)
    return np.where(np.abs(uv_area) > rounding, np.sign(uv_area), 0.0)


def _face_tangents(positions: Doubles, face_sizes: Ints, uvs: Doubles, orientation: Doubles) -> Doubles:
    """Return each face's tangent (f, 3), zero where there is none.

    By Stokes' theorem the integral of v dP around a face is the integral of (N x grad v) over it, and dP/du
    points along (grad v x N) where the UVs wind like the face, against it where they are mirrored.
    """
    starts, following = face_starts(face_sizes), next_corners(face_sizes)
    v = uvs[:, 1] - np.repeat(uvs[starts, 1], face_sizes)
    circulation = (0.5 * (v + v[following]))[:, None] * (positions[following] - positions)
    return np.asarray(-orientation[:, None] * np.add.reduceat(circulation, starts, axis=0))


def _orthogonal(vectors: Doubles, normals: Doubles) -> Doubles:
    """Return each vector made orthogonal to its unit normal (Gram-Schmidt), unit or zero."""
    unit = unit_or(vectors, np.zeros(3))
    rest = unit - dot(unit, normals) * normals
    rest *= dot(rest, rest) > 1e-12
    return unit_or(rest, np.zeros(3))


def _groups(positions: Doubles, normals: Doubles, uvs: Floats, orientation: Doubles) -> NDArray[np.intp]:
    """Number the corners (m,) so that those equal in all columns have the same number.

    Rows are compared by a 64-bit hash: sorting one integer column is ten times faster than sorting nine, and a
    collision among ten million corners (probability 3e-6) averages two tangents.
    """
    columns = np.column_stack([positions, normals, uvs, orientation]).astype(np.float32)
    columns += 0.0  # -0 becomes 0
    key = np.zeros(len(columns), np.uint64)
    for column in columns.view(np.uint32).T:
        # The finaliser of SplitMix64 (Steele et al. 2014) after each column.
        key = (key ^ column) * np.uint64(0x9E3779B97F4A7C15)
        key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        key ^= key >> np.uint64(31)
    return np.asarray(np.unique(key, return_inverse=True)[1])
