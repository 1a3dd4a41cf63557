"""Joins the small meshes of an asset into a few large ones, which cost a renderer less.

For a renderer, one more mesh costs more than a thousand more faces. `move_stretch_to_meshes` applies the stretch of
instances to the points of their meshes.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import replace

import numpy as np

from lookdev.arrays import Floats, Floats32
from lookdev.asset.mesh import Asset, Instance, Mesh

# Meshes of at most `_MAX_FACES` faces are joined, if there are at least `_MIN_MESHES` of them.
_MIN_MESHES, _MAX_FACES = 64, 1000
_JOINED_CORNERS = 1 << 20  # a joined mesh with this many corners gets no more: its arrays are computed in float64
# A joined mesh has its points in world space, where a large step of float32 would bend the facets. This is the largest
# step at the asset's radius, relative to the edge length of a mesh that is joined.
_MAX_STEP = 1e-3


def join_small_meshes(asset: Asset) -> Asset:
    """Return an asset with the same surface, in which small meshes with a single instance are joined.

    The given asset is centred at the origin. Meshes are joined if their UV sets and primvars have the same names, and
    all or none have tangents. A mesh is not joined if its instance reflects it, or if it is too fine for float32 at the
    asset's radius. Normals are transformed by the inverse transpose of the instance's matrix, and are not normalised.
    An interpolated normal therefore has the same direction as if normals were transformed after interpolation.
    """
    mesh_numbers = np.array([instance.mesh for instance in asset.instances])
    matrices = np.array([instance.matrix for instance in asset.instances])
    is_single = np.bincount(mesh_numbers, minlength=len(asset.meshes))[mesh_numbers] == 1
    faces = np.array([len(mesh.face_sizes) for mesh in asset.meshes])[mesh_numbers]
    if np.count_nonzero(is_single & (faces <= _MAX_FACES)) < _MIN_MESHES:
        return asset
    # For each instance: the factor by which its matrix scales volumes, and an estimate of its edge length in metres.
    volumes = np.linalg.det(matrices[:, :3, :3])
    extents = np.array([np.ptp(mesh.points, axis=0).max() for mesh in asset.meshes])[mesh_numbers]
    edges = extents * np.cbrt(np.abs(volumes)) / np.sqrt(faces)
    is_fine = edges * _MAX_STEP < asset.radius * np.finfo(np.float32).eps
    is_joined = is_single & (faces <= _MAX_FACES) & (volumes > 0.0) & ~is_fine
    meshes, instances = list[Mesh](), list[Instance]()
    for group in _join_groups(asset, np.flatnonzero(is_joined).tolist()):
        meshes.append(_join_meshes([asset.meshes[mesh_numbers[i]] for i in group], matrices[group]))
        instances.append(Instance(len(meshes) - 1, np.eye(4)))
    new_numbers: dict[int, int] = {}
    for i in np.flatnonzero(~is_joined):
        number = mesh_numbers[i]
        if number not in new_numbers:
            new_numbers[number] = len(meshes)
            meshes.append(asset.meshes[number])
        instances.append(replace(asset.instances[i], mesh=new_numbers[number]))
    return replace(asset, meshes=tuple(meshes), instances=tuple(instances))


def move_stretch_to_meshes(asset: Asset, meshes: Container[int]) -> Asset:
    """Return the asset, changed so that the matrices of all instances of the given meshes preserve angles.

    `meshes` has the numbers of the given meshes. If a matrix does not preserve angles, its stretch is applied to the
    points of a new mesh. The instance then refers to the new mesh, and its matrix keeps the rotation or reflection
    and the translation.
    """
    new_meshes, instances = list(asset.meshes), list[Instance]()
    # By the number of a mesh and the bytes of a stretch: the number of the stretched mesh.
    numbers: dict[tuple[int, bytes], int] = {}
    for instance in asset.instances:
        u, scales, v = np.linalg.svd(instance.matrix[:3, :3])
        if instance.mesh in meshes and np.ptp(scales) > 1e-6 * scales.max():
            # The polar decomposition: a rotation, or a reflection, after a symmetric stretch.
            stretch, matrix = np.eye(4), instance.matrix.copy()
            stretch[:3, :3], matrix[:3, :3] = v.T @ np.diag(scales) @ v, u @ v
            key = instance.mesh, stretch.astype(np.float32).tobytes()
            if key not in numbers:
                numbers[key] = len(new_meshes)
                new_meshes.append(_join_meshes([asset.meshes[instance.mesh]], stretch[None]))
            instance = replace(instance, mesh=numbers[key], matrix=matrix)
        instances.append(instance)
    return replace(asset, meshes=tuple(new_meshes), instances=tuple(instances))


def _join_groups(asset: Asset, instances: Sequence[int]) -> Iterator[list[int]]:
    """Yield groups of the given instances, as lists of numbers; the meshes of a group are joined to one mesh."""
    # The layout of a mesh is whether it has tangents, its UV sets, and its primvars with their dimensions. By layout:
    # the instances of the unfinished group, and the number of corners of their meshes.
    groups: dict[object, list[int]] = {}
    corners: dict[object, int] = {}
    for i in instances:
        mesh = asset.meshes[asset.instances[i].mesh]
        widths = tuple((name, values.ndim) for name, values in mesh.primvars.items())
        layout = mesh.tangents is None, tuple(mesh.uvs), widths
        groups.setdefault(layout, []).append(i)
        corners[layout] = corners.get(layout, 0) + len(mesh.corner_points)
        if corners[layout] >= _JOINED_CORNERS:
            yield groups.pop(layout)
            del corners[layout]
    yield from groups.values()


def _join_meshes(meshes: Sequence[Mesh], matrices: Floats) -> Mesh:
    """Return one mesh that joins k meshes; `matrices` (k, 4, 4) has the matrix that transforms each mesh."""
    linear, offsets = matrices[:, :3, :3], matrices[:, :3, 3]
    # Only the directions of normals and tangents matter; the scales bring their lengths near 1.
    scales = np.cbrt(np.linalg.det(linear))[:, None, None]
    # The numbers of points and of corners of each mesh.
    points = np.array([len(mesh.points) for mesh in meshes])
    corners = np.array([len(mesh.corner_points) for mesh in meshes])

    def transform(name: str, matrices: Floats) -> Floats32:
        """Return the normals or tangents (m, 3) of all k meshes, transformed by the meshes' matrices (k, 3, 3)."""
        vectors = np.concatenate([getattr(mesh, name) for mesh in meshes])
        return np.asarray(np.einsum("nij,nj->ni", np.repeat(matrices, corners, axis=0), vectors), np.float32)

    mesh_points = np.concatenate([mesh.points for mesh in meshes])
    world_points = np.einsum("nij,nj->ni", np.repeat(linear, points, axis=0), mesh_points)
    point_starts = (np.cumsum(points) - points).astype(np.int32)
    first = meshes[0]
    return Mesh(
        name=first.name if len(meshes) == 1 else f"{first.name} and {len(meshes) - 1} others",
        points=(world_points + np.repeat(offsets, points, axis=0)).astype(np.float32),
        corner_points=np.concatenate([mesh.corner_points for mesh in meshes]) + np.repeat(point_starts, corners),
        face_sizes=np.concatenate([mesh.face_sizes for mesh in meshes]),
        face_slots=np.concatenate([mesh.face_slots for mesh in meshes]),
        normals=transform("normals", np.swapaxes(np.linalg.inv(linear), 1, 2) * scales),
        tangents=None if first.tangents is None else transform("tangents", linear / scales),
        uvs={name: np.concatenate([mesh.uvs[name] for mesh in meshes]) for name in first.uvs},
        primvars={name: np.concatenate([mesh.primvars[name] for mesh in meshes]) for name in first.primvars},
    )
