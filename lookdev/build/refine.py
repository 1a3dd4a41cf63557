"""From control cages to the meshes that are rendered: refined by their size in the frame, or by the job's own level.

What was refined is kept in the cache, so that the next run of a job reads it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Literal

from lookdev.asset import Asset, Mesh
from lookdev.asset.store import make_asset
from lookdev.asset.subdivision import orbit_pixel, refine_all, refinement_levels
from lookdev.build.geometry_cache import keep_levels, keep_refined, kept_levels, kept_refined, key_of
from lookdev.errors import AssetError
from lookdev.scene import Camera

_MOST_CORNERS = 32_000_000
"""Refined corners of an asset whose level the job gives, about 8 GB while they are made."""


class Refinery:
    """Refines the cages of assets; what several looks show is refined once.

    `level` is that of every cage, or "auto"; `width` is that of the frame, pixels.
    """

    def __init__(self, level: Literal["auto"] | int, width: int) -> None:
        self._level = level
        self._width = width
        # Beside what was made is what it was made of, so that no other object gets its id.
        self._meshes: dict[tuple[int, int], tuple[Mesh, Mesh]] = {}
        self._assets: dict[tuple[int, tuple[int, ...]], tuple[Asset, Asset]] = {}

    def refined(self, asset: Asset, camera: Camera, detailed: Collection[int] = ()) -> tuple[Asset, tuple[str, ...]]:
        """Return an asset without cages, seen by a camera, and notes; `detailed` and errors as `refinement_levels`.

        Raises AssetError, too, where the job's own level makes too many faces.
        """
        if all(mesh.subdivision is None for mesh in asset.meshes):
            return asset, ()
        notes: list[str] = []
        levels = self._levels(asset, camera, detailed, notes)
        key = id(asset), levels
        if key not in self._assets:
            self._assets[key] = self._made(asset, levels, detailed), asset
        return self._assets[key][0], tuple(notes)

    def _made(self, asset: Asset, levels: tuple[int, ...], detailed: Collection[int]) -> Asset:
        wanted = {(id(mesh), level): mesh for mesh, level in zip(asset.meshes, levels, strict=True)}
        key = key_of(asset, detailed, levels)
        # What other looks have in memory already is shared, not read.
        shared = any(each in self._meshes for each in wanted)
        whole = None if shared else kept_refined(key, asset)
        if whole is not None:
            read = zip(asset.meshes, levels, whole.meshes, strict=True)
            self._meshes |= {(id(cage), level): (mesh, cage) for cage, level, mesh in read}
            return whole
        unmade = {each: mesh for each, mesh in wanted.items() if each not in self._meshes}
        made = refine_all(list(unmade.values()), [level for _, level in unmade])
        self._meshes |= {each: (mesh, unmade[each]) for each, mesh in zip(unmade, made, strict=True)}
        meshes = [self._meshes[id(mesh), level][0] for mesh, level in zip(asset.meshes, levels, strict=True)]
        flags = {"convex": asset.convex, "sheet": asset.sheet, "revolved": asset.revolved}
        whole = make_asset(asset.name, meshes, asset.instances, asset.slots, **flags)
        if not shared:
            keep_refined(key, whole)
        return replace(whole, unit=asset.unit, notes=asset.notes)

    def _levels(self, asset: Asset, camera: Camera, detailed: Collection[int], notes: list[str]) -> tuple[int, ...]:
        if self._level == "auto":
            pixel = orbit_pixel(camera.position.tolist(), camera.pivot, 2.0 * camera.reach / self._width)
            seen_from = [*camera.position.tolist(), *camera.pivot, camera.reach, self._width]
            key = key_of(asset, detailed, seen_from)
            chosen = kept_levels(key, len(asset.meshes))
            if chosen is None:
                chosen = refinement_levels(asset, pixel, detailed)
                keep_levels(key, chosen)
            notes += chosen.notes
            return chosen.levels
        levels = [0 if mesh.subdivision is None else self._level for mesh in asset.meshes]
        corners = sum(len(mesh.corner_points) * 4**level for mesh, level in zip(asset.meshes, levels, strict=True))
        if corners > _MOST_CORNERS:
            what = f"{corners} corners of faces; at most {_MOST_CORNERS} would be right"
            raise AssetError(f"subdivision = {self._level} makes {what}, or subdivision = 'auto'")
        return tuple(levels)
