"""The geometry of an asset in Mitsuba: triangles that rays hit, and attributes that shading interpolates over them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import drjit as dr
import numpy as np

from lookdev.arrays import Bools, Elements, Floats, Floats32, Ints
from lookdev.asset import Asset, Mesh
from lookdev.asset.tangents import handedness, tangents_of
from lookdev.asset.triangles import corner_triangles
from lookdev.codegen.source import HANDEDNESS, TANGENT, AttributeBinding
from lookdev.errors import AssetError, RenderError
from lookdev.mitsuba.copies import Body, Copies, bodies_of
from lookdev.mitsuba.frozen import device_array
from lookdev.mitsuba.types import UV, AnyArray, Bool, Float, Intersection, Mitsuba, Ray3f, TracedScene, UInt, Vector3f
from lookdev.scene.shading import LIFT

MAX_TRIANGLES = 40_000_000
"""The most triangles of all meshes, each mesh counted once. More triangles would need over 10 GB."""

_MAX_INSTANCED_TRIANGLES = 1 << 32  # the most triangles of all instances: their numbers have 32 bits


class Geometry:
    """The triangles of an asset in a variant's arrays, in metres relative to the asset's centre.

    All triangles of all instances are numbered consecutively. The triangles of meshes with a single instance come
    first; these meshes together are one mesh of Mitsuba. The triangles of the other meshes follow, one instance after
    the other. A triangle has a row in the tables of data, such as corners; the instances of a mesh share its rows
    (`lookdev.mitsuba.copies`). `assign_looks` must be called before looks are looked up.
    """

    def __init__(self, mi: Mitsuba, asset: Asset) -> None:
        self._mi = mi
        self.asset = asset
        self.center = np.array(asset.center)
        self._bodies = bodies_of(asset, self.center)
        # The corners (n, 3) and the face (n,) of each triangle of a mesh, by the index of the mesh.
        triangles_of_mesh = {body.mesh: corner_triangles(asset.meshes[body.mesh]) for body in self._bodies}
        count = sum(len(faces) for _, faces in triangles_of_mesh.values())
        instanced = sum(len(triangles_of_mesh[instance.mesh][1]) for instance in asset.instances)
        if count > MAX_TRIANGLES or instanced > _MAX_INSTANCED_TRIANGLES:
            raise RenderError(
                f"{asset.name}: {count} triangles, {instanced} in all instances; at most {MAX_TRIANGLES}, and "
                f"{_MAX_INSTANCED_TRIANGLES} in all instances, can be shown by backend 'mitsuba': 'exact' would be "
                "right"
            )
        meshes = [asset.meshes[body.mesh] for body in self._bodies]
        first_corners = np.cumsum([0, *(len(mesh.corner_points) for mesh in meshes)])
        points = [_transform_points(asset.meshes[body.mesh].points, body.matrix) for body in self._bodies]
        first_points = np.cumsum([0, *map(len, points)])
        # The tables of triangles, one row for each: points (3), corners (3), slot, handedness and body.
        vertices, corners, slots, signs, body_of_row = [], [], [], [], []
        for number, (body, mesh) in enumerate(zip(self._bodies, meshes, strict=True)):
            triangles, faces = triangles_of_mesh[body.mesh]
            vertices.append(mesh.corner_points[triangles] + first_points[number])
            corners.append(triangles + first_corners[number])
            slots.append(mesh.face_slots[faces])
            signs.append(np.full(len(faces), np.sign(np.linalg.det(body.matrix[:3, :3]))))
            body_of_row.append(np.full(len(faces), number))
        position = np.concatenate(points).astype(np.float32)
        index = np.concatenate(vertices)
        triangle_points = position[index].astype(np.float64)
        facets = np.cross(triangle_points[:, 1] - triangle_points[:, 0], triangle_points[:, 2] - triangle_points[:, 0])
        has_area = _lengths(facets) > 0.0  # triangles without area are left out
        index, triangle_points, facets = index[has_area], triangle_points[has_area], facets[has_area]
        self._facets = device_array(mi.Float, _unit(facets))
        self._corners = device_array(mi.UInt32, np.concatenate(corners)[has_area])
        self._slots = np.concatenate(slots)[has_area]
        self._handedness = device_array(mi.Float, np.concatenate(signs)[has_area])
        self._body_of_row = np.concatenate(body_of_row)[has_area]
        self._first_instance = device_array(
            mi.UInt32, np.array([body.instances[0] for body in self._bodies])[self._body_of_row]
        )
        self._lifts = device_array(mi.Float, LIFT * _lengths(triangle_points).max(axis=-1))
        self._position = device_array(mi.Float, position)
        self._index = device_array(mi.UInt32, index)
        # The transformed normals are not normalised, so that they are interpolated as in the space of the mesh. The
        # matrix of the body may stretch this space.
        self._normals = self._corner_array(
            lambda body, mesh: mesh.normals.astype(np.float64) @ np.linalg.inv(body.matrix[:3, :3]), 3
        )
        self._attributes: dict[AttributeBinding, Float] = {}
        self._vertices, self._first = index, first_points  # point numbers (rows, 3), and the first point of each body
        self._copies = Copies.from_bodies(mi, self._bodies, self._body_of_row, asset, self.center)
        self.scene = self._scene(np.ones(len(index), np.bool_), numbered=True)
        self._shadow_scenes: dict[tuple[int, ...], TracedScene] = {}

    def assign_looks(self, looks: Sequence[int], groups: Sequence[int] = ()) -> None:
        """Set the number of the look of each slot, and the number of the slot's shadow group.

        The shadow of a light may exclude some groups. By default, each slot is a group.
        """
        self._look_of_row = device_array(self._mi.UInt32, np.asarray(looks)[self._slots])
        self._groups = np.asarray(groups)[self._slots] if groups else self._slots
        self._shadow_scenes = {(): self.scene}

    def _scene(self, rows: Bools, *, numbered: bool = False) -> TracedScene:
        """Return Mitsuba's scene with the triangles of the selected rows, a mask (rows,).

        With `numbered`, record the numbers of its instances, so that `triangle_of` works for hits in this scene.
        """
        mi, shapes = self._mi, {}
        single = self._body_of_row < len(self._bodies) - self._copies.bodies
        if (rows & single).any():
            shapes["asset"] = self._mesh(self._vertices[rows & single], 0, len(self._position) // 3)
        for number in range(len(self._bodies) - self._copies.bodies, len(self._bodies)):
            body_rows = rows & (self._body_of_row == number)
            if not body_rows.any():
                continue
            first, last = self._first[number : number + 2]
            group = mi.load_dict({"type": "shapegroup", "mesh": self._mesh(self._vertices[body_rows], first, last)})
            shapes[f"group{number}"] = group
            for instance in self._bodies[number].instances:
                matrix = mi.ScalarTransform4f(self._copies.matrices[instance])
                shapes[f"instance{instance}"] = mi.load_dict({"type": "instance", "group": group, "to_world": matrix})
        scene: TracedScene = mi.load_dict({"type": "scene", **shapes})
        if numbered:
            self._copies.find_instances(shapes)
        return scene

    def _mesh(self, index: Ints, first: int, last: int) -> object:
        """Return a mesh of Mitsuba with points `first` up to `last`; `index` (n, 3) are point numbers of triangles."""
        mi = self._mi
        mesh = mi.Mesh("asset", last - first, len(index))
        parameters = mi.traverse(mesh)
        whole = 3 * (last - first) == len(self._position)
        points = self._position if whole else device_array(mi.Float, np.asarray(self._position)[3 * first : 3 * last])
        parameters["vertex_positions"] = points
        parameters["faces"] = mi.UInt32((index - first).astype(np.uint32).ravel())
        parameters.update()
        return mesh

    def shadow_scene(self, excluded: tuple[int, ...]) -> TracedScene:
        """Return the scene of the parts that cast a light's shadow: all parts except the `excluded` groups."""
        if excluded not in self._shadow_scenes:
            self._shadow_scenes[excluded] = self._scene(~np.isin(self._groups, excluded))
        return self._shadow_scenes[excluded]

    def attribute(self, binding: AttributeBinding) -> Float:
        """Return the values of an attribute at all corners of faces: a flat array of 1, 2 or 3 numbers per corner.

        Raises AssetError where a mesh lacks the attribute and there is no fallback.
        """
        if binding not in self._attributes:
            width = {"uv": 2, "float": 1}.get(binding.kind, 3)
            self._attributes[binding] = self._corner_array(
                lambda body, mesh: self._read_attribute(binding, body, mesh), width
            )
        return self._attributes[binding]

    def _read_attribute(self, binding: AttributeBinding, body: Body, mesh: Mesh) -> Elements:
        """Return the values of an attribute at the corners of a mesh; tangents are in the space of the body."""
        if binding.attribute == TANGENT:
            (tangents,) = tangents_of([mesh])
            return tangents @ body.matrix[:3, :3].T
        if binding.attribute == HANDEDNESS:
            return handedness(mesh)
        values = (mesh.uvs if binding.kind == "uv" else mesh.primvars).get(binding.attribute)
        if values is not None:
            return values
        if binding.fallback is None:
            raise AssetError(f"{mesh.name}: no UV set '{binding.attribute}'; it has: {', '.join(mesh.uvs)}")
        return np.broadcast_to(np.array(binding.fallback), (len(mesh.corner_points), len(binding.fallback)))

    def _corner_array(self, read: Callable[[Body, Mesh], Elements], width: int) -> Float:
        """Return a flat array of the numbers that `read` returns for each body, `width` numbers per corner."""
        rows = [read(body, self.asset.meshes[body.mesh]) for body in self._bodies]
        return device_array(self._mi.Float, np.concatenate([row.reshape(-1, width) for row in rows]))

    def look_of(self, triangle: UInt) -> UInt:
        """Return the number of the look of a triangle."""
        return dr.gather(self._mi.UInt32, self._look_of_row, self._copies.row(triangle))

    def first_hit(self, ray: Ray3f, active: Bool | bool = True) -> tuple[UInt, UV, Bool, Float]:
        """Return where rays hit: triangle numbers (0 for none), barycentric coordinates, hit masks, and distances."""
        intersection = self.scene.ray_intersect_preliminary(ray, coherent=True, active=active)
        hit = intersection.is_valid()
        return dr.select(hit, self.triangle_of(intersection), 0), intersection.prim_uv, hit, intersection.t

    def triangle_of(self, intersection: Intersection) -> UInt:
        """Return the numbers of the triangles that rays have hit in `scene`."""
        return self._copies.triangle_of(intersection)

    def instance(self, triangle: UInt) -> UInt:
        """Return the number of the instance to which a triangle belongs."""
        return self._copies.instance(
            triangle, dr.gather(self._mi.UInt32, self._first_instance, self._copies.row(triangle))
        )

    def first_uv(self) -> Float:
        """Return the first UV set of each mesh at all corners, a flat array; 0 for a mesh without UV sets."""

        def read(body: Body, mesh: Mesh) -> Elements:
            return next(iter(mesh.uvs.values()), np.zeros((len(mesh.corner_points), 2), np.float32))

        return self._corner_array(read, 2)

    def at(self, triangle: UInt, uv: UV, active: Bool) -> Hit:
        """Return an object that interpolates attributes at barycentric coordinates of triangles."""
        return Hit(self, triangle, uv, active)


class Hit:
    """Points on triangles, at which attributes are interpolated. Vectors are in world space."""

    def __init__(self, geometry: Geometry, triangle: UInt, uv: UV, active: Bool) -> None:
        self._geometry = geometry
        self._copies = geometry._copies
        self._copy = self._copies.copy_of(triangle)
        self._triangle = self._copies.row(triangle, self._copy)
        self._weights = (1.0 - uv.x - uv.y, uv.x, uv.y)
        self._active = active

    @property
    def point(self) -> Vector3f:
        """The position, relative to the asset's centre."""
        geometry = self._geometry
        return self._copies.point(self._copy, self._interpolate(geometry._position, geometry._index, 3))

    @property
    def normal(self) -> Vector3f:
        """The interpolated shading normal, of unit length."""
        mean = self._interpolate(self._geometry._normals, self._geometry._corners, 3)
        return dr.normalize(mean) if self._copy is None else self._copies.normal(self._copy, mean)

    @property
    def facet(self) -> Vector3f:
        """The unit normal of the triangle."""
        facet = dr.gather(self._geometry._mi.Vector3f, self._geometry._facets, self._triangle, self._active)
        return self._copies.facet(self._copy, facet)

    @property
    def handedness(self) -> Float:
        """-1 where the instance's matrix mirrors, else 1."""
        handedness = dr.gather(self._geometry._mi.Float, self._geometry._handedness, self._triangle, self._active)
        return self._copies.handedness(self._copy, handedness)

    @property
    def lift(self) -> Float:
        """The distance above the facet at which a ray starts, by `lookdev.scene.shading.LIFT`."""
        lift = dr.gather(self._geometry._mi.Float, self._geometry._lifts, self._triangle, self._active)
        return self._copies.lift(self._copy, lift)

    @property
    def first_uv(self) -> UV:
        """The coordinates in the first UV set of the mesh, 0 without one."""
        uv: UV = self._interpolate(self._geometry.first_uv(), self._geometry._corners, 2)
        return uv

    def attribute(self, binding: AttributeBinding) -> Any:
        """Return an attribute: one number, or a vector of two or three."""
        width = {"uv": 2, "float": 1}.get(binding.kind, 3)
        value = self._interpolate(self._geometry.attribute(binding), self._geometry._corners, width)
        return self._copies.vector(self._copy, value) if binding.attribute == TANGENT else value

    def _interpolate(self, values: Float, corners: UInt, width: int) -> Any:
        """Interpolate values over triangles. `corners` has the indices of the three values of each row."""
        mi = self._geometry._mi
        kinds: dict[int, type[AnyArray]] = {1: mi.Float, 2: mi.Vector2f, 3: mi.Vector3f}
        numbers = dr.gather(mi.Vector3u, corners, self._triangle, self._active)
        return sum(
            weight * dr.gather(kinds[width], values, number, self._active)
            for weight, number in zip(self._weights, numbers, strict=True)
        )


def _transform_points(points: Floats32, matrix: Floats) -> Floats:
    """Return points (n, 3) transformed by a matrix (4, 4) of column vectors."""
    return np.asarray(points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3])


def _unit(vectors: Floats) -> Floats:
    """Return vectors (..., 3) divided by their lengths."""
    return np.asarray(vectors / _lengths(vectors)[..., None])


def _lengths(vectors: Floats) -> Floats:
    """Return the lengths (...) of vectors (..., 3)."""
    # For vectors of three numbers, this takes a fifth of the time of `np.linalg.norm`.
    return np.asarray(np.sqrt(np.einsum("...i,...i", vectors, vectors)))
