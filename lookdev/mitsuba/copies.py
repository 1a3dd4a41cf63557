"""Instances: a mesh that is placed several times is there once, as a group of Mitsuba's that instances show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from lookdev.asset import Asset
from lookdev.mitsuba.frozen import held
from lookdev.scene.shading import LIFT

Floats = NDArray[np.float64]

_LAST = (1 << 32) - 1


class Body(NamedTuple):
    """A mesh as it is made, and the numbers of its instances: placed if it has one, else about its own middle."""

    mesh: int
    matrix: Floats  # (4, 4), from the mesh to the body
    instances: tuple[int, ...]


def bodies_of(asset: Asset, center: Floats) -> list[Body]:
    """Return the bodies of an asset about a centre, those that are placed once first."""
    instances: dict[int, list[int]] = {}
    for number, each in enumerate(asset.instances):
        instances.setdefault(each.mesh, []).append(number)
    placed, copied = [], []
    for number, each in enumerate(asset.instances):
        if len(instances[each.mesh]) == 1:
            placed.append(Body(each.mesh, _moved(-center) @ each.matrix, (number,)))
    for mesh, numbers in instances.items():
        if len(numbers) > 1:
            copied.append(Body(mesh, _moved(-_middle(asset, mesh)), tuple(numbers)))
    return [*placed, *copied]


def _middle(asset: Asset, mesh: int) -> Floats:
    points = asset.meshes[mesh].points.astype(np.float64)
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0))) if len(points) else np.zeros(3)


def _moved(by: Floats) -> Floats:
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return matrix


class Copies:
    """The instances of bodies that have several, in a variant's arrays: where each is, and its triangles' numbers.

    Copy 0 are all bodies that are placed once, which stay where they are. `matrices` are by the numbers of instances.
    """

    def __init__(self, mi: Any, bodies: int, matrices: Mapping[int, Floats], first: Sequence[int], row: Sequence[int]):
        self._mi, self.bodies, self.matrices = mi, bodies, matrices
        self._firsts = list(first)
        self._count = len(first)
        if not bodies:
            return
        every = np.array([np.eye(4), *matrices.values()])
        linear = every[:, :3, :3]
        self._next, self._shift = held(mi.UInt32, [*first[1:], _LAST]), held(mi.UInt32, np.subtract(first, row))
        self._numbers = held(mi.UInt32, [0, *matrices])
        self._linear, self._across = held(mi.Float, linear), held(mi.Float, np.linalg.inv(linear).swapaxes(1, 2))
        self._offset, self._hands = held(mi.Float, every[:, :3, 3]), held(mi.Float, np.sign(np.linalg.det(linear)))
        # As far as the corners of a triangle can be from the centre.
        self._scales = held(mi.Float, np.linalg.norm(linear, ord=2, axis=(1, 2)))
        self._away = held(mi.Float, LIFT * np.linalg.norm(every[:, :3, 3], axis=-1))

    @classmethod
    def of(cls, mi: Any, bodies: Sequence[Body], of_row: NDArray[Any], asset: Asset, center: Floats) -> Copies:
        """Of bodies, by the number of each row's body."""
        sizes = np.bincount(of_row, minlength=len(bodies))
        rows = np.cumsum([0, *sizes])
        first, row, matrices = [0], [0], {}
        copied = [number for number, body in enumerate(bodies) if len(body.instances) > 1]
        end = int(rows[copied[0]]) if copied else 0
        for number in copied:
            for each in bodies[number].instances:
                placed = _moved(-center) @ asset.instances[each].matrix @ np.linalg.inv(bodies[number].matrix)
                matrices[each] = placed
                first.append(end)
                row.append(int(rows[number]))
                end += int(sizes[number])
        return cls(mi, len(copied), matrices, first, row)

    def find(self, shapes: Mapping[str, Any]) -> None:
        """Note the numbers by which Dr.Jit knows the instances among the shapes of a scene."""
        if self.bodies:
            known = [self._known(shapes.get(f"instance{each}")) for each in self.matrices]
            firsts = np.zeros(max(known) + 1, np.uint32)
            firsts[known] = self._firsts[1:]
            self._first_of = held(self._mi.UInt32, firsts)

    def _known(self, instance: Any) -> int:
        if instance is None:  # of a mesh without an area
            return 0
        return int(np.asarray(dr.reinterpret_array(self._mi.UInt32, self._mi.ShapePtr(instance)))[0])

    def met(self, found: Any) -> Any:
        """Return the triangles of what rays have met."""
        if not self.bodies:
            return found.prim_index
        known: Any = dr.reinterpret_array(self._mi.UInt32, found.instance)  # 0: none
        return found.prim_index + dr.gather(self._mi.UInt32, self._first_of, known, found.is_valid())

    def number(self, triangle: Any) -> Any:
        """Return the numbers of the copies that have triangles; None: all are where they stay."""
        if not self.bodies:
            return None

        def behind(number: Any) -> Any:
            return dr.gather(self._mi.UInt32, self._next, number) <= triangle

        return dr.binary_search(0, self._count - 1, behind)  # type: ignore[no-untyped-call]

    def row(self, triangle: Any, copy: Any = None) -> Any:
        """Return the rows of triangles."""
        if not self.bodies:
            return triangle
        copy = self.number(triangle) if copy is None else copy
        return triangle - dr.gather(self._mi.UInt32, self._shift, copy)

    def instance(self, triangle: Any, alone: Any) -> Any:
        """Return the instances of triangles, which is `alone` where it stays."""
        if not self.bodies:
            return alone
        copy = self.number(triangle)
        return dr.select(copy == 0, alone, dr.gather(self._mi.UInt32, self._numbers, copy))

    def point(self, copy: Any, p: Any) -> Any:
        """Return points of copies where they are."""
        if copy is None:
            return p
        return self._turned(self._linear, copy, p) + dr.gather(self._mi.Vector3f, self._offset, copy)

    def vector(self, copy: Any, v: Any) -> Any:
        """Return vectors of copies along their surface."""
        return v if copy is None else self._turned(self._linear, copy, v)

    def normal(self, copy: Any, n: Any) -> Any:
        """Return unit normals of copies."""
        return n if copy is None else dr.normalize(self._turned(self._across, copy, n))

    def facet(self, copy: Any, n: Any) -> Any:
        """Return unit normals of facets, which are those of their corners' order."""
        return n if copy is None else self.normal(copy, n) * dr.gather(self._mi.Float, self._hands, copy)

    def hand(self, copy: Any, hand: Any) -> Any:
        """Return whether copies are mirrored, -1, or not."""
        return hand if copy is None else hand * dr.gather(self._mi.Float, self._hands, copy)

    def lift(self, copy: Any, lift: Any) -> Any:
        """Return how far above a facet a ray leaves."""
        if copy is None:
            return lift
        return dr.gather(self._mi.Float, self._scales, copy) * lift + dr.gather(self._mi.Float, self._away, copy)

    def _turned(self, matrices: Any, copy: Any, v: Any) -> Any:
        mi = self._mi
        rows = [dr.gather(mi.Vector3f, matrices, 3 * copy + i) for i in range(3)]
        return mi.Vector3f(*(dr.dot(row, v) for row in rows))
