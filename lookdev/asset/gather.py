"""Many small meshes as a few large ones: a renderer spends more on a mesh than on its first thousand faces."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.mesh import Asset, Floats, Instance, Mesh
from lookdev.asset.normals import Doubles

# Fewer meshes are left as they are; so are meshes of more faces.
_MANY, _FACES = 64, 1000
_CORNERS = 1 << 20  # of a joined mesh: its arrays are computed in float64
# A step of float32 at the asset's radius, in lengths of a mesh's edges: larger ones would bend its facets.
_STEP = 1e-3


def gathered(asset: Asset) -> Asset:
    """Return an asset about the origin, with its small meshes of a single instance joined: the same surface.

    Meshes are joined that have UV sets and primvars of the same names, and all or none have tangents. Their normals are
    transformed by the inverse transpose of their instance's matrix, without normalisation, so that interpolation
    commutes with it. Meshes stay apart that an instance reflects, and those too fine for float32 so far from the
    origin.
    """
    mesh = np.array([instance.mesh for instance in asset.instances])
    matrices = np.array([instance.matrix for instance in asset.instances])
    once = np.bincount(mesh, minlength=len(asset.meshes))[mesh] == 1
    faces = np.array([len(each.face_sizes) for each in asset.meshes])[mesh]
    if np.count_nonzero(once & (faces <= _FACES)) < _MANY:
        return asset
    volumes = np.linalg.det(matrices[:, :3, :3])
    extents = np.array([np.ptp(each.points, axis=0).max() for each in asset.meshes])[mesh]
    edges = extents * np.cbrt(np.abs(volumes)) / np.sqrt(faces)
    fine = edges * _STEP < asset.radius * np.finfo(np.float32).eps
    chosen = once & (faces <= _FACES) & (volumes > 0.0) & ~fine
    meshes, instances = list[Mesh](), list[Instance]()
    for group in _groups(asset, np.flatnonzero(chosen).tolist()):
        meshes.append(_joined([asset.meshes[mesh[i]] for i in group], matrices[group]))
        instances.append(Instance(len(meshes) - 1, np.eye(4)))
    numbers: dict[int, int] = {}
    for i in np.flatnonzero(~chosen):
        if mesh[i] not in numbers:
            numbers[mesh[i]] = len(meshes)
            meshes.append(asset.meshes[mesh[i]])
        instances.append(replace(asset.instances[i], mesh=numbers[mesh[i]]))
    return replace(asset, meshes=tuple(meshes), instances=tuple(instances))


def unstretched(asset: Asset, meshes: Container[int]) -> Asset:
    """Return an asset whose instances keep the angles of some of its meshes: other matrices deform the mesh instead."""
    made, instances = list(asset.meshes), list[Instance]()
    stretched: dict[tuple[int, bytes], int] = {}
    for instance in asset.instances:
        u, scales, v = np.linalg.svd(instance.matrix[:3, :3])
        if instance.mesh in meshes and np.ptp(scales) > 1e-6 * scales.max():
            # The polar decomposition: a rotation, or a reflection, after a symmetric stretch.
            stretch, matrix = np.eye(4), instance.matrix.copy()
            stretch[:3, :3], matrix[:3, :3] = v.T @ np.diag(scales) @ v, u @ v
            key = instance.mesh, stretch.astype(np.float32).tobytes()
            if key not in stretched:
                stretched[key] = len(made)
                made.append(_joined([asset.meshes[instance.mesh]], stretch[None]))
            instance = replace(instance, mesh=stretched[key], matrix=matrix)
        instances.append(instance)
    return replace(asset, meshes=tuple(made), instances=tuple(instances))


def _groups(asset: Asset, instances: Sequence[int]) -> Iterator[list[int]]:
    """Yield the instances whose meshes are joined."""
    groups: dict[object, list[int]] = {}
    corners: dict[object, int] = {}
    for i in instances:
        mesh = asset.meshes[asset.instances[i].mesh]
        widths = tuple((name, values.ndim) for name, values in mesh.primvars.items())
        layout = mesh.tangents is None, tuple(mesh.uvs), widths
        groups.setdefault(layout, []).append(i)
        corners[layout] = corners.get(layout, 0) + len(mesh.corner_points)
        if corners[layout] >= _CORNERS:
            yield groups.pop(layout)
            del corners[layout]
    yield from groups.values()


def _joined(meshes: Sequence[Mesh], matrices: Doubles) -> Mesh:
    """Return meshes as one, placed by their matrices."""
    linear, offsets = matrices[:, :3, :3], matrices[:, :3, 3]
    # The lengths of normals and tangents have no meaning, and are kept near 1.
    scales = np.cbrt(np.linalg.det(linear))[:, None, None]
    points = np.array([len(mesh.points) for mesh in meshes])
    corners = np.array([len(mesh.corner_points) for mesh in meshes])

    def join(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(mesh, name) for mesh in meshes])

    def turn(name: str, by: Doubles) -> Floats:
        return np.asarray(np.einsum("nij,nj->ni", np.repeat(by, corners, axis=0), join(name)), np.float32)

    placed = np.einsum("nij,nj->ni", np.repeat(linear, points, axis=0), join("points"))
    first_points = (np.cumsum(points) - points).astype(np.int32)
    first = meshes[0]
    return Mesh(
        name=first.name if len(meshes) == 1 else f"{first.name} and {len(meshes) - 1} others",
        points=(placed + np.repeat(offsets, points, axis=0)).astype(np.float32),
        corner_points=join("corner_points") + np.repeat(first_points, corners),
        face_sizes=join("face_sizes"),
        face_slots=join("face_slots"),
        normals=turn("normals", np.swapaxes(np.linalg.inv(linear), 1, 2) * scales),
        tangents=None if first.tangents is None else turn("tangents", linear / scales),
        uvs={name: np.concatenate([mesh.uvs[name] for mesh in meshes]) for name in first.uvs},
        primvars={name: np.concatenate([mesh.primvars[name] for mesh in meshes]) for name in first.primvars},
    )
