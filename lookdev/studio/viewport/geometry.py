"""An asset as arrays of a texture: what shading interpolates at each corner of each triangle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.asset import Asset, Mesh
from lookdev.asset.tangents import handedness, tangents_of
from lookdev.asset.triangles import corner_triangles
from lookdev.codegen import HANDEDNESS, TANGENT, AttributeBinding
from lookdev.errors import AssetError
from lookdev.studio.viewport.hierarchy import MOST_TEXELS_EACH, Hierarchy

WIDTH = 4096
"""Texels of a row of the texture of corners."""

MOST_TEXELS = WIDTH * 8192
"""Of the texture of corners: what browsers without a GPU have room for."""

_FIRST = 2  # texels of place, normal, hand and slot, before the attributes of looks


@dataclass(frozen=True)
class Range:
    """Triangles `first` to before `last` of a slot of the asset."""

    slot: int
    first: int
    last: int


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of all triangles, slot by slot in the given order: `texels` (n, 4) float32, `stride` of each corner.

    The first texel of a corner is its place in metres about the asset's centre, and -1 where its instance is reflected,
    else 1; the second its unit normal, and the number of its slot; then come `attributes`, each at a texel and a
    component. From texel `occluders` on follows the `Hierarchy` of all triangles, of `nodes` nodes; 0: there is none.

    The camera sees triangles of `vertices` (v,), a place and a ``number`` each, by `indices` (triangles, 3): the last
    vertex of each triangle has its number. In WebGL no shader knows the number otherwise.
    """

    texels: NDArray[np.float32]
    vertices: NDArray[np.void]
    indices: NDArray[np.uint32]
    stride: int
    ranges: tuple[Range, ...]
    attributes: dict[AttributeBinding, tuple[int, int]]
    occluders: int = 0
    nodes: int = 0

    def read(self, binding: AttributeBinding) -> str:
        """Return GLSL for an attribute where `carried(texel)` interpolates."""
        texel, start = self.attributes[binding]
        return f"carried({texel}).{'xyzw'[start : start + _width(binding)]}"


@lru_cache(maxsize=1)
def corners_of(
    asset: Asset, order: tuple[int, ...], bindings: tuple[AttributeBinding, ...], *, occluding: bool = False
) -> Corners:
    """Return the corners of an asset, by `order` of its slots, with the attributes of `bindings`.

    Those that are `occluding` have the hierarchy by which rays find them. The last ones are kept: a look is edited more
    often than what it reads.

    Raises
    ------
    AssetError
        It has more triangles than browsers have room for, or lacks a UV set that a look reads.
    """
    stride, places = _placed(dict.fromkeys(bindings))
    split = [corner_triangles(mesh) for mesh in asset.meshes]
    count = sum(len(split[each.mesh][1]) for each in asset.instances)
    if count > (most := MOST_TEXELS // (3 * stride + MOST_TEXELS_EACH)):
        raise AssetError(
            f"{asset.name}: {count} triangles, instances counted one by one; the viewport has room for {most}: a "
            "lighter purpose or level of the asset would be right"
        )
    tangents: list[Any] = [None] * len(asset.meshes)
    if any(each.attribute == TANGENT for each in places):
        tangents = tangents_of(asset.meshes)
    rows, slots = [], []
    for instance in asset.instances:
        mesh, (triangles, faces) = asset.meshes[instance.mesh], split[instance.mesh]
        linear = instance.matrix[:3, :3]
        texels = np.zeros((len(mesh.corner_points), stride, 4))
        points = mesh.points.astype(np.float64) @ linear.T + instance.matrix[:3, 3] - np.array(asset.center)
        texels[:, 0, :3] = points[mesh.corner_points]
        texels[:, 0, 3] = np.sign(np.linalg.det(linear))
        normals = mesh.normals.astype(np.float64) @ np.linalg.inv(linear)
        texels[:, 1, :3] = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
        for binding, (texel, start) in places.items():
            width = _width(binding)
            tangent = binding.attribute == TANGENT
            found = tangents[instance.mesh] @ linear.T if tangent else _read(binding, mesh)
            texels[:, texel, start : start + width] = found.reshape(-1, width)
        placed = texels.astype(np.float32)[triangles]
        placed[:, :, 1, 3] = mesh.face_slots[faces, None]
        sides = placed[:, :, 0, :3].astype(np.float64)
        area = np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=-1)
        rows.append(placed[area > 0.0])
        slots.append(mesh.face_slots[faces][area > 0.0])
    rank = np.empty(len(asset.slots), np.int64)
    rank[np.asarray(order)] = np.arange(len(order))
    ranks = rank[np.concatenate(slots)]
    ends = np.cumsum(np.bincount(ranks, minlength=len(order))).tolist()
    ranges = tuple(Range(slot, *pair) for slot, *pair in zip(order, [0, *ends], ends, strict=False))
    sorted_rows = np.concatenate(rows)[np.argsort(ranks, kind="stable")]
    vertices, indices = _numbered(sorted_rows[:, :, 0, :3])
    made = np.asarray(sorted_rows.reshape(-1, 4), np.float32)
    if not occluding:
        return Corners(made, vertices, indices, stride, ranges, places)
    found = Hierarchy.of(sorted_rows[:, :, 0, :3], sorted_rows[:, 0, 1, 3])
    texels = np.concatenate([made, found.texels]).astype(np.float32, copy=False)
    return Corners(texels, vertices, indices, stride, ranges, places, len(made), found.nodes)


def _numbered(places: NDArray[np.float32]) -> tuple[NDArray[np.void], NDArray[np.uint32]]:
    """Return the vertices and indices of triangles (t, 3, 3): about as many vertices as triangles, if they are shared.

    A vertex has the number of one triangle. Where all three of a triangle are taken, it gets a vertex of its own.
    """
    count = len(places)
    keys = np.ascontiguousarray(places.reshape(-1, 3) + np.float32(0.0)).view(np.dtype((np.void, 12))).ravel()
    _, first, shared = np.unique(keys, return_index=True, return_inverse=True)
    triangles = shared.reshape(-1, 3)
    owner = np.full(len(first), -1)
    last = np.full(count, -1)
    for corner in range(3):
        free = np.flatnonzero(last < 0)
        free = free[owner[triangles[free, corner]] < 0]
        taken, of = np.unique(triangles[free, corner], return_index=True)
        owner[taken], last[free[of]] = free[of], corner
    alone = np.flatnonzero(last < 0)
    vertices = np.zeros(len(first) + len(alone), np.dtype([("place", np.float32, (3,)), ("number", np.uint32)]))
    vertices["place"] = places.reshape(-1, 3)[np.concatenate([first, 3 * alone + 2])]
    vertices["number"] = np.concatenate([np.maximum(owner, 0), alone])
    indices = triangles.astype(np.uint32)
    indices[alone, 2] = len(first) + np.arange(len(alone))
    # Rolled, so that a triangle's winding stays.
    turn = np.where(last < 0, 2, last)
    rows = np.arange(count)[:, None]
    return vertices, indices[rows, (turn[:, None] + np.array([1, 2, 3])) % 3]


def _width(binding: AttributeBinding) -> int:
    return {"uv": 2, "float": 1}.get(binding.kind, 3)


def _placed(bindings: dict[AttributeBinding, None]) -> tuple[int, dict[AttributeBinding, tuple[int, int]]]:
    """Return the texels of a corner, and the place of each attribute: none is in two texels."""
    room: list[int] = []
    places = {}
    for binding in sorted(bindings, key=_width, reverse=True):
        width = _width(binding)
        texel = next((k for k, used in enumerate(room) if used + width <= 4), len(room))
        if texel == len(room):
            room.append(0)
        places[binding] = (_FIRST + texel, room[texel])
        room[texel] += width
    return _FIRST + len(room), places


def _read(binding: AttributeBinding, mesh: Mesh) -> NDArray[Any]:
    if binding.attribute == HANDEDNESS:
        return handedness(mesh)
    found = (mesh.uvs if binding.kind == "uv" else mesh.primvars).get(binding.attribute)
    count, width = len(mesh.corner_points), _width(binding)
    if found is not None:
        if found.size != count * width:
            has = found.size // count
            raise AssetError(f"{mesh.name}: '{binding.attribute}' has {has} numbers a corner, the look reads {width}")
        return found
    if binding.fallback is None:
        raise AssetError(f"{mesh.name}: no UV set '{binding.attribute}'; it has: {', '.join(mesh.uvs)}")
    return np.broadcast_to(np.array(binding.fallback), (count, width))
