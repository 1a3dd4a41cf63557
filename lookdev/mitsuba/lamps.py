"""Lamps of a rig on Dr.Jit's arrays: rows of numbers, and functions of each shape, traced from `lookdev.light`."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from lookdev.codegen.program.lamps import lamp_operations
from lookdev.light.lamps import FIELDS
from lookdev.mitsuba.programs import Place, Program

_NUMBERS = {name: number for number, name in enumerate(FIELDS)}


class Lamps:
    """The lamps of one kind: `rows` (n, fields) as `CodedRig.rows`. All places and vectors are of the rig's frame."""

    def __init__(self, mi: Any, kind: str, rows: NDArray[np.float32], *, shaped: bool, falling: bool) -> None:
        self._mi = mi
        self.count = len(rows)
        self._rows = mi.Float(np.ascontiguousarray(rows, np.float32).ravel())
        operations, outputs = lamp_operations(kind, shaped=shaped, falling=falling)
        self._program = Program(operations, outputs, mi.Float)

    def field(self, lamp: Any, name: str) -> Any:
        """Return a number of lamps, by their own numbers."""
        return dr.gather(self._mi.Float, self._rows, lamp * len(FIELDS) + _NUMBERS[name])

    def turns(self, lamp: Any) -> Any:
        """Return whether lamps turn with the rig."""
        return self.field(lamp, "turns") > 0.0

    def local(self, lamp: Any, place: Any) -> Any:
        """Return places in the frame of lamps."""
        return self.inside(lamp, place - self._vector(lamp, "x", "y", "z"))

    def inside(self, lamp: Any, v: Any) -> Any:
        """Return vectors by the axes of lamps."""
        return self._mi.Vector3f(*(dr.dot(v, self._axis(lamp, axis)) for axis in "xyz"))

    def outside(self, lamp: Any, v: Any) -> Any:
        """Return vectors by the axes of the rig, from those by the axes of lamps."""
        return v.x * self._axis(lamp, "x") + v.y * self._axis(lamp, "y") + v.z * self._axis(lamp, "z")

    def weight(self, lamp: Any, p: Any, n: Any) -> Any:
        """Return `lookdev.light.lamps.weight` times the mean radiance."""
        return self._called(lamp, "weight", p=p, n=n)[0]

    def meet(self, lamp: Any, p: Any, w: Any) -> tuple[Any, Any]:
        """Return the distance along directions, `FAR` where a lamp is missed, and the density of its samples."""
        distance, pdf = self._called(lamp, "meet", p=p, w=w)
        return distance, pdf

    def draw(self, lamp: Any, p: Any, u1: Any, u2: Any) -> tuple[Any, Any, Any]:
        """Draw directions to lamps; return them, distances and densities."""
        x, y, z, distance, pdf = self._called(lamp, "draw", p=p, u1=u1, u2=u2)
        return self._mi.Vector3f(x, y, z), distance, pdf

    def sent(self, lamp: Any, p: Any, w: Any) -> Any:
        """Return the radiance that lamps send to places along -w."""
        return self._mi.Color3f(*self._called(lamp, "sent", p=p, w=w))

    def _vector(self, lamp: Any, *names: str) -> Any:
        return self._mi.Vector3f(*(self.field(lamp, name) for name in names))

    def _axis(self, lamp: Any, axis: str) -> Any:
        return self._vector(lamp, *(f"{axis}{i}" for i in range(3)))

    def _called(self, lamp: Any, name: str, **given: Any) -> tuple[Any, ...]:
        def value(wanted: str) -> Any:
            vector, _, index = wanted.partition("[")
            if index:
                return given[vector][int(index[:-1])]
            return given[wanted] if wanted in given else self.field(lamp, wanted)

        return Place(self._program, value).values(name)
