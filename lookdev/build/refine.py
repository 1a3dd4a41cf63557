"""Refinement of control cages to the rendered meshes.

A *cage* is a mesh with subdivision rules. Refinement to level n divides each face of the cage into 4^n faces. A job
states the level, or it follows from the size of the cage in the frame. The cache stores refined assets, levels of
refinement and outlines for the next run of a job. The key of an entry is a digest of everything that the entry depends
on, including the code that computes it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset import Asset, Mesh, read_asset, save_asset
from lookdev.asset.silhouette import hull_points
from lookdev.asset.store import asset_digest, make_asset
from lookdev.asset.subdivision import Refinement, orbit_pixel_size, refine_all, refinement_levels
from lookdev.cache import Content, cached_file, code_digest, load_cached, store_cached
from lookdev.errors import AssetError
from lookdev.material import Look
from lookdev.scene import Camera
from lookdev.scene.displace import as_cage, is_displaced

_ROOM = "refined"  # the folder of the cache for refined assets and levels of refinement

_MAX_CORNERS = 32_000_000
"""The maximum number of corners of an asset after refinement, if the job states the level.

This many corners take about 8 GB during refinement."""


class Refiner:
    """Refines the cages of assets; a mesh that several looks share is refined only once.

    `level` is the level of every cage. With "auto", the level of a cage follows from its size in the frame. `width` is
    the width of the frame in pixels.
    """

    def __init__(self, level: Literal["auto"] | int, width: int) -> None:
        self._level = level
        self._width = width
        # A key is the id of a cage or an asset, with its level or levels. A value is the refined mesh or asset, and the
        # object that has the id: this keeps the object alive and its id unique.
        self._meshes: dict[tuple[int, int], tuple[Mesh, Mesh]] = {}
        self._assets: dict[tuple[int, tuple[int, ...]], tuple[Asset, Asset]] = {}

    def refine(self, asset: Asset, camera: Camera, displaced: Collection[int] = ()) -> tuple[Asset, tuple[str, ...]]:
        """Return the asset with its cages refined for a camera, and notes for the user.

        `displaced` has the indices of the meshes that looks displace. Raises the AssetError of `refinement_levels`, and
        an AssetError if the level that the job states makes too many corners of faces.
        """
        if all(mesh.subdivision is None for mesh in asset.meshes):
            return asset, ()
        refinement = self._levels(asset, camera, displaced)
        key = id(asset), refinement.levels
        if key not in self._assets:
            self._assets[key] = self._refine(asset, refinement.levels, displaced), asset
        return self._assets[key][0], refinement.notes

    def _refine(self, asset: Asset, levels: tuple[int, ...], displaced: Collection[int]) -> Asset:
        """Return the asset with each mesh refined to its level, from the cache if possible."""
        cages = {(id(mesh), level): mesh for mesh, level in zip(asset.meshes, levels, strict=True)}
        key = geometry_key(asset, displaced, levels)
        # If another look has some of the meshes in memory, they are shared instead of read from the cache.
        has_shared_mesh = any(cage_key in self._meshes for cage_key in cages)
        refined = None if has_shared_mesh else _load_refined(key, asset)
        if refined is not None:
            loaded = zip(asset.meshes, levels, refined.meshes, strict=True)
            self._meshes |= {(id(cage), level): (mesh, cage) for cage, level, mesh in loaded}
            return refined
        missing = {cage_key: cage for cage_key, cage in cages.items() if cage_key not in self._meshes}
        meshes = refine_all(list(missing.values()), [level for _, level in missing])
        self._meshes |= {cage_key: (mesh, missing[cage_key]) for cage_key, mesh in zip(missing, meshes, strict=True)}
        meshes = [self._meshes[id(cage), level][0] for cage, level in zip(asset.meshes, levels, strict=True)]
        flags = {"convex": asset.convex, "sheet": asset.sheet, "revolved": asset.revolved}
        refined = make_asset(asset.name, meshes, asset.instances, asset.slots, **flags)
        if not has_shared_mesh:
            file = Content.store_copy(save_asset(refined))
            store_cached(_ROOM, key, {"asset": [file.digest, file.suffix]})
        return replace(refined, unit=asset.unit, notes=asset.notes)

    def _levels(self, asset: Asset, camera: Camera, displaced: Collection[int]) -> Refinement:
        """Return the level of refinement of each mesh, and notes for the user."""
        if self._level == "auto":
            pixel_size = orbit_pixel_size(camera.position.tolist(), camera.pivot, 2.0 * camera.half_width / self._width)
            view = [*camera.position.tolist(), *camera.pivot, camera.half_width, self._width]
            key = geometry_key(asset, displaced, view)
            refinement = _load_levels(key, len(asset.meshes))
            if refinement is None:
                refinement = refinement_levels(asset, pixel_size, displaced)
                store_cached(_ROOM, key, {"levels": refinement.levels, "notes": refinement.notes})
            return refinement
        levels = [0 if mesh.subdivision is None else self._level for mesh in asset.meshes]
        corners = sum(len(mesh.corner_points) * 4**level for mesh, level in zip(asset.meshes, levels, strict=True))
        if corners > _MAX_CORNERS:
            count = f"{corners} corners of faces; at most {_MAX_CORNERS} would be right"
            raise AssetError(f"subdivision = {self._level} makes {count}, or subdivision = 'auto'")
        return Refinement(tuple(levels), ())


def cages_of_displaced(asset: Asset, looks: Mapping[str, Look]) -> tuple[Asset, Sequence[int]]:
    """Return the asset with cages in place of the meshes that its looks displace, and the indices of these meshes."""
    slot_looks = [looks[slot.path] for slot in asset.slots]
    if all(look.displacement is None for look in slot_looks):
        return asset, ()
    displaced = [number for number, mesh in enumerate(asset.meshes) if is_displaced(mesh, slot_looks)]
    meshes = list(asset.meshes)
    for number in displaced:
        meshes[number] = as_cage(meshes[number])
    return replace(asset, meshes=tuple(meshes)), displaced


def geometry_key(asset: Asset, displaced: Collection[int], parameters: Sequence[float]) -> str:
    """Return the cache key of a result that depends on an asset, its displaced meshes, and numbers.

    `displaced` has the indices of the displaced meshes. `parameters` are levels of refinement, or numbers of a camera.
    """
    digest = asset.digest or asset_digest(asset)
    content = [code_digest("asset"), digest, sorted(displaced), list(parameters)]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _load_levels(key: str, count: int) -> Refinement | None:
    """Return the levels of `count` meshes from the cache; None if the cache does not have them."""
    match load_cached(_ROOM, key):
        case {"levels": [*levels], "notes": [*notes]} if len(levels) == count:
            return Refinement(tuple(levels), tuple(notes))
    return None


def _load_refined(key: str, cages: Asset) -> Asset | None:
    """Return the refined asset of `cages` from the cache; None if the cache does not have it."""
    match load_cached(_ROOM, key):
        case {"asset": [digest, suffix]} if (file := Content(digest, suffix)).is_whole():
            loaded = read_asset(file.path)
        case _:
            return None
    # The file has only the data that affect pixels; the other fields are copied from the cages.
    meshes = [replace(mesh, default_uv=cage.default_uv) for mesh, cage in zip(loaded.meshes, cages.meshes, strict=True)]
    return replace(loaded, meshes=tuple(meshes), instances=cages.instances, unit=cages.unit, notes=cages.notes)


def cached_outline(asset: Asset) -> Floats:
    """Return the `hull_points` (n, 3) of an asset, which a camera frames.

    The cache stores the points if the asset has several instances.
    """
    if len(asset.instances) == 1:
        return hull_points(asset.meshes, asset.instances)
    key = geometry_key(asset, (), ())
    file = cached_file("outlines", key, ".npy", lambda path: np.save(path, hull_points(asset.meshes, asset.instances)))
    return np.asarray(np.load(file.path))
