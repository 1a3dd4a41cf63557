"""An asset's digest, and its file for the render worker: a line of JSON, then arrays, which are mapped into memory."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.bounds import bounding_sphere
from lookdev.asset.mesh import Asset, Instance, Mesh, Slot
from lookdev.asset.tangents import tangents_of
from lookdev.cache import Content, derived
from lookdev.errors import AssetError

_ALIGNMENT = 64  # bytes
_FORMAT = 5  # raised, too, when an asset of the same digest gets other tangents
_FLAGS = ("convex", "sheet", "revolved")

# The fields of `Mesh` that are stored as one array for all meshes: its type, numbers in a row, and rows.
_ARRAYS: dict[str, tuple[type[np.generic], int, str]] = {
    "points": (np.float32, 3, "points"),
    "corner_points": (np.int32, 0, "corners"),
    "face_sizes": (np.int32, 0, "faces"),
    "face_slots": (np.int32, 0, "faces"),
    "normals": (np.float32, 3, "corners"),
    "tangents": (np.float32, 3, "tangents"),
}


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
    layouts, sizes = _layouts(asset.meshes)
    digest = _hashed(_description(asset, layouts), (column for _, column in _columns(asset, sizes)))
    for number, mesh in enumerate(asset.meshes):
        if mesh.subdivision is not None:
            digest.update(f"cage {number}".encode())
            for each in dataclasses.fields(mesh.subdivision):
                value = getattr(mesh.subdivision, each.name)
                digest.update(f"{each.name} {value.tolist() if isinstance(value, np.ndarray) else value}".encode())
    return digest.hexdigest()


def save_asset(asset: Asset, directed: Iterable[int] = ()) -> Path:
    """Write an asset to the cache, once, and return its file there.

    In the file, the meshes of the numbers `directed` have tangents; where these are not in the digest yet, it is
    another one. The paths of instances are left out, which no pixel depends on. Raises ValueError where a mesh is a
    control cage.
    """
    cages = [mesh.name for mesh in asset.meshes if mesh.subdivision is not None]
    if cages:
        raise ValueError(f"{asset.name}: {cages[0]} is a control cage, which is refined before it is rendered")
    digest = asset.digest or asset_digest(asset)
    unknown = [number for number in directed if asset.meshes[number].tangents is None]
    name = hashlib.sha256(json.dumps([digest, unknown]).encode()).hexdigest() if unknown else digest

    def write(path: Path) -> None:
        meshes = list(asset.meshes)
        for number, tangents in zip(unknown, tangents_of([meshes[i] for i in unknown]), strict=True):
            meshes[number] = dataclasses.replace(meshes[number], tangents=tangents)
        whole = dataclasses.replace(asset, meshes=tuple(meshes))
        layouts, sizes = _layouts(meshes)
        shapes = {name: (column.dtype.str, column.shape) for name, column in _columns(whole, sizes)}
        head = {
            "description": _description(whole, layouts),
            "columns": shapes,
            "center": asset.center,
            "radius": asset.radius,
            "digest": digest,
        }
        with path.open("wb") as stream:
            stream.write(json.dumps(head).encode() + b"\n")
            for _, column in _columns(whole, sizes):
                stream.write(bytes(-stream.tell() % _ALIGNMENT))
                stream.write(column.data)

    (content,) = derived("assets", f"{name}-v{_FORMAT}", lambda: (Content.written(".asset", write),))
    return content.path


def read_asset(path: Path) -> Asset:
    """Read an asset that `save_asset` wrote; arrays of its meshes are views of those of all meshes.

    Raises
    ------
    AssetError
        The file is missing, cut off or of another format. `lookdev.cache.Content` finds changed numbers.
    """
    try:
        with path.open("rb") as stream:
            line = stream.readline()
        head, offset, arrays = json.loads(line), len(line), {}
        stored = np.memmap(path, np.uint8, "r")
        for name, (kind, shape) in head["columns"].items():
            offset += -offset % _ALIGNMENT
            arrays[name] = np.frombuffer(stored, kind, math.prod(shape), offset).reshape(shape)
            offset += arrays[name].nbytes
        return _assembled(head, arrays)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise AssetError(
            f"{path}: is not an asset of this version of lookdev ({error!r}); delete it, it is made again"
        ) from error


_Layout = tuple[bool, tuple[str, ...], tuple[tuple[str, int], ...]]
"""Whether a mesh has tangents; names of its UV sets; names of its primvars, and the numbers in a row of each, 0 for a
plain array."""


def _layouts(meshes: Sequence[Mesh]) -> tuple[list[_Layout], NDArray[np.int64]]:
    """Return the different layouts, and for each mesh (n, 4) its points, corners, faces and the number of its layout.

    Ten thousand meshes have a few layouts.
    """
    numbers: dict[_Layout, int] = {}
    rows = []
    for mesh in meshes:
        widths = tuple((name, sum(each.shape[1:])) for name, each in mesh.primvars.items())
        layout = mesh.tangents is not None, tuple(mesh.uvs), widths
        number = numbers.setdefault(layout, len(numbers))
        rows.append((len(mesh.points), len(mesh.corner_points), len(mesh.face_sizes), number))
    return list(numbers), np.array(rows, np.int64).reshape(-1, 4)


def _hashed(description: Mapping[str, Any], columns: Iterable[NDArray[Any]]) -> hashlib._Hash:
    digest = hashlib.sha256(json.dumps(description).encode())
    for column in columns:
        digest.update(column.data)
    return digest


def _description(asset: Asset, layouts: Sequence[_Layout]) -> dict[str, Any]:
    return {
        "format": _FORMAT,
        **{name: getattr(asset, name) for name in ("name", *_FLAGS)},
        "slots": [[slot.path, slot.material] for slot in asset.slots],
        "meshes": [mesh.name for mesh in asset.meshes],
        "layouts": layouts,
    }


def _columns(asset: Asset, sizes: NDArray[np.int64]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield each stored array, contiguous, and its name."""
    yield "sizes", sizes
    yield "instance_meshes", np.array([each.mesh for each in asset.instances], np.int32)
    yield "instance_matrices", np.array([each.matrix for each in asset.instances]).reshape(-1, 4, 4)
    for name, (kind, width, _) in _ARRAYS.items():
        given = [array for mesh in asset.meshes if (array := getattr(mesh, name)) is not None]
        yield name, _joined(np.zeros((0, width) if width else 0, kind), given)
    yield "uvs", _joined(np.zeros((0, 2), np.float32), [uv for mesh in asset.meshes for uv in mesh.uvs.values()])
    carried = [each.ravel() for mesh in asset.meshes for each in mesh.primvars.values()]
    yield "primvars", _joined(np.zeros(0, np.float32), carried)


def _joined(empty: NDArray[Any], parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return arrays of the type of an empty one as one, without a copy of a single one."""
    if len(parts) == 1 and parts[0].dtype == empty.dtype:
        return np.ascontiguousarray(parts[0])
    return np.concatenate([empty, *parts], casting="no")


def _assembled(head: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Asset:
    description = head["description"]
    if description["format"] != _FORMAT:
        raise ValueError(f"format {description['format']}, not {_FORMAT}")
    points, corners, faces, layouts = arrays["sizes"].T.tolist()
    # What each mesh carries, and its corners.
    carried = [(*description["layouts"][layout], count) for layout, count in zip(layouts, corners, strict=True)]
    tangents = [count * directed for directed, _, _, count in carried]
    rows = {"points": points, "corners": corners, "faces": faces, "tangents": tangents}
    columns = {name: _split(arrays[name], rows[of]) for name, (_, _, of) in _ARRAYS.items()}
    uvs = iter(_split(arrays["uvs"], [count for _, names, _, count in carried for _ in names]))
    flat = [count * max(width, 1) for _, _, widths, count in carried for _, width in widths]
    primvars = iter(_split(arrays["primvars"], flat))
    meshes = []
    for number, (directed, names, widths, _) in enumerate(carried):
        given: dict[str, Any] = {name: column[number] for name, column in columns.items()}
        if not directed:
            given["tangents"] = None
        given["uvs"] = {uv: next(uvs) for uv in names}
        given["primvars"] = {each: next(primvars).reshape((-1, width) if width else -1) for each, width in widths}
        meshes.append(Mesh(description["meshes"][number], **given))
    placements = zip(arrays["instance_meshes"].tolist(), arrays["instance_matrices"], strict=True)
    return Asset(
        meshes=tuple(meshes),
        instances=tuple(Instance(mesh, matrix) for mesh, matrix in placements),
        slots=tuple(Slot(slot, material) for slot, material in description["slots"]),
        center=tuple(head["center"]),
        **{name: head[name] for name in ("radius", "digest")},
        **{name: description[name] for name in ("name", *_FLAGS)},
    )


def _split(array: NDArray[Any], counts: Sequence[int]) -> list[NDArray[Any]]:
    """Return views of an array, of so many rows each."""
    return [array[end - count : end] for count, end in zip(counts, accumulate(counts), strict=True)]
