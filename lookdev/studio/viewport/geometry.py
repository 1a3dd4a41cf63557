"""The geometry of an asset for the viewport: a texture with the values at the corners of triangles, and vertices.

The shaders read the values of a triangle's corners from the texture, and interpolate them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lookdev.arrays import Elements, Floats, Floats32, Ints, Records
from lookdev.asset import Asset, Instance, Mesh
from lookdev.asset.tangents import handedness, tangents_of
from lookdev.asset.triangles import corner_triangles
from lookdev.codegen.source import HANDEDNESS, TANGENT, AttributeBinding
from lookdev.errors import AssetError
from lookdev.studio.viewport.hierarchy import MAX_TRIANGLE_TEXELS, Hierarchy

WIDTH = 4096
"""Width of the texture of corners, in texels."""

MAX_TEXELS = WIDTH * 8192
"""Texels in the largest texture of corners: the limit of browsers without a GPU."""

_FIXED_TEXELS = 2  # texels of a corner before the attributes of looks, as `CornerTexels` describes


@dataclass(frozen=True)
class TriangleRange:
    """The triangles of a slot of the asset: they have the numbers `first` to `last` - 1."""

    slot: int
    first: int
    last: int


@dataclass(frozen=True, eq=False)
class CornerTexels:
    """The corners of all triangles, slot by slot: `texels` (n, 4) float32, `stride` texels for each corner.

    The first texel of a corner is its position relative to the asset's centre, in metres, and -1 if its instance is
    reflected, else 1. The second texel is its unit normal and the number of its slot. The attributes that looks read
    follow: for each attribute, `attributes` has the number of its texel within a corner, and its first component in
    this texel. `ranges` has the triangles of each slot.

    After the corners, from texel `hierarchy_start` on, is the `Hierarchy` of all triangles for shadow rays, with
    `hierarchy_nodes` nodes. If `hierarchy_start` is 0, there is no hierarchy.

    `vertices` (v,) and `indices` (triangles, 3) are the triangles that the camera sees. A vertex has a ``position`` and
    a ``number``: the last vertex of a triangle has the triangle's number, which WebGL's shaders cannot read otherwise.
    """

    texels: Floats32
    vertices: Records
    indices: NDArray[np.uint32]
    stride: int
    ranges: tuple[TriangleRange, ...]
    attributes: dict[AttributeBinding, tuple[int, int]]
    hierarchy_start: int = 0
    hierarchy_nodes: int = 0

    def attribute_expression(self, binding: AttributeBinding) -> str:
        """Return the GLSL expression of an attribute; ``carried(texel)`` interpolates a texel of the three corners."""
        texel, start = self.attributes[binding]
        return f"carried({texel}).{'xyzw'[start : start + binding.width]}"


@lru_cache(maxsize=1)
def pack_corners(
    asset: Asset, order: tuple[int, ...], bindings: tuple[AttributeBinding, ...], *, occluding: bool = False
) -> CornerTexels:
    """Return the corners of an asset, with the attributes of `bindings`; triangles without area are left out.

    `bindings` are the attributes of meshes that the shaders of looks read, such as UV sets and primvars. `order` has
    the numbers of all slots in the order of their triangles. With `occluding`, the texels include the hierarchy for
    shadow rays. The last result is cached: edits of a look seldom change the attributes that it reads.

    Raises
    ------
    AssetError
        The asset has more triangles than fit into a texture of browsers, or lacks a UV set that a look reads.
    """
    stride, locations = _pack_attributes(dict.fromkeys(bindings))
    triangulations = [corner_triangles(mesh) for mesh in asset.meshes]
    count = sum(len(triangulations[instance.mesh][1]) for instance in asset.instances)
    if count > (most := MAX_TEXELS // (3 * stride + MAX_TRIANGLE_TEXELS)):
        raise AssetError(
            f"{asset.name}: {count} triangles, instances counted one by one; the viewport has room for {most}: a "
            "lighter purpose or level of the asset would be right"
        )
    has_tangents = any(binding.attribute == TANGENT for binding in locations)
    tangents = tangents_of(asset.meshes) if has_tangents else []
    rows, slots = [], []  # texels (triangles, 3, stride, 4) and slots (triangles,) of each instance
    for instance in asset.instances:
        mesh, (triangles, faces) = asset.meshes[instance.mesh], triangulations[instance.mesh]
        texels = _instance_texels(asset, instance, tangents, stride, locations)
        triangle_texels = texels.astype(np.float32)[triangles]
        triangle_texels[:, :, 1, 3] = mesh.face_slots[faces, None]
        positions = triangle_texels[:, :, 0, :3].astype(np.float64)
        area = np.linalg.norm(np.cross(positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0]), axis=-1)
        rows.append(triangle_texels[area > 0.0])
        slots.append(mesh.face_slots[faces][area > 0.0])
    sorted_rows, ranges = _sort_by_slot(np.concatenate(rows), np.concatenate(slots), order)
    vertices, indices = _number_vertices(sorted_rows[:, :, 0, :3])
    corner_texels = np.asarray(sorted_rows.reshape(-1, 4), np.float32)
    if not occluding:
        return CornerTexels(corner_texels, vertices, indices, stride, ranges, locations)
    hierarchy = Hierarchy.of(sorted_rows[:, :, 0, :3], sorted_rows[:, 0, 1, 3])
    texels = np.concatenate([corner_texels, hierarchy.texels]).astype(np.float32, copy=False)
    return CornerTexels(texels, vertices, indices, stride, ranges, locations, len(corner_texels), hierarchy.nodes)


def _instance_texels(
    asset: Asset,
    instance: Instance,
    tangents: Sequence[Floats32],
    stride: int,
    locations: Mapping[AttributeBinding, tuple[int, int]],
) -> Floats:
    """Return the texels (n, stride, 4) of the n corners of an instance, without the numbers of their slots.

    `locations` has the texel and the first component of each attribute.
    """
    mesh, linear = asset.meshes[instance.mesh], instance.matrix[:3, :3]
    texels = np.zeros((len(mesh.corner_points), stride, 4))
    points = mesh.points.astype(np.float64) @ linear.T + instance.matrix[:3, 3] - np.array(asset.center)
    texels[:, 0, :3] = points[mesh.corner_points]
    texels[:, 0, 3] = np.sign(np.linalg.det(linear))
    normals = mesh.normals.astype(np.float64) @ np.linalg.inv(linear)
    texels[:, 1, :3] = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    for binding, (texel, start) in locations.items():
        is_tangent = binding.attribute == TANGENT
        values = tangents[instance.mesh] @ linear.T if is_tangent else _corner_values(binding, mesh)
        texels[:, texel, start : start + binding.width] = values.reshape(-1, binding.width)
    return texels


def _sort_by_slot(rows: Floats32, slots: Ints, order: Sequence[int]) -> tuple[Floats32, tuple[TriangleRange, ...]]:
    """Return the rows of triangles in the order of their slots, and the range of each slot.

    `rows` (triangles, 3, stride, 4) are texels, `slots` (triangles,) are numbers of slots, and `order` lists all slots
    in the order of the result.
    """
    rank_of_slot = np.empty(len(order), np.int64)
    rank_of_slot[np.asarray(order)] = np.arange(len(order))
    ranks = rank_of_slot[slots]
    ends = np.cumsum(np.bincount(ranks, minlength=len(order))).tolist()
    ranges = tuple(TriangleRange(slot, *pair) for slot, *pair in zip(order, [0, *ends], ends, strict=False))
    return rows[np.argsort(ranks, kind="stable")], ranges


def _number_vertices(positions: Floats32) -> tuple[Records, NDArray[np.uint32]]:
    """Return the vertices and indices of `CornerTexels` for t triangles, whose corners have `positions` (t, 3, 3).

    Triangles share vertices of equal position. A vertex has the number of one triangle only. So a triangle whose three
    vertices have the numbers of other triangles gets a new vertex. If triangles share vertices, there are about as many
    vertices as triangles.
    """
    count = len(positions)
    # Find the distinct positions, and a corner of each. Positions are compared as 12 bytes; adding 0 turns -0 into 0,
    # which has other bytes.
    keys = np.ascontiguousarray(positions.reshape(-1, 3) + np.float32(0.0)).view(np.dtype((np.void, 12))).ravel()
    _, representative, inverse = np.unique(keys, return_index=True, return_inverse=True)
    triangles = inverse.reshape(-1, 3)
    # A triangle owns the vertex that has its number. `owner` has the triangle that owns each vertex, and `last` has the
    # corner of each triangle at which the triangle owns the vertex; -1 means none.
    owner = np.full(len(representative), -1)
    last = np.full(count, -1)
    # Each vertex without an owner gets one, if a triangle that owns no vertex yet has the vertex at this corner.
    for corner in range(3):
        open_triangles = np.flatnonzero(last < 0)
        open_triangles = open_triangles[owner[triangles[open_triangles, corner]] < 0]
        vertex, pick = np.unique(triangles[open_triangles, corner], return_index=True)
        owner[vertex], last[open_triangles[pick]] = open_triangles[pick], corner
    unnumbered = np.flatnonzero(last < 0)
    vertices = np.zeros(
        len(representative) + len(unnumbered), np.dtype([("position", np.float32, (3,)), ("number", np.uint32)])
    )
    vertices["position"] = positions.reshape(-1, 3)[np.concatenate([representative, 3 * unnumbered + 2])]
    vertices["number"] = np.concatenate([np.maximum(owner, 0), unnumbered])
    indices = triangles.astype(np.uint32)
    indices[unnumbered, 2] = len(representative) + np.arange(len(unnumbered))
    # Shift the indices of a triangle until the vertex with its number is the last. The winding stays the same.
    shift = np.where(last < 0, 2, last)
    rows = np.arange(count)[:, None]
    return vertices, indices[rows, (shift[:, None] + np.array([1, 2, 3])) % 3]


def _pack_attributes(bindings: dict[AttributeBinding, None]) -> tuple[int, dict[AttributeBinding, tuple[int, int]]]:
    """Return the number of texels of a corner, and each attribute's texel and first component in it.

    All components of an attribute are in one texel.
    """
    used_components: list[int] = []
    locations = {}
    for binding in sorted(bindings, key=lambda binding: binding.width, reverse=True):
        width = binding.width
        texel = next((k for k, count in enumerate(used_components) if count + width <= 4), len(used_components))
        if texel == len(used_components):
            used_components.append(0)
        locations[binding] = (_FIXED_TEXELS + texel, used_components[texel])
        used_components[texel] += width
    return _FIXED_TEXELS + len(used_components), locations


def _corner_values(binding: AttributeBinding, mesh: Mesh) -> Elements:
    """Return the values of an attribute, other than the tangent, at the corners of a mesh."""
    if binding.attribute == HANDEDNESS:
        return handedness(mesh)
    values = (mesh.uvs if binding.kind == "uv" else mesh.primvars).get(binding.attribute)
    count, width = len(mesh.corner_points), binding.width
    if values is not None:
        if values.size != count * width:
            has = values.size // count
            raise AssetError(f"{mesh.name}: '{binding.attribute}' has {has} numbers a corner, the look reads {width}")
        return values
    if binding.fallback is None:
        raise AssetError(f"{mesh.name}: no UV set '{binding.attribute}'; it has: {', '.join(mesh.uvs)}")
    return np.broadcast_to(np.array(binding.fallback), (count, width))
