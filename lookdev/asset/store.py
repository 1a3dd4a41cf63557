"""Computes an asset's digest, and writes the asset to a file in the cache, which the render worker reads.

The file has a line of JSON, followed by arrays, which are mapped into memory. Such an array has the values of all
meshes, one mesh after another; the code calls it a column.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lookdev.arrays import Bytes, Elements, Ints
from lookdev.asset.bounds import bounding_sphere
from lookdev.asset.mesh import Asset, Instance, Mesh, Slot
from lookdev.asset.tangents import tangents_of
from lookdev.cache import cached_file
from lookdev.errors import AssetError

_ALIGNMENT = 64  # bytes: each array starts at an offset in the file that is a multiple of this
_FORMAT = 5  # to be increased when the format changes, or the way in which tangents are computed
_FLAG_FIELDS = ("convex", "sheet", "revolved")

# The fields of `Mesh` that are stored as one array for all meshes: the type of the numbers, the numbers in a row (0 for
# an array of one dimension), and the elements of a mesh that have a row each. The elements "tangents" are the corners
# of a mesh with tangents; a mesh without tangents has none.
_ARRAYS: dict[str, tuple[type[np.generic], int, str]] = {
    "points": (np.float32, 3, "points"),
    "corner_points": (np.int32, 0, "corners"),
    "face_sizes": (np.int32, 0, "faces"),
    "face_slots": (np.int32, 0, "faces"),
    "normals": (np.float32, 3, "corners"),
    "tangents": (np.float32, 3, "tangents"),
}
_Number = TypeVar("_Number", bound=np.generic)


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
    """Return an asset of the given parts, with its bounding sphere and its digest.

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
    """Return the SHA-256, in hexadecimal, over an asset's arrays, placements, slots, names and subdivision rules."""
    layouts, sizes = _layouts(asset.meshes)
    digest = hashlib.sha256(json.dumps(_description(asset, layouts)).encode())
    for _, column in _columns(asset, sizes):
        digest.update(column.data)
    for number, mesh in enumerate(asset.meshes):
        if mesh.subdivision is not None:
            digest.update(f"cage {number}".encode())
            for rule_field in dataclasses.fields(mesh.subdivision):
                value = getattr(mesh.subdivision, rule_field.name)
                plain = value.tolist() if isinstance(value, np.ndarray) else value
                digest.update(f"{rule_field.name} {plain}".encode())
    return digest.hexdigest()


def save_asset(asset: Asset, tangent_meshes: Iterable[int] = ()) -> Path:
    """Write an asset to the cache, unless its file is there already, and return the path of the file.

    In the file, the meshes with the numbers `tangent_meshes` have tangents. Tangents that the asset lacks are computed;
    the name of the file then differs from the asset's digest. The paths of instances are not stored, since no pixel
    depends on them. Raises ValueError if a mesh is a control cage.
    """
    cages = [mesh.name for mesh in asset.meshes if mesh.subdivision is not None]
    if cages:
        raise ValueError(f"{asset.name}: {cages[0]} is a control cage, which is refined before it is rendered")
    digest = asset.digest or asset_digest(asset)
    missing = [number for number in tangent_meshes if asset.meshes[number].tangents is None]
    name = hashlib.sha256(json.dumps([digest, missing]).encode()).hexdigest() if missing else digest

    def write(path: Path) -> None:
        """Write the file of the asset, with the missing tangents."""
        meshes = list(asset.meshes)
        for number, tangents in zip(missing, tangents_of([meshes[i] for i in missing]), strict=True):
            meshes[number] = dataclasses.replace(meshes[number], tangents=tangents)
        saved = dataclasses.replace(asset, meshes=tuple(meshes))
        layouts, sizes = _layouts(meshes)
        shapes = {name: (column.dtype.str, column.shape) for name, column in _columns(saved, sizes)}
        head = {
            "description": _description(saved, layouts),
            "columns": shapes,
            "center": asset.center,
            "radius": asset.radius,
            "digest": digest,
        }
        with path.open("wb") as stream:
            stream.write(json.dumps(head).encode() + b"\n")
            for _, column in _columns(saved, sizes):
                stream.write(bytes(-stream.tell() % _ALIGNMENT))
                stream.write(column.data)

    return cached_file("assets", f"{name}-v{_FORMAT}", ".asset", write).path


def read_asset(path: Path) -> Asset:
    """Read an asset that `save_asset` wrote; the arrays of its meshes are views of the file's arrays.

    Raises
    ------
    AssetError
        The file is missing, cut off or of another format. Changed numbers are not detected here, but only by
        `lookdev.cache.Content`.
    """
    try:
        with path.open("rb") as stream:
            line = stream.readline()
        return _assemble_asset(line, np.memmap(path, np.uint8, "r"))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise AssetError(
            f"{path}: is not an asset of this version of lookdev ({error!r}); delete it, it is made again"
        ) from error


_Layout = tuple[bool, tuple[str, ...], tuple[tuple[str, int], ...]]
"""The arrays of a mesh: whether it has tangents; the names of its UV sets; the names and widths of its primvars.

A width is the number of components of a primvar's value, or 0 for an array of one dimension.
"""


def _layouts(meshes: Sequence[Mesh]) -> tuple[list[_Layout], Ints]:
    """Return the distinct layouts of meshes, and a table (n, 4) with a row for each mesh.

    A row has the mesh's numbers of points, corners and faces, and the number of its layout. Layouts are stored once,
    since ten thousand meshes have only a few layouts.
    """
    numbers: dict[_Layout, int] = {}
    rows = []
    for mesh in meshes:
        widths = tuple((name, sum(values.shape[1:])) for name, values in mesh.primvars.items())
        layout = mesh.tangents is not None, tuple(mesh.uvs), widths
        number = numbers.setdefault(layout, len(numbers))
        rows.append((len(mesh.points), len(mesh.corner_points), len(mesh.face_sizes), number))
    return list(numbers), np.array(rows, np.int64).reshape(-1, 4)


def _description(asset: Asset, layouts: Sequence[_Layout]) -> dict[str, object]:
    """Return the values of an asset that are stored as JSON, not as arrays; the digest covers them, too."""
    return {
        "format": _FORMAT,
        **{name: getattr(asset, name) for name in ("name", *_FLAG_FIELDS)},
        "slots": [[slot.path, slot.material] for slot in asset.slots],
        "meshes": [mesh.name for mesh in asset.meshes],
        "layouts": layouts,
    }


def _columns(asset: Asset, sizes: Ints) -> Iterator[tuple[str, Elements]]:
    """Yield the name and the contiguous values of each stored array; `sizes` is the table of `_layouts`."""
    yield "sizes", sizes
    yield "instance_meshes", np.array([instance.mesh for instance in asset.instances], np.int32)
    yield "instance_matrices", np.array([instance.matrix for instance in asset.instances]).reshape(-1, 4, 4)
    for name, (dtype, width, _) in _ARRAYS.items():
        arrays = [array for mesh in asset.meshes if (array := getattr(mesh, name)) is not None]
        yield name, _concatenate(np.zeros((0, width) if width else 0, dtype), arrays)
    yield "uvs", _concatenate(np.zeros((0, 2), np.float32), [uv for mesh in asset.meshes for uv in mesh.uvs.values()])
    primvars = [values.ravel() for mesh in asset.meshes for values in mesh.primvars.values()]
    yield "primvars", _concatenate(np.zeros(0, np.float32), primvars)


def _concatenate(empty: Elements, parts: Sequence[Elements]) -> Elements:
    """Concatenate arrays that have the same type and row shape as `empty`; a single contiguous array is not copied."""
    if len(parts) == 1 and parts[0].dtype == empty.dtype:
        return np.ascontiguousarray(parts[0])
    return np.concatenate([empty, *parts], casting="no")


def _assemble_asset(line: bytes, file_bytes: Bytes) -> Asset:
    """Return the asset of a file, from the file's first line and all its bytes."""
    head, offset, arrays = json.loads(line), len(line), {}
    for name, (dtype, shape) in head["columns"].items():
        offset += -offset % _ALIGNMENT
        arrays[name] = np.frombuffer(file_bytes, dtype, math.prod(shape), offset).reshape(shape)
        offset += arrays[name].nbytes
    description = head["description"]
    if description["format"] != _FORMAT:
        raise ValueError(f"format {description['format']}, not {_FORMAT}")
    points, corners, faces, layouts = arrays["sizes"].T.tolist()
    # For each mesh: whether it has tangents, the names of UV sets, the primvars, and the number of corners.
    mesh_layouts = [(*description["layouts"][layout], count) for layout, count in zip(layouts, corners, strict=True)]
    tangents = [count * has_tangents for has_tangents, _, _, count in mesh_layouts]
    # `rows` has, by type of element, the number of rows of each mesh. `columns` has, by field, the array of each mesh.
    rows = {"points": points, "corners": corners, "faces": faces, "tangents": tangents}
    columns = {name: _split_rows(arrays[name], rows[rows_name]) for name, (_, _, rows_name) in _ARRAYS.items()}
    uvs = iter(_split_rows(arrays["uvs"], [count for _, names, _, count in mesh_layouts for _ in names]))
    primvar_sizes = [count * max(width, 1) for _, _, widths, count in mesh_layouts for _, width in widths]
    primvars = iter(_split_rows(arrays["primvars"], primvar_sizes))
    meshes = []
    for number, (has_tangents, names, widths, _) in enumerate(mesh_layouts):
        mesh = Mesh(
            name=description["meshes"][number],
            points=columns["points"][number],
            corner_points=columns["corner_points"][number],
            face_sizes=columns["face_sizes"][number],
            face_slots=columns["face_slots"][number],
            normals=columns["normals"][number],
            tangents=columns["tangents"][number] if has_tangents else None,
            uvs={uv: next(uvs) for uv in names},
            primvars={primvar: next(primvars).reshape((-1, width) if width else -1) for primvar, width in widths},
        )
        meshes.append(mesh)
    placements = zip(arrays["instance_meshes"].tolist(), arrays["instance_matrices"], strict=True)
    return Asset(
        meshes=tuple(meshes),
        instances=tuple(Instance(mesh, matrix) for mesh, matrix in placements),
        slots=tuple(Slot(slot, material) for slot, material in description["slots"]),
        center=tuple(head["center"]),
        **{name: head[name] for name in ("radius", "digest")},
        **{name: description[name] for name in ("name", *_FLAG_FIELDS)},
    )


def _split_rows(array: NDArray[_Number], counts: Sequence[int]) -> list[NDArray[_Number]]:
    """Split an array into consecutive views with the given numbers of rows."""
    return [array[end - count : end] for count, end in zip(counts, accumulate(counts), strict=True)]
