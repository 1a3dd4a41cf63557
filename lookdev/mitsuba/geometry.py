"""An asset as triangles that rays meet, and what shading interpolates over them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from lookdev.asset import Asset, Mesh
from lookdev.asset.tangents import handedness, tangents_of
from lookdev.asset.triangles import corner_triangles
from lookdev.codegen import HANDEDNESS, TANGENT, AttributeBinding
from lookdev.errors import AssetError, RenderError
from lookdev.mitsuba.frozen import held
from lookdev.scene.shading import LIFT

Floats = NDArray[np.float64]

MOST_TRIANGLES = 40_000_000
"""Instances are placed as triangles of their own: more would take above 10 GB."""


class Geometry:
    """Triangles in metres about the asset's centre, in a variant's arrays, which wear nothing yet (`dress`).

    `scene` is Mitsuba's, of one mesh: the index of a primitive is that of a triangle.
    """

    def __init__(self, mi: Any, asset: Asset) -> None:
        self._mi = mi
        self.asset = asset
        self.center = np.array(asset.center)
        split = [corner_triangles(mesh) for mesh in asset.meshes]
        count = sum(len(split[each.mesh][1]) for each in asset.instances)
        if count > MOST_TRIANGLES:
            raise RenderError(
                f"{asset.name}: {count} triangles, instances counted one by one; at most {MOST_TRIANGLES} can be shown "
                "by backend 'mitsuba': 'exact' would be right"
            )
        starts = np.cumsum([0, *(len(asset.meshes[each.mesh].corner_points) for each in asset.instances)])
        points = [_placed(asset.meshes[each.mesh].points, each.matrix) - self.center for each in asset.instances]
        first = np.cumsum([0, *map(len, points)])
        vertices, corners, slots, hands = [], [], [], []
        for number, instance in enumerate(asset.instances):
            mesh, (triangles, faces) = asset.meshes[instance.mesh], split[instance.mesh]
            vertices.append(mesh.corner_points[triangles] + first[number])
            corners.append(triangles + starts[number])
            slots.append(mesh.face_slots[faces])
            hands.append(np.full(len(faces), np.sign(np.linalg.det(instance.matrix[:3, :3]))))
        position = np.concatenate(points).astype(np.float32)
        index = np.concatenate(vertices)
        sides = position[index].astype(np.float64)
        facets = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
        kept = _lengths(facets) > 0.0
        index, sides, facets = index[kept], sides[kept], facets[kept]
        self._facets = held(mi.Float, _unit(facets))
        self._corners = held(mi.UInt32, np.concatenate(corners)[kept])
        self._slots = np.concatenate(slots)[kept]
        self._hands = held(mi.Float, np.concatenate(hands)[kept])
        sizes = [len(split[each.mesh][1]) for each in asset.instances]
        self._instances = held(mi.UInt32, np.repeat(np.arange(len(sizes), dtype=np.uint32), sizes)[kept])
        self._lifts = held(mi.Float, LIFT * _lengths(sides).max(axis=-1))
        self._position = held(mi.Float, position)
        self._index = held(mi.UInt32, index)
        self._normals = self._over_corners(
            lambda i, mesh: _unit(mesh.normals.astype(np.float64) @ np.linalg.inv(asset.instances[i].matrix[:3, :3])), 3
        )
        self._carried: dict[AttributeBinding, Any] = {}
        self._vertices = index
        self.scene = self._scene(index)
        self._casting: dict[tuple[int, ...], Any] = {}

    def dress(self, looks: Sequence[int], groups: Sequence[int] = ()) -> None:
        """Set the numbers of the slots' looks, and those of their groups, of which a light may spare some."""
        self._worn = held(self._mi.UInt32, np.asarray(looks)[self._slots])
        self._groups = np.asarray(groups)[self._slots] if groups else self._slots
        self._casting = {(): self.scene}

    def _scene(self, index: NDArray[Any]) -> Any:
        mi = self._mi
        if not len(index):
            return mi.load_dict({"type": "scene"})
        mesh = mi.Mesh("asset", len(self._position) // 3, len(index))
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = self._position
        parameters["faces"] = mi.UInt32(index.astype(np.uint32).ravel())
        parameters.update()
        return mi.load_dict({"type": "scene", "asset": mesh})

    def casting(self, spared: tuple[int, ...]) -> Any:
        """Return the scene of the parts that cast shadows of lights that spare some groups."""
        if spared not in self._casting:
            self._casting[spared] = self._scene(self._vertices[~np.isin(self._groups, spared)])
        return self._casting[spared]

    def attribute(self, binding: AttributeBinding) -> Any:
        """Return an attribute of all corners, with 1, 2 or 3 numbers each; raises AssetError where a mesh lacks it."""
        if binding not in self._carried:
            width = {"uv": 2, "float": 1}.get(binding.kind, 3)
            self._carried[binding] = self._over_corners(lambda i, mesh: self._read(binding, i, mesh), width)
        return self._carried[binding]

    def _read(self, binding: AttributeBinding, number: int, mesh: Mesh) -> NDArray[Any]:
        if binding.attribute == TANGENT:
            (tangents,) = tangents_of([mesh])
            return tangents @ self.asset.instances[number].matrix[:3, :3].T
        if binding.attribute == HANDEDNESS:
            return handedness(mesh)
        found = (mesh.uvs if binding.kind == "uv" else mesh.primvars).get(binding.attribute)
        if found is not None:
            return found
        if binding.fallback is None:
            raise AssetError(f"{mesh.name}: no UV set '{binding.attribute}'; it has: {', '.join(mesh.uvs)}")
        return np.broadcast_to(np.array(binding.fallback), (len(mesh.corner_points), len(binding.fallback)))

    def _over_corners(self, read: Callable[[int, Mesh], NDArray[Any]], width: int) -> Any:
        rows = [read(i, self.asset.meshes[each.mesh]) for i, each in enumerate(self.asset.instances)]
        return held(self._mi.Float, np.concatenate([row.reshape(-1, width) for row in rows]))

    def worn(self, triangle: Any) -> Any:
        """Return the number of the look of a triangle."""
        return dr.gather(self._mi.UInt32, self._worn, triangle)

    def first_hit(self, ray: Any, active: Any = True) -> tuple[Any, Any, Any, Any]:
        """Return triangles, 0 where none is hit, barycentric coordinates, which rays hit any, and how far."""
        found = self.scene.ray_intersect_preliminary(ray, coherent=True, active=active)
        hit = found.is_valid()
        return dr.select(hit, found.prim_index, 0), found.prim_uv, hit, found.t

    def instance(self, triangle: Any) -> Any:
        """Return the number of the instance that has a triangle."""
        return dr.gather(self._mi.UInt32, self._instances, triangle)

    def first_uv(self) -> Any:
        """Return the first UV set of each mesh, of all corners; 0 where there is none."""

        def read(number: int, mesh: Mesh) -> NDArray[Any]:
            return next(iter(mesh.uvs.values()), np.zeros((len(mesh.corner_points), 2), np.float32))

        return self._over_corners(read, 2)

    def at(self, triangle: Any, uv: Any, active: Any) -> Hit:
        """Return what is interpolated at barycentric coordinates of triangles."""
        return Hit(self, triangle, uv, active)


class Hit:
    """Places of triangles."""

    def __init__(self, geometry: Geometry, triangle: Any, uv: Any, active: Any) -> None:
        self._geometry = geometry
        self._triangle = triangle
        self._weights = (1.0 - uv.x - uv.y, uv.x, uv.y)
        self._active = active

    @property
    def point(self) -> Any:
        geometry = self._geometry
        return self._mean(geometry._position, geometry._index, 3)

    @property
    def normal(self) -> Any:
        return dr.normalize(self._mean(self._geometry._normals, self._geometry._corners, 3))

    @property
    def facet(self) -> Any:
        return dr.gather(self._geometry._mi.Vector3f, self._geometry._facets, self._triangle, self._active)

    @property
    def hand(self) -> Any:
        return dr.gather(self._geometry._mi.Float, self._geometry._hands, self._triangle, self._active)

    @property
    def lift(self) -> Any:
        """How far above its facet a ray leaves, as `lookdev.scene.shading.LIFT`."""
        return dr.gather(self._geometry._mi.Float, self._geometry._lifts, self._triangle, self._active)

    @property
    def first_uv(self) -> Any:
        return self._mean(self._geometry.first_uv(), self._geometry._corners, 2)

    def attribute(self, binding: AttributeBinding) -> Any:
        width = {"uv": 2, "float": 1}.get(binding.kind, 3)
        return self._mean(self._geometry.attribute(binding), self._geometry._corners, width)

    def _mean(self, values: Any, corners: Any, width: int) -> Any:
        mi = self._geometry._mi
        kind = {1: mi.Float, 2: mi.Vector2f, 3: mi.Vector3f}[width]
        numbers = dr.gather(mi.Vector3u, corners, self._triangle, self._active)
        return sum(
            weight * dr.gather(kind, values, number, self._active)
            for weight, number in zip(self._weights, numbers, strict=True)
        )


def _placed(points: NDArray[np.float32], matrix: Floats) -> Floats:
    return np.asarray(points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3])


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / _lengths(vectors)[..., None])


def _lengths(vectors: Floats) -> Floats:
    # Of vectors of three a fifth of the time that `np.linalg.norm` takes.
    return np.asarray(np.sqrt(np.einsum("...i,...i", vectors, vectors)))
