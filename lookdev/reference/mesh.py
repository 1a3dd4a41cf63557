"""An asset as triangles for the reference renderer, which traces rays against them.

Embree finds the triangle that a ray hits in float32; the point of the hit is computed in float64. Polygons are split as
in Cycles: a quad along the diagonal from its first corner, unless this diagonal lies outside the quad. Attributes of
corners are interpolated linearly over a triangle. A ray that leaves a triangle never hits the same triangle, whatever
the rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from lookdev.arrays import Bools, Elements, Floats, Floats32, Ints, Records
from lookdev.asset import Asset, Mesh
from lookdev.asset.tangents import handedness, tangents_of
from lookdev.asset.triangles import corner_triangles
from lookdev.brdf import Bsdf
from lookdev.errors import AssetError
from lookdev.material import Look, Primvar
from lookdev.material.points import ImagePoints
from lookdev.material.values import look_bsdf
from lookdev.scene.shading import shading_frame

MeshHits = Records
"""Hits as an array (N,) of records: the number of the triangle, and the weights of its three corners."""

_HIT = np.dtype([("triangle", np.int64), ("weights", np.float64, (3,))])
# The distance, relative to the asset's radius, by which the origin of a ray is lifted off a triangle. It is larger than
# the errors of rounding the hit and the triangle to float32.
_LIFT = 3e-7


class MeshScene:
    """An asset and the looks of its slots, as a `lookdev.reference.render.ReferenceScene`.

    The slot of a face selects its look. Methods without a docstring are described in `ReferenceScene`.
    """

    def __init__(
        self,
        asset: Asset,
        looks: Sequence[Look],
        lights_of_slot: Sequence[Sequence[int]] | None = None,
        groups: Sequence[int] = (),
        *,
        shadows: bool = True,
    ) -> None:
        """Build the scene of an asset.

        Parameters
        ----------
        asset
            The asset, in world space.
        looks
            The look of each slot.
        lights_of_slot
            For each slot, the numbers of the lights that illuminate it. None: all lights illuminate all slots.
        groups
            For each slot, its group, by which a light's shadow can exclude parts. Empty: all slots are in group 0.
        shadows
            Without shadows, rays that leave a surface hit nothing: all light arrives, and none is interreflected.
        """
        self._asset = asset
        self._lights_of_slot = lights_of_slot
        self._shadows = shadows
        self._groups = np.array(groups or [0] * len(looks))
        self._looks = list({id(look): look for look in looks}.values())
        numbers = {id(look): number for number, look in enumerate(self._looks)}
        slot_looks = np.array([numbers[id(look)] for look in looks])
        first_corner = np.cumsum([0, *(len(mesh.corner_points) for mesh in asset.meshes)])
        triangulations = [corner_triangles(mesh) for mesh in asset.meshes]
        # For each instance, arrays over its triangles: the positions of the corners (3, 3), the numbers of the corners
        # among the corners of all meshes (3,), the number of the instance, and the slot.
        parts = []
        for number, instance in enumerate(asset.instances):
            mesh, (triangles, faces) = asset.meshes[instance.mesh], triangulations[instance.mesh]
            points = mesh.points.astype(np.float64) @ instance.matrix[:3, :3].T + instance.matrix[:3, 3]
            corners, owners = triangles + first_corner[instance.mesh], np.full(len(faces), number)
            parts.append((points[mesh.corner_points[triangles]], corners, owners, mesh.face_slots[faces]))
        self._positions, *numbers_of_triangles = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        edges = self._positions[:, 1:] - self._positions[:, :1]
        normals = np.cross(edges[:, 0], edges[:, 1])
        area = np.linalg.norm(normals, axis=-1, keepdims=True)
        has_area = area[:, 0] > 0.0
        # `_facets` are the geometric normals of the triangles, (T, 3); `_owners` are the numbers of their instances.
        self._positions, self._facets = self._positions[has_area], normals[has_area] / area[has_area]
        self._corners, self._owners, self._slots = (array[has_area].astype(np.int64) for array in numbers_of_triangles)
        self._triangle_looks = slot_looks[self._slots]
        # For each instance: the linear part of its matrix, the inverse of this part, and whether it is a reflection.
        self._linear = np.stack([instance.matrix[:3, :3] for instance in asset.instances])
        self._inverse = np.linalg.inv(self._linear)
        # A reflection also mirrors bitangents.
        self._reflected = np.linalg.det(self._linear) < 0.0
        # The attributes of the corners of all meshes.
        self._normals = np.concatenate([mesh.normals for mesh in asset.meshes]).astype(np.float64)
        self._tangents = np.concatenate(tangents_of(asset.meshes)).astype(np.float64)
        self._corner_values: dict[object, Floats] = {}
        # By the groups that an occluder leaves out. Embree computes in float32, so positions are moved to the origin
        # and scaled.
        self._occluders: dict[tuple[int, ...], _Occluder] = {
            (): _Occluder.build(self._normalize(self._positions), np.arange(len(self._positions)))
        }

    def intersect(self, origin: Floats, ray: Floats) -> tuple[Bools, MeshHits]:
        origins = np.broadcast_to(origin, ray.shape)
        return self._trace(self._occluders[()], origins, self._normalize(origins), ray, np.full(len(ray), -1))

    def trace_onward(
        self, hits: MeshHits, direction: Floats, excluded_groups: tuple[int, ...] = ()
    ) -> tuple[Bools, MeshHits]:
        if not self._shadows:
            return np.zeros(len(hits), np.bool_), hits.copy()
        origin, facet = self.points(hits), self._facets[hits["triangle"]]
        # By rounding, a hit can lie behind the plane of its triangle, and neighbours may continue this plane. The
        # origin of the ray is therefore lifted off the plane.
        lifted = self._normalize(origin) + np.copysign(_LIFT, _dot(facet, direction)) * facet
        if excluded_groups not in self._occluders:
            included = np.flatnonzero(~np.isin(self._groups[self._slots], excluded_groups))
            self._occluders[excluded_groups] = _Occluder.build(self._normalize(self._positions[included]), included)
        return self._trace(
            self._occluders[excluded_groups], origin, lifted.astype(np.float32), direction, hits["triangle"]
        )

    def points(self, hits: MeshHits) -> Floats:
        return self._interpolate_corners(self._positions[hits["triangle"]], hits)

    def is_reached_by(self, hits: MeshHits, light: int) -> Bools | None:
        """Return a mask (N,) of the hits that light number `light` illuminates; None if all lights reach all slots."""
        if self._lights_of_slot is None:
            return None
        is_slot_lit: Bools = np.array([light in lights for lights in self._lights_of_slot])
        return np.asarray(is_slot_lit[self._slots[hits["triangle"]]])

    def is_inside(self, hits: MeshHits, wo: Floats) -> Bools:
        facet = self._facets[hits["triangle"]]
        against = _dot(self._normals_at(hits), facet) * _dot(facet, wo)
        return np.asarray(against[:, 0] < 0.0)

    def _normals_at(self, hits: MeshHits) -> Floats:
        """Return the interpolated normals (N, 3), of any length."""
        triangle = hits["triangle"]
        normals = self._interpolate_corners(self._normals[self._corners[triangle]], hits)
        return np.asarray(np.einsum("nji,nj->ni", self._inverse[self._owners[triangle]], normals))

    def frame(self, hits: MeshHits, wo: Floats) -> tuple[Floats, Floats]:
        triangle = hits["triangle"]
        owner, corners = self._owners[triangle], self._corners[triangle]
        n = self._normals_at(hits)
        t = np.einsum("nij,nj->ni", self._linear[owner], self._interpolate_corners(self._tangents[corners], hits))
        hand = np.where(self._reflected[owner], -1.0, 1.0)
        n /= np.linalg.norm(n, axis=-1, keepdims=True)
        frame = shading_frame(n, t, self._facets[triangle], wo, hand)
        axes = (frame.tangent, frame.bitangent, frame.normal)
        return np.stack([np.asarray(axis) for axis in axes], axis=1), np.asarray(frame.facet)

    def bsdfs(self, hits: MeshHits, view: Floats) -> Iterator[tuple[Ints, Bsdf]]:
        """Yield, for each look, the indices of its hits and its BSDF there; see `ReferenceScene`.

        Raises
        ------
        ModelError, TextureError
            A look, or one of its images, is wrong.
        AssetError
            The asset lacks a UV set that a look reads, or its primvar has another width.
        """
        looks = self._triangle_looks[hits["triangle"]]
        for number in np.unique(looks):
            index = np.flatnonzero(looks == number)
            yield index, look_bsdf(self._looks[number], MeshPoints(self, hits[index], view[index]))

    def interpolate(
        self, hits: MeshHits, key: object, label: str, read: Callable[[Mesh], Elements | None], width: int
    ) -> Floats:
        """Return an attribute of corners, interpolated at hits, (N, width).

        `read` returns the attribute of a mesh, or None if there is none. It is called only once for each mesh and
        `key`; the key identifies the attribute. `label` is the attribute's name in errors.
        """
        if key not in self._corner_values:
            columns = []
            for mesh in self._asset.meshes:
                value, count = read(mesh), len(mesh.corner_points)
                if value is not None and value.size != count * width:
                    actual = value.size // count
                    raise AssetError(f"{mesh.name}: {label} has {actual} numbers a corner, the look reads {width}")
                columns.append(np.full((count, width), np.nan) if value is None else value.reshape(count, width))
            self._corner_values[key] = np.concatenate(columns).astype(np.float64)
        value = self._interpolate_corners(self._corner_values[key][self._corners[hits["triangle"]]], hits)
        if (missing := np.isnan(value).any(axis=-1)).any():
            owner = self._owners[hits["triangle"][missing][0]]
            mesh = self._asset.meshes[self._asset.instances[owner].mesh]
            raise AssetError(f"{mesh.name}: no {label}; it has: {', '.join(mesh.uvs)}")
        return value

    def _interpolate_corners(self, corners: Floats, hits: MeshHits) -> Floats:
        """Return the weighted means (N, width) of values (N, 3, width) at the corners of the triangles that are hit."""
        return np.asarray(np.einsum("nk,nkj->nj", hits["weights"], corners))

    def _normalize(self, points: Floats) -> Floats32:
        """Return points relative to the asset's centre, divided by its radius, in float32."""
        local = (points - np.array(self._asset.center)) / self._asset.radius
        return np.asarray(local, np.float32)

    def _trace(
        self, occluder: _Occluder, origin: Floats, start: Floats32, direction: Floats, leaving: Ints
    ) -> tuple[Bools, MeshHits]:
        """Trace rays to the first triangle other than the triangle that they leave.

        `leaving` (N,) is the number of that triangle, or -1. `start` is the normalized origin of the rays in float32.
        Returns a mask (N,) of the rays that hit, and the hits.
        """
        along, step = direction.astype(np.float32), _LIFT
        triangle, distance = occluder.trace(start, along)
        # An apparent hit on the triangle that a ray leaves is a rounding error. As a triangle is flat, all other hits
        # are farther along the ray, so the ray continues beyond the apparent hit.
        while len(again := np.flatnonzero((triangle >= 0) & (triangle == leaving))):
            start[again] += (distance[again, None] + np.float32(step)) * along[again]
            triangle[again], distance[again] = occluder.trace(start[again], along[again])
            step *= 2.0
        is_hit = triangle >= 0
        hits = np.zeros(len(along), _HIT)
        hits["triangle"][is_hit] = triangle[is_hit]
        hits["weights"][is_hit] = self._weights(triangle[is_hit], origin[is_hit], direction[is_hit])
        return is_hit, hits

    def _weights(self, triangle: Ints, origin: Floats, direction: Floats) -> Floats:
        """Return the weights (N, 3) of the corners where rays hit the planes of triangles (Möller and Trumbore 1997).

        The weights are clipped, so that the point is in the triangle.
        """
        corners = self._positions[triangle]
        edge1, edge2, start = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], origin - corners[:, 0]
        p, q = np.cross(direction, edge2), np.cross(start, edge1)
        determinant = _dot(edge1, p)
        # The determinant is 0 if the ray is in the plane of the triangle. In float64 a ray can miss the triangle that
        # Embree has found in float32; the clipped weights are then the weights of a point at its edge.
        inverse = 1.0 / np.where(determinant == 0.0, 1.0, determinant)
        w1 = np.clip(_dot(start, p) * inverse, 0.0, 1.0)
        w2 = np.clip(_dot(direction, q) * inverse, 0.0, 1.0 - w1)
        return np.concatenate([1.0 - w1 - w2, w1, w2], axis=-1)


@dataclass(frozen=True)
class _Occluder:
    """Some of the triangles, as a scene of Embree.

    `numbers` has their numbers among all triangles, and -1 at the end: Embree's index -1, for no hit, selects this -1.
    """

    embree: EmbreeScene
    numbers: Ints

    @classmethod
    def build(cls, positions: Floats32, numbers: Ints) -> _Occluder:
        """Return the scene of triangles with the positions (T, 3, 3) of their corners and the numbers (T,)."""
        embree = EmbreeScene(robust=True)
        if len(positions):
            TriangleMesh(embree, positions)
        return cls(embree, np.append(numbers, -1))

    def trace(self, start: Floats32, along: Floats32) -> tuple[Ints, Floats32]:
        """Return the number (N,) of the first triangle on each ray, -1 for none, and its distance (N,)."""
        result = self.embree.run(start, along, output=True)
        return self.numbers[result["primID"].astype(np.int64)], result["tfar"]


@dataclass(frozen=True)
class MeshPoints(ImagePoints):
    """Hits of a scene as points at which looks are evaluated (`lookdev.material.values.Surface`).

    `cosine` (N,) is the cosine between the shading normal and the direction to the viewer.
    """

    scene: MeshScene
    hits: MeshHits
    cosine: Floats

    def uv(self, name: str) -> Floats:
        return self.scene.interpolate(self.hits, name, f"UV set '{name}'", lambda mesh: mesh.uvs.get(name), 2)

    def primvar(self, primvar: Primvar) -> Floats:
        fallback = np.atleast_1d(np.asarray(primvar.fallback, np.float64))

        def read(mesh: Mesh) -> Elements:
            return mesh.primvars.get(primvar.name, np.broadcast_to(fallback, (len(mesh.corner_points), len(fallback))))

        value = self.scene.interpolate(self.hits, primvar, f"primvar '{primvar.name}'", read, len(fallback))
        return value if isinstance(primvar.fallback, tuple) else value[:, 0]

    def handedness(self) -> Floats:
        return self.scene.interpolate(self.hits, handedness, "handedness", handedness, 1)[:, 0]

    def view(self) -> Floats:
        return self.cosine


def _dot(a: Floats, b: Floats) -> Floats:
    """Return the dot product over the last axis, kept as an axis of length 1."""
    return np.asarray(np.einsum("ni,ni->n", a, b)[:, None])
