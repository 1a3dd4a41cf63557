"""Finds faults of value clips. USD does not report them, and silently takes other values.

Value clips are files that hold the animation of a prim, one for each range of time. A clip set is the metadata that
names them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, Vt

from lookdev.errors import Fault, LookError
from lookdev.stage.files import layer_problem

_CLIPS = "clips"
# The type of the value for each key of a clip set, and the type's name in USD.
_TYPES: dict[str, tuple[type, str]] = {
    "assetPaths": (Sdf.AssetPathArray, "asset[]"),
    "templateAssetPath": (str, "string"),
    "manifestAssetPath": (Sdf.AssetPath, "asset"),
    "primPath": (str, "string"),
    "active": (Vt.Vec2dArray, "double2[]"),
    "times": (Vt.Vec2dArray, "double2[]"),
}


def clip_faults(stage: Usd.Stage, file: Path, open_layer: Callable[[Path], Sdf.Layer]) -> list[Fault]:
    """Return the faults of the value clips of a stage, which was opened from `file`.

    `open_layer` checks and opens a layer file; it raises LookError.
    """
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
    """Yield the problems of the clip set `name` of a prim, as predicates such as "is not a dictionary"."""
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
    """Yield a problem if the first clip has no prim at `path` or cannot be read.

    Only the first clip is opened. USD opens the others, possibly thousands, when it needs them.
    """
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
