"""Instances of meshes: a mesh with several instances is stored once, as a shape group of Mitsuba.

`lookdev.mitsuba.geometry` numbers all triangles of all instances consecutively. The classes here map the number of a
triangle to its instance, and to the row of tables that has the data of the triangle. All instances of a mesh share the
rows of the mesh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, cast

import drjit as dr
import numpy as np

from lookdev.arrays import Floats, Indices
from lookdev.asset import Asset
from lookdev.mitsuba.frozen import device_array
from lookdev.mitsuba.types import Bool, Float, Intersection, Mitsuba, UInt, Vector3f
from lookdev.scene.shading import LIFT

_LAST = (1 << 32) - 1  # the largest number of a triangle


class Body(NamedTuple):
    """A mesh as it is stored in Mitsuba's scene, and its instances.

    A mesh with a single instance is stored in world space, relative to the asset's centre. A mesh with several
    instances is stored in its own space, relative to its own centre.
    """

    mesh: int  # an index into `Asset.meshes`
    matrix: Floats  # (4, 4), from the space of the mesh to the space in which it is stored
    instances: tuple[int, ...]  # indices into `Asset.instances`


def bodies_of(asset: Asset, center: Floats) -> list[Body]:
    """Return the bodies of an asset, relative to a centre (3,); bodies with a single instance come first."""
    instances: dict[int, list[int]] = {}
    for number, instance in enumerate(asset.instances):
        instances.setdefault(instance.mesh, []).append(number)
    placed, copied = [], []
    for number, instance in enumerate(asset.instances):
        if len(instances[instance.mesh]) == 1:
            placed.append(Body(instance.mesh, _translation(-center) @ instance.matrix, (number,)))
    for mesh, numbers in instances.items():
        if len(numbers) > 1:
            copied.append(Body(mesh, _translation(-_bounds_center(asset, mesh)), tuple(numbers)))
    return [*placed, *copied]


def _bounds_center(asset: Asset, mesh: int) -> Floats:
    """Return the centre of a mesh's bounding box, (3,)."""
    points = asset.meshes[mesh].points.astype(np.float64)
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0))) if len(points) else np.zeros(3)


def _translation(offset: Floats) -> Floats:
    """Return the matrix (4, 4) of a translation."""
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


class Copies:
    """The copies of bodies, in a variant's arrays.

    A copy is an instance of a body that has several instances. All bodies with a single instance together are copy 0,
    which is not transformed. The triangles of a copy have consecutive numbers. In the methods, a `copy` of None means
    that no body has several instances.

    Parameters
    ----------
    bodies
        The number of bodies with several instances.
    matrices
        The matrix (4, 4) of each copy except copy 0, from the space of the body to world space relative to the asset's
        centre. The keys are the numbers of the instances.
    first, row
        The number of the first triangle of each copy, copy 0 included, and the row of that triangle.
    """

    def __init__(self, mi: Mitsuba, bodies: int, matrices: Mapping[int, Floats], first: list[int], row: list[int]):
        self._mi, self.bodies, self.matrices = mi, bodies, matrices
        self._firsts = list(first)
        self._count = len(first)
        if not bodies:
            return
        # The following arrays have an entry for each copy.
        transforms = np.array([np.eye(4), *matrices.values()])
        linear = transforms[:, :3, :3]
        self._next_firsts = device_array(mi.UInt32, [*first[1:], _LAST])  # the first triangle of the next copy
        self._row_shifts = device_array(mi.UInt32, np.subtract(first, row))  # the number of a triangle minus its row
        self._instance_numbers = device_array(mi.UInt32, [0, *matrices])
        self._linear_parts = device_array(mi.Float, linear)
        self._inverse_transposes = device_array(mi.Float, np.linalg.inv(linear).swapaxes(1, 2))
        self._offsets = device_array(mi.Float, transforms[:, :3, 3])
        self._handedness = device_array(mi.Float, np.sign(np.linalg.det(linear)))
        # A lift is the distance above a facet at which a ray starts. It scales with the copy, and increases with the
        # distance of the copy from the centre.
        self._lift_scales = device_array(mi.Float, np.linalg.norm(linear, ord=2, axis=(1, 2)))
        self._lift_offsets = device_array(mi.Float, LIFT * np.linalg.norm(transforms[:, :3, 3], axis=-1))

    @classmethod
    def from_bodies(
        cls, mi: Mitsuba, bodies: Sequence[Body], body_of_row: Indices, asset: Asset, center: Floats
    ) -> Copies:
        """Return the copies of bodies; `body_of_row` (rows,) has the number of the body of each row."""
        sizes = np.bincount(body_of_row, minlength=len(bodies))
        rows = np.cumsum([0, *sizes])
        first, row, matrices = [0], [0], {}
        copied = [number for number, body in enumerate(bodies) if len(body.instances) > 1]
        end = int(rows[copied[0]]) if copied else 0
        for number in copied:
            for instance in bodies[number].instances:
                to_world = (
                    _translation(-center) @ asset.instances[instance].matrix @ np.linalg.inv(bodies[number].matrix)
                )
                matrices[instance] = to_world
                first.append(end)
                row.append(int(rows[number]))
                end += int(sizes[number])
        return cls(mi, len(copied), matrices, first, row)

    def find_instances(self, shapes: Mapping[str, object]) -> None:
        """Record the numbers that Dr.Jit's registry gives to the instances in a scene, for `triangle_of`.

        `shapes` has the shapes of the scene by name; the shape of instance 7 is named ``instance7``.
        """
        if self.bodies:
            indices = [self._registry_index(shapes.get(f"instance{number}")) for number in self.matrices]
            firsts = np.zeros(max(indices) + 1, np.uint32)
            firsts[indices] = self._firsts[1:]
            self._first_of = device_array(self._mi.UInt32, firsts)  # the first triangle, by number in the registry

    def _registry_index(self, instance: object) -> int:
        """Return the number of an instance's shape in Dr.Jit's registry, 0 if there is none."""
        if instance is None:  # its mesh has no area
            return 0
        return int(np.asarray(dr.reinterpret_array(self._mi.UInt32, self._mi.ShapePtr(instance)))[0])

    def triangle_of(self, intersection: Intersection) -> UInt:
        """Return the numbers of the triangles that rays have hit."""
        if not self.bodies:
            return intersection.prim_index
        # The number of the instance in Dr.Jit's registry, or 0 if the hit mesh is not an instance.
        index = cast("UInt", dr.reinterpret_array(self._mi.UInt32, intersection.instance))
        return intersection.prim_index + dr.gather(self._mi.UInt32, self._first_of, index, intersection.is_valid())

    def copy_of(self, triangle: UInt) -> UInt | None:
        """Return the copies that have triangles, or None if no body has several instances."""
        return self._find_copies(triangle) if self.bodies else None

    def _find_copies(self, triangle: UInt) -> UInt:
        """Return the copies that have triangles, by binary search among the first triangles of copies."""

        def starts_before(number: UInt) -> Bool:
            return dr.gather(self._mi.UInt32, self._next_firsts, number) <= triangle

        copy: UInt = dr.binary_search(0, self._count - 1, starts_before)  # type: ignore[no-untyped-call]
        return copy

    def row(self, triangle: UInt, copy: UInt | None = None) -> UInt:
        """Return the rows of triangles; `copy` saves the search for their copies."""
        if not self.bodies:
            return triangle
        copy = self._find_copies(triangle) if copy is None else copy
        return triangle - dr.gather(self._mi.UInt32, self._row_shifts, copy)

    def instance(self, triangle: UInt, single: UInt) -> UInt:
        """Return the numbers of the instances that have triangles; for triangles of copy 0, return `single`."""
        if not self.bodies:
            return single
        copy = self._find_copies(triangle)
        return dr.select(copy == 0, single, dr.gather(self._mi.UInt32, self._instance_numbers, copy))

    def point(self, copy: UInt | None, p: Vector3f) -> Vector3f:
        """Return points in world space, from points in the spaces of copies."""
        if copy is None:
            return p
        return self._multiply(self._linear_parts, copy, p) + dr.gather(self._mi.Vector3f, self._offsets, copy)

    def vector(self, copy: UInt | None, v: Vector3f) -> Vector3f:
        """Return tangential vectors in world space, from vectors in the spaces of copies."""
        return v if copy is None else self._multiply(self._linear_parts, copy, v)

    def normal(self, copy: UInt | None, n: Vector3f) -> Vector3f:
        """Return unit normals in world space, from normals in the spaces of copies."""
        return n if copy is None else dr.normalize(self._multiply(self._inverse_transposes, copy, n))

    def facet(self, copy: UInt | None, n: Vector3f) -> Vector3f:
        """Return unit normals of facets in world space, from normals of facets in the spaces of copies.

        The order of the corners determines the side of a facet's normal, so a mirrored copy has the opposite side.
        """
        return n if copy is None else self.normal(copy, n) * dr.gather(self._mi.Float, self._handedness, copy)

    def handedness(self, copy: UInt | None, handedness: Float) -> Float:
        """Return the handedness of frames, 1 or -1, negated where the matrices of copies mirror."""
        return handedness if copy is None else handedness * dr.gather(self._mi.Float, self._handedness, copy)

    def lift(self, copy: UInt | None, lift: Float) -> Float:
        """Return the distances above facets at which rays start, from such distances in the spaces of copies."""
        if copy is None:
            return lift
        return dr.gather(self._mi.Float, self._lift_scales, copy) * lift + dr.gather(
            self._mi.Float, self._lift_offsets, copy
        )

    def _multiply(self, matrices: Float, copy: UInt, v: Vector3f) -> Vector3f:
        """Return vectors multiplied by the matrices (3, 3) of their copies."""
        mi = self._mi
        rows = [dr.gather(mi.Vector3f, matrices, 3 * copy + i) for i in range(3)]
        return mi.Vector3f(*(dr.dot(row, v) for row in rows))
