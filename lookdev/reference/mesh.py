"""An asset as triangles that rays meet: Embree finds a triangle in float32, the hit is computed in float64.

Polygons are split as Cycles splits them: a quad along the diagonal from its first corner, unless that lies outside it.
Attributes of corners are interpolated linearly over a triangle. A ray that leaves a triangle never meets that triangle,
independent of rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from lookdev.asset import Asset, Mesh
from lookdev.asset.tangents import handedness, tangents_of
from lookdev.asset.triangles import corner_triangles
from lookdev.brdf import Bsdf
from lookdev.errors import AssetError
from lookdev.material import Look, Primvar
from lookdev.material.points import ImagePoints
from lookdev.material.values import look_bsdf
from lookdev.scene.shading import shading_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Places = NDArray[Any]

_PLACE = np.dtype([("triangle", np.int64), ("weights", np.float64, (3,))])
_LIFT = 3e-7  # in the asset's size: above the rounding to float32 of a place and of its triangle


class MeshScene:
    """An asset and the looks of its slots, as a `lookdev.reference.render.Scene`.

    A place is a triangle and the weights of its corners.
    """

    def __init__(
        self,
        asset: Asset,
        looks: Sequence[Look],
        lit_by: Sequence[Sequence[int]] | None = None,
        groups: Sequence[int] = (),
        *,
        shadows: bool = True,
    ) -> None:
        """`looks`, the numbers of the lights that light them, and `groups` are of the slots.

        None: all lights light all; (): all slots are of group 0. Without `shadows` rays that leave a surface meet
        nothing: all light arrives, and none from other places.
        """
        self._asset = asset
        self._lit_by = lit_by
        self._shadows = shadows
        self._groups = np.array(groups or [0] * len(looks))
        self._looks = list({id(look): look for look in looks}.values())
        numbers = {id(look): number for number, look in enumerate(self._looks)}
        worn = np.array([numbers[id(look)] for look in looks])
        self._first_corner = np.cumsum([0, *(len(mesh.corner_points) for mesh in asset.meshes)])
        split = [corner_triangles(mesh) for mesh in asset.meshes]
        positions, corners, wearing, owners, slots = [], [], [], [], []
        for number, instance in enumerate(asset.instances):
            mesh, (triangles, faces) = asset.meshes[instance.mesh], split[instance.mesh]
            points = mesh.points.astype(np.float64) @ instance.matrix[:3, :3].T + instance.matrix[:3, 3]
            positions.append(points[mesh.corner_points[triangles]])
            corners.append(triangles + self._first_corner[instance.mesh])
            wearing.append(worn[mesh.face_slots[faces]])
            owners.append(np.full(len(faces), number))
            slots.append(mesh.face_slots[faces])
        self._positions = np.concatenate(positions)
        edges = self._positions[:, 1:] - self._positions[:, :1]
        normals = np.cross(edges[:, 0], edges[:, 1])
        area = np.linalg.norm(normals, axis=-1, keepdims=True)
        met = area[:, 0] > 0.0
        self._positions, self._facets = self._positions[met], normals[met] / area[met]
        self._corners, self._worn, self._owners, self._slots = (
            np.concatenate(arrays)[met].astype(np.int64) for arrays in (corners, wearing, owners, slots)
        )
        self._linear = np.stack([instance.matrix[:3, :3] for instance in asset.instances])
        self._inverse = np.linalg.inv(self._linear)
        # A reflected instance reflects its bitangents.
        self._reflected = np.linalg.det(self._linear) < 0.0
        self._normals = np.concatenate([mesh.normals for mesh in asset.meshes]).astype(np.float64)
        self._tangents = np.concatenate(tangents_of(asset.meshes)).astype(np.float64)
        self._carried: dict[object, Floats] = {}
        # Embree computes in float32: the asset is moved to the origin and scaled to unit size.
        self._occluding: dict[tuple[int, ...], _Occluder] = {
            (): _Occluder.of(self._local(self._positions), np.arange(len(self._positions)))
        }

    def hit(self, origin: Floats, ray: Floats) -> tuple[Mask, Places]:
        origins = np.broadcast_to(origin, ray.shape)
        return self._meet(self._occluding[()], origins, self._local(origins), ray, np.full(len(ray), -1))

    def onward(self, place: Places, direction: Floats, spared: tuple[int, ...] = ()) -> tuple[Mask, Places]:
        if not self._shadows:
            return np.zeros(len(place), np.bool_), place.copy()
        origin, facet = self.points(place), self._facets[place["triangle"]]
        # Rounded, a place can lie behind the plane of its triangle, which neighbours may continue: it is lifted off.
        lifted = self._local(origin) + np.copysign(_LIFT, _dot(facet, direction)) * facet
        if spared not in self._occluding:
            kept = np.flatnonzero(~np.isin(self._groups[self._slots], spared))
            self._occluding[spared] = _Occluder.of(self._local(self._positions[kept]), kept)
        return self._meet(self._occluding[spared], origin, lifted.astype(np.float32), direction, place["triangle"])

    def points(self, place: Places) -> Floats:
        return self._mean(self._positions[place["triangle"]], place)

    def lit(self, place: Places, light: int) -> Mask | None:
        """Return which places a light lights, by its number; None: all."""
        if self._lit_by is None:
            return None
        lit: Mask = np.array([light in each for each in self._lit_by])
        return np.asarray(lit[self._slots[place["triangle"]]])

    def inside(self, place: Places, wo: Floats) -> Mask:
        facet = self._facets[place["triangle"]]
        against = _dot(self._normals_at(place), facet) * _dot(facet, wo)
        return np.asarray(against[:, 0] < 0.0)

    def _normals_at(self, place: Places) -> Floats:
        """Return the interpolated normals (N, 3), of any length."""
        triangle = place["triangle"]
        normals = self._mean(self._normals[self._corners[triangle]], place)
        return np.asarray(np.einsum("nji,nj->ni", self._inverse[self._owners[triangle]], normals))

    def frame(self, place: Places, wo: Floats) -> tuple[Floats, Floats]:
        triangle = place["triangle"]
        owner, corners = self._owners[triangle], self._corners[triangle]
        n = self._normals_at(place)
        t = np.einsum("nij,nj->ni", self._linear[owner], self._mean(self._tangents[corners], place))
        hand = np.where(self._reflected[owner], -1.0, 1.0)
        n /= np.linalg.norm(n, axis=-1, keepdims=True)
        frame = shading_frame(n, t, self._facets[triangle], wo, hand)
        axes = (frame.tangent, frame.bitangent, frame.normal)
        return np.stack([np.asarray(axis) for axis in axes], axis=1), np.asarray(frame.facet)

    def bsdfs(self, place: Places, view: Floats) -> Iterator[tuple[Ints, Bsdf]]:
        """Yield the places of each look, and its BSDF there, as `Scene`.

        Raises
        ------
        ModelError, TextureError
            A look is wrong, or an image of it is.
        AssetError
            The asset lacks a UV set that a look reads, or has a primvar of another width.
        """
        worn = self._worn[place["triangle"]]
        for number in np.unique(worn):
            index = np.flatnonzero(worn == number)
            yield index, look_bsdf(self._looks[number], MeshPoints(self, place[index], view[index]))

    def interpolated(
        self, place: Places, key: object, what: str, read: Callable[[Mesh], NDArray[Any] | None], width: int
    ) -> Floats:
        """Interpolate an attribute of the meshes' corners, (N, width), `read` once for each `key`; None: not there."""
        if key not in self._carried:
            columns = []
            for mesh in self._asset.meshes:
                value, count = read(mesh), len(mesh.corner_points)
                if value is not None and value.size != count * width:
                    found = value.size // count
                    raise AssetError(f"{mesh.name}: {what} has {found} numbers a corner, the look reads {width}")
                columns.append(np.full((count, width), np.nan) if value is None else value.reshape(count, width))
            self._carried[key] = np.concatenate(columns).astype(np.float64)
        value = self._mean(self._carried[key][self._corners[place["triangle"]]], place)
        if (missing := np.isnan(value).any(axis=-1)).any():
            owner = self._owners[place["triangle"][missing][0]]
            mesh = self._asset.meshes[self._asset.instances[owner].mesh]
            raise AssetError(f"{mesh.name}: no {what}; it has: {', '.join(mesh.uvs)}")
        return value

    def _mean(self, corners: Floats, place: Places) -> Floats:
        return np.asarray(np.einsum("nk,nkj->nj", place["weights"], corners))

    def _local(self, points: Floats) -> NDArray[np.float32]:
        local = (points - np.array(self._asset.center)) / self._asset.radius
        return np.asarray(local, np.float32)

    def _meet(
        self, occluder: _Occluder, origin: Floats, start: NDArray[np.float32], direction: Floats, leaving: Ints
    ) -> tuple[Mask, Places]:
        """Trace rays to the first triangle but `leaving`, -1 for none; `start` is their origin in float32."""
        along, step = direction.astype(np.float32), _LIFT
        triangle, distance = occluder.met(start, along)
        # A triangle is flat: any other hit is beyond an apparent hit on the triangle that a ray leaves.
        while len(again := np.flatnonzero((triangle >= 0) & (triangle == leaving))):
            start[again] += (distance[again, None] + np.float32(step)) * along[again]
            triangle[again], distance[again] = occluder.met(start[again], along[again])
            step *= 2.0
        hit = triangle >= 0
        place = np.zeros(len(along), _PLACE)
        place["triangle"][hit] = triangle[hit]
        place["weights"][hit] = self._weights(triangle[hit], origin[hit], direction[hit])
        return hit, place

    def _weights(self, triangle: Ints, origin: Floats, direction: Floats) -> Floats:
        """Return the weights (N, 3) of the corners where rays meet triangles (Möller and Trumbore 1997)."""
        corners = self._positions[triangle]
        edge1, edge2, start = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], origin - corners[:, 0]
        p, q = np.cross(direction, edge2), np.cross(start, edge1)
        determinant = _dot(edge1, p)
        # A ray in the plane of its triangle has no single hit; and a ray can miss the triangle that Embree found.
        inverse = 1.0 / np.where(determinant == 0.0, 1.0, determinant)
        w1 = np.clip(_dot(start, p) * inverse, 0.0, 1.0)
        w2 = np.clip(_dot(direction, q) * inverse, 0.0, 1.0 - w1)
        return np.concatenate([1.0 - w1 - w2, w1, w2], axis=-1)


@dataclass(frozen=True)
class _Occluder:
    """Some triangles in Embree, and their numbers among all."""

    embree: EmbreeScene
    numbers: Ints

    @classmethod
    def of(cls, positions: NDArray[np.float32], numbers: Ints) -> _Occluder:
        embree = EmbreeScene(robust=True)
        if len(positions):
            TriangleMesh(embree, positions)
        return cls(embree, np.append(numbers, -1))

    def met(self, start: NDArray[np.float32], along: NDArray[np.float32]) -> tuple[Ints, NDArray[np.float32]]:
        """Return the number of the first triangle on rays (N, 3), -1 for none, and its distance (N,)."""
        found = self.embree.run(start, along, output=True)
        return self.numbers[found["primID"].astype(np.int64)], found["tfar"]


@dataclass(frozen=True)
class MeshPoints(ImagePoints):
    """Places of a scene as a `lookdev.material.values.Surface`."""

    scene: MeshScene
    place: Places
    cosine: Floats

    def uv(self, name: str) -> Floats:
        return self.scene.interpolated(self.place, name, f"UV set '{name}'", lambda mesh: mesh.uvs.get(name), 2)

    def primvar(self, primvar: Primvar) -> Floats:
        fallback = np.atleast_1d(np.asarray(primvar.fallback, np.float64))

        def read(mesh: Mesh) -> NDArray[Any]:
            return mesh.primvars.get(primvar.name, np.broadcast_to(fallback, (len(mesh.corner_points), len(fallback))))

        value = self.scene.interpolated(self.place, primvar, f"primvar '{primvar.name}'", read, len(fallback))
        return value if isinstance(primvar.fallback, tuple) else value[:, 0]

    def handedness(self) -> Floats:
        return self.scene.interpolated(self.place, handedness, "handedness", handedness, 1)[:, 0]

    def view(self) -> Floats:
        return self.cosine


def _dot(a: Floats, b: Floats) -> Floats:
    """Return the dot product over the last axis, kept as an axis of length 1."""
    return np.asarray(np.einsum("ni,ni->n", a, b)[:, None])
