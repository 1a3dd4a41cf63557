"""Displacement: the points of an asset moved along their normals, as the looks that its parts wear say.

The displaced arrays are what every backend and the reference see. At a point where corners differ in normal or height,
as at a hard edge or a seam of a UV set, the mean of both is taken, so that the surface stays closed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.mesh import Asset, Instance, Mesh, Subdivision
from lookdev.asset.normals import area_vectors, dot, smooth_normals, sum_by, unit_or
from lookdev.asset.store import make_asset
from lookdev.asset.tangents import handedness
from lookdev.errors import AssetError
from lookdev.material import Displacement, Look, Primvar
from lookdev.material.points import ImagePoints
from lookdev.material.values import Values

Doubles = NDArray[np.float64]

_NORMALS = "lookdev:normals"


def is_displaced(mesh: Mesh, looks: Sequence[Look]) -> bool:
    """Return whether a look of the mesh's faces displaces it; `looks` are those of the slots of its asset."""
    return any(looks[slot].displacement is not None for slot in np.unique(mesh.face_slots))


def as_cage(mesh: Mesh) -> Mesh:
    """Return a mesh that can be refined to carry a displacement: a polygon mesh as a bilinear cage with its normals.

    Its normals are a primvar while it is refined, which `displace` takes back: a smooth sphere of few faces stays
    smooth.
    """
    if mesh.subdivision is not None:
        return mesh
    carried = {**mesh.primvars, _NORMALS: mesh.normals}
    interpolation = dict.fromkeys((*mesh.uvs, *carried), "faceVarying")
    rules = Subdivision("bilinear", face_varying="all", interpolation=interpolation)  # type: ignore[arg-type]
    return replace(mesh, primvars=carried, subdivision=rules)


def displace(asset: Asset, wears: Mapping[str, Look]) -> Asset:
    """Displace the meshes of an asset, which are refined already; `wears` is as in `Scene`.

    A height h moves a point by ``(h - midlevel) scale`` along its normal: in the object's own space and the units of
    the asset's file, or in the world, in metres, after the instance's matrix. In the world, instances of one mesh that
    differ by more than a translation become meshes of their own.

    Raises
    ------
    AssetError
        A height is not finite, or the mesh lacks a UV set that it is read by.
    """
    looks = [wears[slot.path] for slot in asset.slots]
    meshes: list[Mesh] = []
    instances: list[Instance] = []
    users: dict[int, list[Instance]] = {}
    for instance in asset.instances:
        users.setdefault(instance.mesh, []).append(instance)
    for number, mesh in enumerate(asset.meshes):
        if not is_displaced(mesh, looks):
            made: Iterable[tuple[Mesh, Sequence[Instance]]] = [(mesh, users.get(number, ()))]
        else:
            made = _displaced(_with_own_normals(mesh), looks, users.get(number, ()), asset.unit)
        for each, placed in made:
            instances += [replace(instance, mesh=len(meshes)) for instance in placed]
            meshes.append(each)
    if len(meshes) == len(asset.meshes) and all(a is b for a, b in zip(meshes, asset.meshes, strict=True)):
        return asset
    return replace(make_asset(asset.name, meshes, instances, asset.slots), unit=asset.unit, notes=asset.notes)


def _with_own_normals(mesh: Mesh) -> Mesh:
    """Return a refined cage of `as_cage` with the normals that it carried."""
    if (carried := mesh.primvars.get(_NORMALS)) is None:
        return mesh
    primvars = {name: values for name, values in mesh.primvars.items() if name != _NORMALS}
    normals = unit_or(carried.astype(np.float64), mesh.normals.astype(np.float64))
    return replace(mesh, primvars=primvars, normals=normals.astype(np.float32))


def _displaced(
    mesh: Mesh, looks: Sequence[Look], placed: Sequence[Instance], unit: float
) -> Iterator[tuple[Mesh, Sequence[Instance]]]:
    """Yield the mesh displaced, once for all instances, or for each shape that they give it in the world."""
    own, world = _heights(mesh, looks, unit)
    if not world.any():
        yield _moved(mesh, own, world, np.eye(3)), placed
        return
    shapes: dict[bytes, list[Instance]] = {}
    for instance in placed:
        shapes.setdefault(np.ascontiguousarray(instance.matrix[:3, :3]).tobytes(), []).append(instance)
    for members in shapes.values():
        yield _moved(mesh, own, world, members[0].matrix[:3, :3]), members


def _heights(mesh: Mesh, looks: Sequence[Look], unit: float) -> tuple[Doubles, Doubles]:
    """Return the displacement of each corner (m,), in metres: in object space, and in the world."""
    corner_slots = np.repeat(mesh.face_slots, mesh.face_sizes)
    own, world = np.zeros((2, len(corner_slots)))
    points = Corners(mesh)
    for slot in np.unique(mesh.face_slots):
        displacement = looks[slot].displacement
        if displacement is None:
            continue
        height = _height(points, displacement)
        here = corner_slots == slot
        if not np.isfinite(height[here]).all():
            what = (
                f"the displacement of look '{looks[slot].name}' is not finite; its height must be a number everywhere"
            )
            raise AssetError(f"{mesh.name}: {what}")
        if displacement.units == "world":
            world[here] = height[here]
        else:
            own[here] = height[here] * unit
    return own, world


def _height(points: Corners, displacement: Displacement) -> Doubles:
    with np.errstate(all="ignore"):  # what is not finite is reported
        height = np.asarray(Values(points).read(displacement.height, color=False), np.float64)
        offset = (height - displacement.midlevel) * displacement.scale
    return np.broadcast_to(offset, (len(points.mesh.corner_points),))


def _moved(mesh: Mesh, own: Doubles, world: Doubles, linear: Doubles) -> Mesh:
    """Move each point by the mean of its corners' displacements; `linear` (3, 3) maps object space to the world."""
    normals = mesh.normals.astype(np.float64)
    count = len(mesh.points)
    offsets = own[:, None] * normals
    if world.any():
        # A height h along the world's normal, L^-T n normalised, is h L^-1 of it in object space.
        inverse = np.linalg.inv(linear)
        offsets = offsets + world[:, None] * (unit_or(normals @ inverse, normals) @ inverse.T)
    used = np.maximum(np.bincount(mesh.corner_points, minlength=count), 1)
    moved = mesh.points + sum_by(mesh.corner_points, offsets, count) / used[:, None]
    points = moved.astype(np.float32)
    turned = _turned(normals, _surface_normals(mesh, mesh.points), _surface_normals(mesh, points)).astype(np.float32)
    return replace(mesh, points=points, normals=turned, tangents=None)


def _surface_normals(mesh: Mesh, points: NDArray[np.float32]) -> Doubles:
    """Return smooth normals (m, 3) of the mesh with these points."""
    areas = area_vectors(points[mesh.corner_points].astype(np.float64), mesh.face_sizes)
    return smooth_normals(areas, mesh.corner_points, mesh.face_sizes, len(points))


def _turned(normals: Doubles, before: Doubles, after: Doubles) -> Doubles:
    """Turn shading normals (m, 3) as displacement turns the surface's own: hard edges stay hard, smooth faces smooth.

    The rotation that takes one unit vector to the other the shortest way (Rodrigues), without trigonometry; where the
    surface is turned over, it is the new normal itself.
    """
    axis, cosine = np.cross(before, after), dot(before, after)
    over = cosine < -0.999
    across = np.cross(axis, normals)
    turned = normals + across + np.cross(axis, across) / np.where(over, 1.0, 1.0 + cosine)
    return unit_or(np.where(over, after, turned), after)


@dataclass(frozen=True)
class Corners(ImagePoints):
    """The corners of a mesh as a `lookdev.material.values.Surface`."""

    mesh: Mesh

    def uv(self, name: str) -> Doubles:
        if name not in self.mesh.uvs:
            known = ", ".join(self.mesh.uvs) or "no UV set at all"
            raise AssetError(f"{self.mesh.name}: a displacement reads the UV set '{name}'; it has: {known}")
        return self.mesh.uvs[name].astype(np.float64)

    def primvar(self, primvar: Primvar) -> Doubles:
        values = self.mesh.primvars.get(primvar.name)
        fallback = np.asarray(primvar.fallback, np.float64)
        if values is None:
            return np.broadcast_to(fallback, (len(self.mesh.corner_points), *fallback.shape))
        if values.ndim - 1 != fallback.ndim:
            width = 1 if values.ndim == 1 else values.shape[1]
            wanted = 3 if fallback.ndim else 1
            raise AssetError(
                f"{self.mesh.name}: primvar '{primvar.name}' has {width} numbers; the displacement reads {wanted}"
            )
        return values.astype(np.float64)

    def handedness(self) -> Doubles:
        return handedness(self.mesh).astype(np.float64)

    def view(self) -> NoReturn:
        raise AssetError(f"{self.mesh.name}: a displacement depends on the view; one shape for all would be right")
