"""Refined assets, levels of refinement and outlines that are kept in the cache from one run to the next.

What is kept is the levels, or the name of the file of a refined asset, which the render worker reads too, or of an
outline. The key is that of all that the result depends on, the code that makes it included.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lookdev.asset import Asset, read_asset, save_asset
from lookdev.asset.silhouette import outline
from lookdev.asset.store import asset_digest
from lookdev.asset.subdivision import Refinement
from lookdev.cache import Content, code_digest, derived, keep, kept

_ROOM = "refined"


def key_of(asset: Asset, detailed: Collection[int], by: Sequence[float]) -> str:
    """Return the key of what becomes of an asset, of which some meshes carry detail, by a camera or by levels."""
    digest = asset.digest or asset_digest(asset)
    return hashlib.sha256(json.dumps([code_digest("asset"), digest, sorted(detailed), list(by)]).encode()).hexdigest()


def keep_levels(key: str, chosen: Refinement) -> None:
    """Write levels and their notes to the cache."""
    keep(_ROOM, key, {"levels": chosen.levels, "notes": chosen.notes})


def kept_levels(key: str, count: int) -> Refinement | None:
    """Return the levels of so many meshes that `keep_levels` wrote; None where there are none."""
    match kept(_ROOM, key):
        case {"levels": [*levels], "notes": [*own]} if len(levels) == count:
            return Refinement(tuple(levels), tuple(own))
    return None


def keep_refined(key: str, whole: Asset) -> None:
    """Write a refined asset to the cache."""
    file = Content.of(save_asset(whole))
    keep(_ROOM, key, {"asset": [file.digest, file.suffix]})


def kept_refined(key: str, cages: Asset) -> Asset | None:
    """Return the refined asset of some cages that `keep_refined` wrote; None where there is none."""
    match kept(_ROOM, key):
        case {"asset": [digest, suffix]} if (file := Content(digest, suffix)).is_whole():
            read = read_asset(file.path)
        case _:
            return None
    # The file has no more than pixels depend on.
    meshes = [replace(mesh, default_uv=cage.default_uv) for mesh, cage in zip(read.meshes, cages.meshes, strict=True)]
    return replace(read, meshes=tuple(meshes), instances=cages.instances, unit=cages.unit, notes=cages.notes)


def kept_outline(asset: Asset) -> NDArray[np.float64]:
    """Return the `outline` of an asset, (n, 3), which is found once where it is of several instances."""
    if len(asset.instances) == 1:
        return outline(asset)

    def found() -> tuple[Content, ...]:
        data = io.BytesIO()
        np.save(data, outline(asset))
        return (Content.holding(data.getvalue(), ".npy"),)

    (file,) = derived("outlines", key_of(asset, (), ()), found)
    return np.asarray(np.load(file.path))
