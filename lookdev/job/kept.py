"""Refined assets, and levels of refinement, that are kept in the cache from one run to the next.

A file ``refined/<key>.json`` has the levels, or the digest of a refined asset, whose arrays are in ``assets``, where
the render worker finds them too. The key is that of all that the result depends on, the code that makes it included. A
file has the checksum of what it says. One that is damaged counts as missing, with a note: it is made again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import lookdev.asset
from lookdev.asset import Asset, read_asset, save_asset
from lookdev.asset.store import asset_digest
from lookdev.asset.subdivision import Refinement
from lookdev.cache import atomic_path, cache_dir
from lookdev.errors import AssetError
from lookdev.text import TextError, parse_json, read_bytes


def key_of(asset: Asset, detailed: Collection[int], by: Sequence[float]) -> str:
    """Return the key of what becomes of an asset, of which some meshes carry detail, by a camera or by levels."""
    digest = asset.digest or asset_digest(asset)
    return hashlib.sha256(json.dumps([_code(), digest, sorted(detailed), list(by)]).encode()).hexdigest()


def keep_levels(key: str, chosen: Refinement) -> None:
    """Write levels and their notes to the cache."""
    _write(key, {"levels": chosen.levels, "notes": chosen.notes})


def kept_levels(key: str, count: int, notes: list[str]) -> Refinement | None:
    """Return the levels of so many meshes that `keep_levels` wrote; None where there are none. May add to `notes`."""
    match _read(key, notes):
        case {"levels": [*levels], "notes": [*own]} if len(levels) == count:
            return Refinement(tuple(levels), tuple(own))
    return None


def keep_refined(key: str, whole: Asset) -> None:
    """Write a refined asset to the cache."""
    save_asset(whole)
    _write(key, {"asset": whole.digest})


def kept_refined(key: str, cages: Asset, notes: list[str]) -> Asset | None:
    """Return the refined asset of some cages that `keep_refined` wrote; None where there is none; as `kept_levels`."""
    match _read(key, notes):
        case {"asset": str(digest)}:
            file = cache_dir("assets") / f"{digest}.asset"
        case _:
            return None
    if not file.exists():
        return None
    try:
        read = read_asset(file)
    except AssetError:
        file.unlink()
        notes.append(_damaged(file))
        return None
    # The file has no more than pixels depend on.
    meshes = [replace(mesh, default_uv=cage.default_uv) for mesh, cage in zip(read.meshes, cages.meshes, strict=True)]
    return replace(read, meshes=tuple(meshes), instances=cages.instances, unit=cages.unit, notes=cages.notes)


@cache
def _code() -> str:
    """Return a digest of the code that reads and refines assets."""
    digest = hashlib.sha256(np.__version__.encode())
    for file in sorted(Path(lookdev.asset.__file__).parent.rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _write(key: str, content: dict[str, Any]) -> None:
    with atomic_path(_file(key)) as temporary:
        temporary.write_text(json.dumps({"content": content, "checksum": _checksum(content)}))


def _read(key: str, notes: list[str]) -> object:
    file = _file(key)
    if not file.exists():
        return None
    try:
        match parse_json(read_bytes(file), file):
            case {"content": content, "checksum": checksum} if checksum == _checksum(content):
                return content
    except TextError:
        pass
    notes.append(_damaged(file))
    return None


def _file(key: str) -> Path:
    return cache_dir("refined") / f"{key}.json"


def _checksum(content: object) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _damaged(file: Path) -> str:
    return f"{file}: was damaged, and is made again"
