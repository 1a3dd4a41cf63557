"""Refined assets, levels of refinement and outlines in the cache, which later runs read.

The key is a digest of all that the result depends on, including the code that computes it.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset import Asset, read_asset, save_asset
from lookdev.asset.silhouette import hull_points
from lookdev.asset.store import asset_digest
from lookdev.asset.subdivision import Refinement
from lookdev.cache import Content, cached_files, code_digest, load_cached, store_cached

_ROOM = "refined"


def geometry_key(asset: Asset, detailed: Collection[int], parameters: Sequence[float]) -> str:
    """Return the key of a result that depends on an asset, its meshes `detailed`, and a camera or levels."""
    digest = asset.digest or asset_digest(asset)
    content = [code_digest("asset"), digest, sorted(detailed), list(parameters)]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def store_levels(key: str, refinement: Refinement) -> None:
    """Write levels and their notes to the cache."""
    store_cached(_ROOM, key, {"levels": refinement.levels, "notes": refinement.notes})


def load_levels(key: str, count: int) -> Refinement | None:
    """Return the levels of `count` meshes from the cache; None if it does not have them."""
    match load_cached(_ROOM, key):
        case {"levels": [*levels], "notes": [*notes]} if len(levels) == count:
            return Refinement(tuple(levels), tuple(notes))
    return None


def store_refined(key: str, asset: Asset) -> None:
    """Write a refined asset to the cache."""
    file = Content.of(save_asset(asset))
    store_cached(_ROOM, key, {"asset": [file.digest, file.suffix]})


def load_refined(key: str, cages: Asset) -> Asset | None:
    """Return the refined asset of some cages from the cache; None if it does not have it."""
    match load_cached(_ROOM, key):
        case {"asset": [digest, suffix]} if (file := Content(digest, suffix)).is_whole():
            read = read_asset(file.path)
        case _:
            return None
    # The file has only the data that pixels depend on; the rest is that of the cages.
    meshes = [replace(mesh, default_uv=cage.default_uv) for mesh, cage in zip(read.meshes, cages.meshes, strict=True)]
    return replace(read, meshes=tuple(meshes), instances=cages.instances, unit=cages.unit, notes=cages.notes)


def cached_outline(asset: Asset) -> Floats:
    """Return the `hull_points` of an asset, (n, 3); the cache stores it if the asset has several instances."""
    if len(asset.instances) == 1:
        return hull_points(asset)

    def compute() -> tuple[Content, ...]:
        data = io.BytesIO()
        np.save(data, hull_points(asset))
        return (Content.holding(data.getvalue(), ".npy"),)

    (file,) = cached_files("outlines", geometry_key(asset, (), ()), compute)
    return np.asarray(np.load(file.path))
