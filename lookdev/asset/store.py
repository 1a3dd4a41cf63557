"""An asset's digest, and its file for the render worker."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.bounds import bounding_sphere
from lookdev.asset.mesh import Asset, Instance, Mesh, Slot
from lookdev.cache import atomic_path, cache_dir
from lookdev.errors import AssetError

_FORMAT = 3
_FLAGS = ("convex", "sheet", "revolved")
_ARRAYS = ("points", "corner_points", "face_sizes", "face_slots", "normals", "tangents")


def make_asset(
    name: str,
    meshes: Sequence[Mesh],
    instances: Sequence[Instance],
    slots: Sequence[Slot],
    *,
    convex: bool = False,
    sheet: bool = False,
    revolved: bool = False,
) -> Asset:
    """Return an asset with its bounding sphere and its digest.

    Raises
    ------
    AssetError
        There is no instance, or all points are in one place.
    """
    if not instances:
        raise AssetError(f"{name}: has no surface to render; at least one mesh with a face is needed")
    center, radius = bounding_sphere(meshes, instances)
    if not radius > 0.0:
        raise AssetError(f"{name}: all points lie in one place, {center}; the surface needs an extent")
    asset = Asset(name, tuple(meshes), tuple(instances), tuple(slots), center, radius, convex, sheet, revolved)
    return dataclasses.replace(asset, digest=asset_digest(asset))


def asset_digest(asset: Asset) -> str:
    """Return the SHA-256, in hexadecimal, over all arrays, placements, slots and names."""
    digest = hashlib.sha256(json.dumps(_description(asset)).encode())
    for key, array in _arrays(asset):
        digest.update(f"{key} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def save_asset(asset: Asset) -> Path:
    """Write an asset to the cache, once, and return the file ``assets/<digest>.npz``."""
    digest = asset.digest or asset_digest(asset)
    path = cache_dir("assets") / f"{digest}.npz"
    if not path.exists():
        head = _description(asset) | {"center": asset.center, "radius": asset.radius, "digest": digest}
        contents: dict[str, Any] = {"head": np.array(json.dumps(head)), **dict(_arrays(asset))}
        with atomic_path(path) as temporary:
            np.savez(temporary, **contents)
    return path


def read_asset(path: Path) -> Asset:
    """Read an asset that `save_asset` wrote.

    Raises
    ------
    AssetError
        The file is missing, cut off or of another format.
    """
    try:
        # np.load leaves a file open that is not an archive.
        with path.open("rb") as stream, np.load(stream) as arrays:
            return _assembled({key: arrays[key] for key in arrays.files})
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise AssetError(
            f"{path}: is not an asset of this version of lookdev ({error!r}); delete it, it is made again"
        ) from error


def _description(asset: Asset) -> dict[str, Any]:
    return {
        "format": _FORMAT,
        **{name: getattr(asset, name) for name in ("name", *_FLAGS)},
        "slots": [[slot.path, slot.material] for slot in asset.slots],
        "meshes": [
            {"name": mesh.name, "uvs": list(mesh.uvs), "primvars": list(mesh.primvars)} for mesh in asset.meshes
        ],
    }


def _arrays(asset: Asset) -> Iterator[tuple[str, NDArray[Any]]]:
    yield "instance_meshes", np.array([instance.mesh for instance in asset.instances], np.int32)
    yield "instance_matrices", np.stack([instance.matrix for instance in asset.instances])
    for i, mesh in enumerate(asset.meshes):
        for name in _ARRAYS:
            yield f"{i}.{name}", getattr(mesh, name)
        # By number: a primvar's name may have characters that a file name in the archive may not.
        for kind, values in (("uv", mesh.uvs), ("primvar", mesh.primvars)):
            for j, array in enumerate(values.values()):
                yield f"{i}.{kind}{j}", array


def _assembled(arrays: dict[str, NDArray[Any]]) -> Asset:
    head = json.loads(str(arrays["head"]))
    if head["format"] != _FORMAT:
        raise ValueError(f"format {head['format']}, not {_FORMAT}")
    meshes = []
    for i, mesh in enumerate(head["meshes"]):
        given: dict[str, Any] = {name: arrays[f"{i}.{name}"] for name in _ARRAYS}
        given["uvs"] = {name: arrays[f"{i}.uv{j}"] for j, name in enumerate(mesh["uvs"])}
        given["primvars"] = {name: arrays[f"{i}.primvar{j}"] for j, name in enumerate(mesh["primvars"])}
        meshes.append(Mesh(mesh["name"], **given))
    placements = zip(arrays["instance_meshes"].tolist(), arrays["instance_matrices"], strict=True)
    return Asset(
        meshes=tuple(meshes),
        instances=tuple(Instance(mesh, matrix) for mesh, matrix in placements),
        slots=tuple(Slot(slot, material) for slot, material in head["slots"]),
        center=tuple(head["center"]),
        **{name: head[name] for name in ("name", "radius", "digest", *_FLAGS)},
    )
