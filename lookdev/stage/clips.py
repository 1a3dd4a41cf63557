"""Value clips of a stage: USD takes other values, without a word, where one is missing or its metadata is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd, Vt

from lookdev.errors import Fault, LookError
from lookdev.stage.files import layer_problem

_CLIPS = "clips"
_TYPES: dict[str, tuple[type, str]] = {
    "assetPaths": (Sdf.AssetPathArray, "asset[]"),
    "templateAssetPath": (str, "string"),
    "manifestAssetPath": (Sdf.AssetPath, "asset"),
    "primPath": (str, "string"),
    "active": (Vt.Vec2dArray, "double2[]"),
    "times": (Vt.Vec2dArray, "double2[]"),
}


def clip_faults(stage: Usd.Stage, file: Path, opened: Callable[[Path], Sdf.Layer]) -> list[Fault]:
    """Return what is wrong with the value clips of a stage; `opened` opens and checks a layer."""
    return [
        Fault(str(file), f"{prim.GetPath()}.clips[{name}]", what)
        for root in (stage.GetPseudoRoot(), *stage.GetPrototypes())
        for prim in Usd.PrimRange(root)
        if prim.HasAuthoredMetadata(_CLIPS)
        for name, given in prim.GetMetadata(_CLIPS).items()
        for what in _problems(Usd.ClipsAPI(prim), name, given, opened)
    ]


def _problems(clips: Usd.ClipsAPI, name: str, given: Any, opened: Callable[[Path], Sdf.Layer]) -> Iterator[str]:
    if not isinstance(given, dict):
        yield "is no dictionary"
        return
    for key, (kind, needed) in _TYPES.items():
        if key in given and not isinstance(given[key], kind):
            yield f"{key} is not of type {needed}"
            return
    assets = clips.ComputeClipAssetPaths(name)
    if not assets:
        yield "names no file that is there"
    manifest = clips.GetClipManifestAssetPath(name)
    for asset in (*assets, *([manifest] if manifest else [])):
        problem = layer_problem(Path(asset.resolvedPath)) if asset.resolvedPath else "is not there"
        if problem:
            yield f"{asset.path} {problem}"
    yield from _prim_problems(clips.GetClipPrimPath(name) or "", assets, opened)
    active, times = (np.array(given.get(key) or [], np.float64).reshape(-1, 2) for key in ("active", "times"))
    if not (np.isfinite(active).all() and np.isfinite(times).all()):
        yield "active and times must be finite"
    elif not np.isin(active[:, 1], np.arange(len(assets))).all():
        yield f"active names a clip that is none of the {len(assets)}"


def _prim_problems(path: str, assets: Sequence[Sdf.AssetPath], opened: Callable[[Path], Sdf.Layer]) -> Iterator[str]:
    """Yield why the prim of a clip is not found in the first one; there can be thousands, which USD opens as needed."""
    first = next((asset for asset in assets if asset.resolvedPath), None)
    if first is None:
        return
    try:
        layer = opened(Path(first.resolvedPath))
    except LookError as error:
        yield f"{first.path} cannot be read: {error.faults[0].what}"
        return
    if not (Sdf.Path.IsValidPathString(path) and layer.GetPrimAtPath(path)):
        yield f"{first.path} has no prim {path!r:.60}, which primPath names"
