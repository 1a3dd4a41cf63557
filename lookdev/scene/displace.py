"""Displacement: moves the points of an asset's meshes along their normals, by the heights that looks define.

All renderers get the displaced arrays. At a hard edge or a seam of a UV set, the corners at one point differ in normal
or height. The point then moves by the mean of their displacements, so that the surface stays closed.
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

_NORMALS = "lookdev:normals"  # the primvar of a cage with the normals of the polygon mesh


def is_displaced(mesh: Mesh, looks: Sequence[Look]) -> bool:
    """Return whether the look of any face displaces the mesh; `looks` has the look of each slot of its asset."""
    return any(looks[slot].displacement is not None for slot in np.unique(mesh.face_slots))


def as_cage(mesh: Mesh) -> Mesh:
    """Return a mesh that can be refined for displacement; a polygon mesh becomes the cage of a bilinear surface.

    A primvar of the cage has the normals of the polygon mesh. The refinement interpolates them, and `displace` then
    uses them as normals, so that a smooth sphere of few faces stays smooth.
    """
    if mesh.subdivision is not None:
        return mesh
    carried = {**mesh.primvars, _NORMALS: mesh.normals}
    interpolation = dict.fromkeys((*mesh.uvs, *carried), "faceVarying")
    rules = Subdivision("bilinear", face_varying="all", interpolation=interpolation)  # type: ignore[arg-type]
    return replace(mesh, primvars=carried, subdivision=rules)


def displace(asset: Asset, look_of_slot: Mapping[str, Look]) -> Asset:
    """Return the asset with displaced meshes; the caller has refined the meshes that looks displace.

    `look_of_slot` maps the paths of slots to looks, as `Scene.look_of_slot`. A height h moves a point by
    ``(h - midlevel) scale`` along its normal. `Displacement.units` determines where this distance is measured. In
    "world", it is in metres in world space, after the instance's matrix. Otherwise it is in the object's own space, in
    the unit of the asset's file. With "world", instances of a mesh that differ by more than a translation get meshes of
    their own.

    Raises
    ------
    AssetError
        A height is not finite, or the mesh lacks a UV set that the height depends on.
    """
    looks = [look_of_slot[slot.path] for slot in asset.slots]
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
    """Return a refined cage of `as_cage` with the normals from its primvar, which is removed."""
    if (carried := mesh.primvars.get(_NORMALS)) is None:
        return mesh
    primvars = {name: values for name, values in mesh.primvars.items() if name != _NORMALS}
    normals = normalize_or(carried.astype(np.float64), mesh.normals.astype(np.float64))
    return replace(mesh, primvars=primvars, normals=normals.astype(np.float32))


def _displace_mesh(
    mesh: Mesh, looks: Sequence[Look], instances: Sequence[Instance], unit: float
) -> Iterator[tuple[Mesh, Sequence[Instance]]]:
    """Yield displaced meshes, each with its instances.

    There is one mesh for all instances, or, if heights are in the world, one for each linear map from object space to
    the world. `unit` is the length in metres of a unit of the asset's file.
    """
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
    """Return the displacements of corners (m,) in metres: first in object space, then in the world."""
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
    """Return ``(h - midlevel) scale`` at each corner (m,), which need not be finite."""
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
        # L is the matrix `linear`. The normal in the world is L^-T n, normalised; L^-1 maps an offset along it to
        # object space. Normals and offsets are rows here, so the transposed matrices are on the right.
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
    """Rotate shading normals by the rotations between surface normals, from `before` to `after`; all are (m, 3).

    Hard edges stay hard, and smooth faces stay smooth. The rotation is the shortest one between the two unit vectors,
    by Rodrigues' formula without trigonometry. Where displacement flips the surface, the result is `after`.
    """
    axis, cosine = np.cross(before, after), dot(before, after)
    is_flipped = cosine < -0.999
    across = np.cross(axis, normals)
    rotated = normals + across + np.cross(axis, across) / np.where(is_flipped, 1.0, 1.0 + cosine)
    return normalize_or(np.where(is_flipped, after, rotated), after)


@dataclass(frozen=True)
class CornerPoints(ImagePoints):
    """The corners of a mesh as the points at which a look's height is evaluated (`lookdev.material.values.Surface`)."""

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
