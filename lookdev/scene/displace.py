"""Displacement: moves the points of an asset along their normals by the heights of its parts' looks.

Every backend and the reference render the displaced arrays. Where the corners at a point differ in normal or height, as
at a hard edge or a seam of a UV set, the point moves by their mean, so that the surface stays closed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np

from lookdev.arrays import Floats, Floats32
from lookdev.asset.mesh import Asset, Instance, Mesh, Subdivision
from lookdev.asset.normals import area_vectors, dot, normalize_or, smooth_normals, sum_by
from lookdev.asset.store import make_asset
from lookdev.asset.tangents import handedness
from lookdev.errors import AssetError
from lookdev.material import Displacement, Look, Primvar
from lookdev.material.points import ImagePoints
from lookdev.material.values import SourceValues

_NORMALS = "lookdev:normals"


def is_displaced(mesh: Mesh, looks: Sequence[Look]) -> bool:
    """Return whether a look of the mesh's faces displaces it; `looks` are those of the slots of its asset."""
    return any(looks[slot].displacement is not None for slot in np.unique(mesh.face_slots))


def as_cage(mesh: Mesh) -> Mesh:
    """Return a mesh that can be refined for displacement; a polygon mesh becomes a bilinear cage.

    During refinement a primvar contains the polygon mesh's normals, which `displace` restores: a smooth sphere of few
    faces stays smooth.
    """
    if mesh.subdivision is not None:
        return mesh
    carried = {**mesh.primvars, _NORMALS: mesh.normals}
    interpolation = dict.fromkeys((*mesh.uvs, *carried), "faceVarying")
    rules = Subdivision("bilinear", face_varying="all", interpolation=interpolation)  # type: ignore[arg-type]
    return replace(mesh, primvars=carried, subdivision=rules)


def displace(asset: Asset, look_of_part: Mapping[str, Look]) -> Asset:
    """Displace the refined meshes of an asset; `look_of_part` maps slots' paths to looks, as `Scene.look_of_slot`.

    A height h moves a point by ``(h - midlevel) scale`` along its normal. `Displacement.units` determines the space and
    the unit of that distance: the object's own space and the unit of the asset's file, or, for "world", the world,
    after the instance's matrix, and metres. In the world, instances of one mesh that differ by more than a translation
    become meshes of their own.

    Raises
    ------
    AssetError
        A height is not finite, or the mesh lacks a UV set that the height depends on.
    """
    looks = [look_of_part[slot.path] for slot in asset.slots]
    meshes: list[Mesh] = []
    instances: list[Instance] = []
    instances_of_mesh: dict[int, list[Instance]] = {}
    for instance in asset.instances:
        instances_of_mesh.setdefault(instance.mesh, []).append(instance)
    for number, mesh in enumerate(asset.meshes):
        if not is_displaced(mesh, looks):
            pieces: Iterable[tuple[Mesh, Sequence[Instance]]] = [(mesh, instances_of_mesh.get(number, ()))]
        else:
            pieces = _displace_mesh(_restore_normals(mesh), looks, instances_of_mesh.get(number, ()), asset.unit)
        for piece, piece_instances in pieces:
            instances += [replace(instance, mesh=len(meshes)) for instance in piece_instances]
            meshes.append(piece)
    if len(meshes) == len(asset.meshes) and all(a is b for a, b in zip(meshes, asset.meshes, strict=True)):
        return asset
    return replace(make_asset(asset.name, meshes, instances, asset.slots), unit=asset.unit, notes=asset.notes)


def _restore_normals(mesh: Mesh) -> Mesh:
    """Return a refined cage of `as_cage` with the normals from its primvar."""
    if (carried := mesh.primvars.get(_NORMALS)) is None:
        return mesh
    primvars = {name: values for name, values in mesh.primvars.items() if name != _NORMALS}
    normals = normalize_or(carried.astype(np.float64), mesh.normals.astype(np.float64))
    return replace(mesh, primvars=primvars, normals=normals.astype(np.float32))


def _displace_mesh(
    mesh: Mesh, looks: Sequence[Look], instances: Sequence[Instance], unit: float
) -> Iterator[tuple[Mesh, Sequence[Instance]]]:
    """Yield the displaced mesh, once for all instances, or once for each linear map of instances to the world."""
    object_heights, world_heights = _heights(mesh, looks, unit)
    if not world_heights.any():
        yield _move_points(mesh, object_heights, world_heights, np.eye(3)), instances
        return
    instances_of_map: dict[bytes, list[Instance]] = {}
    for instance in instances:
        instances_of_map.setdefault(np.ascontiguousarray(instance.matrix[:3, :3]).tobytes(), []).append(instance)
    for map_instances in instances_of_map.values():
        yield _move_points(mesh, object_heights, world_heights, map_instances[0].matrix[:3, :3]), map_instances


def _heights(mesh: Mesh, looks: Sequence[Look], unit: float) -> tuple[Floats, Floats]:
    """Return the displacement of each corner (m,), in metres: in object space, and in the world."""
    corner_slots = np.repeat(mesh.face_slots, mesh.face_sizes)
    object_heights, world_heights = np.zeros((2, len(corner_slots)))
    points = CornerPoints(mesh)
    for slot in np.unique(mesh.face_slots):
        displacement = looks[slot].displacement
        if displacement is None:
            continue
        height = _height(points, displacement)
        is_of_slot = corner_slots == slot
        if not np.isfinite(height[is_of_slot]).all():
            wrong = f"{mesh.name}: the displacement of look '{looks[slot].name}' is not finite"
            raise AssetError(f"{wrong}; its height must be a number everywhere")
        if displacement.units == "world":
            world_heights[is_of_slot] = height[is_of_slot]
        else:
            object_heights[is_of_slot] = height[is_of_slot] * unit
    return object_heights, world_heights


def _height(points: CornerPoints, displacement: Displacement) -> Floats:
    with np.errstate(all="ignore"):  # the caller reports values that are not finite
        height = np.asarray(SourceValues(points).source_value(displacement.height, color=False), np.float64)
        offset = (height - displacement.midlevel) * displacement.scale
    return np.broadcast_to(offset, (len(points.mesh.corner_points),))


def _move_points(mesh: Mesh, object_heights: Floats, world_heights: Floats, linear: Floats) -> Mesh:
    """Move each point by the mean of its corners' displacements; `linear` (3, 3) maps object space to the world."""
    normals = mesh.normals.astype(np.float64)
    count = len(mesh.points)
    offsets = object_heights[:, None] * normals
    if world_heights.any():
        # The world's normal is L^-T n, normalised. L^-1 maps an offset along it to object space.
        inverse = np.linalg.inv(linear)
        offsets = offsets + world_heights[:, None] * (normalize_or(normals @ inverse, normals) @ inverse.T)
    corner_counts = np.maximum(np.bincount(mesh.corner_points, minlength=count), 1)
    moved = mesh.points + sum_by(mesh.corner_points, offsets, count) / corner_counts[:, None]
    points = moved.astype(np.float32)
    rotated = _rotate_normals(normals, _surface_normals(mesh, mesh.points), _surface_normals(mesh, points))
    return replace(mesh, points=points, normals=rotated.astype(np.float32), tangents=None)


def _surface_normals(mesh: Mesh, points: Floats32) -> Floats:
    """Return smooth normals (m, 3) of the mesh with these points."""
    areas = area_vectors(points[mesh.corner_points].astype(np.float64), mesh.face_sizes)
    return smooth_normals(areas, mesh.corner_points, mesh.face_sizes, len(points))


def _rotate_normals(normals: Floats, before: Floats, after: Floats) -> Floats:
    """Rotate shading normals (m, 3) as displacement rotates the surface's normals, from `before` to `after`.

    Hard edges stay hard, smooth faces smooth. The rotation is the shortest one between both unit vectors (Rodrigues),
    without trigonometry. Where the surface is flipped, the result is `after`.
    """
    axis, cosine = np.cross(before, after), dot(before, after)
    is_flipped = cosine < -0.999
    across = np.cross(axis, normals)
    rotated = normals + across + np.cross(axis, across) / np.where(is_flipped, 1.0, 1.0 + cosine)
    return normalize_or(np.where(is_flipped, after, rotated), after)


@dataclass(frozen=True)
class CornerPoints(ImagePoints):
    """The corners of a mesh as a `lookdev.material.values.Surface`."""

    mesh: Mesh

    def uv(self, name: str) -> Floats:
        if name not in self.mesh.uvs:
            names = ", ".join(self.mesh.uvs) or "no UV set at all"
            raise AssetError(f"{self.mesh.name}: a displacement reads the UV set '{name}'; it has: {names}")
        return self.mesh.uvs[name].astype(np.float64)

    def primvar(self, primvar: Primvar) -> Floats:
        values = self.mesh.primvars.get(primvar.name)
        fallback = np.asarray(primvar.fallback, np.float64)
        if values is None:
            return np.broadcast_to(fallback, (len(self.mesh.corner_points), *fallback.shape))
        if values.ndim - 1 != fallback.ndim:
            width = 1 if values.ndim == 1 else values.shape[1]
            expected = 3 if fallback.ndim else 1
            raise AssetError(
                f"{self.mesh.name}: primvar '{primvar.name}' has {width} numbers; the displacement reads {expected}"
            )
        return values.astype(np.float64)

    def handedness(self) -> Floats:
        return handedness(self.mesh).astype(np.float64)

    def view(self) -> NoReturn:
        raise AssetError(f"{self.mesh.name}: a displacement depends on the view; one shape for all would be right")
