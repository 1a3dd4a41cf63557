"""Faults of value clips: where a clip is missing or its metadata is wrong, USD silently takes other values."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

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


def clip_faults(stage: Usd.Stage, file: Path, open_layer: Callable[[Path], Sdf.Layer]) -> list[Fault]:
    """Return the faults of the value clips of a stage; `open_layer` opens and checks a layer."""
    return [
        Fault(str(file), f"{prim.GetPath()}.clips[{name}]", problem)
        for root in (stage.GetPseudoRoot(), *stage.GetPrototypes())
        for prim in Usd.PrimRange(root)
        if prim.HasAuthoredMetadata(_CLIPS)
        for name, clip_set in prim.GetMetadata(_CLIPS).items()
        for problem in _clip_set_problems(Usd.ClipsAPI(prim), name, clip_set, open_layer)
    ]


def _clip_set_problems(
    clips: Usd.ClipsAPI, name: str, clip_set: object, open_layer: Callable[[Path], Sdf.Layer]
) -> Iterator[str]:
    if not isinstance(clip_set, dict):
        yield "is not a dictionary"
        return
    for key, (value_type, type_name) in _TYPES.items():
        if key in clip_set and not isinstance(clip_set[key], value_type):
            yield f"{key} is not of type {type_name}"
            return
    assets = clips.ComputeClipAssetPaths(name)
    if not assets:
        yield "names no file that is there"
    manifest = clips.GetClipManifestAssetPath(name)
    for asset in (*assets, *([manifest] if manifest else [])):
        problem = layer_problem(Path(asset.resolvedPath)) if asset.resolvedPath else "is not there"
        if problem:
            yield f"{asset.path} {problem}"
    yield from _prim_problems(clips.GetClipPrimPath(name) or "", assets, open_layer)
    active, times = (np.array(clip_set.get(key) or [], np.float64).reshape(-1, 2) for key in ("active", "times"))
    if not (np.isfinite(active).all() and np.isfinite(times).all()):
        yield "active and times must be finite"
    elif not np.isin(active[:, 1], np.arange(len(assets))).all():
        yield f"active names a clip that does not exist: there are {len(assets)}, counted from 0"


def _prim_problems(
    path: str, assets: Sequence[Sdf.AssetPath], open_layer: Callable[[Path], Sdf.Layer]
) -> Iterator[str]:
    """Yield why the first clip lacks `path`. The other clips, possibly thousands, are opened by USD as needed."""
    first = next((asset for asset in assets if asset.resolvedPath), None)
    if first is None:
        return
    try:
        layer = open_layer(Path(first.resolvedPath))
    except LookError as error:
        yield f"{first.path} cannot be read: {error.faults[0].what}"
        return
    if not (Sdf.Path.IsValidPathString(path) and layer.GetPrimAtPath(path)):
        yield f"{first.path} has no prim {path!r:.60}, which primPath names"
