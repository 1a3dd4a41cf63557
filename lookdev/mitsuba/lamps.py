"""The lamps of a rig on Dr.Jit's arrays: a table of numbers, and programs that compute with them.

A lamp is any light that is not a dome. Each light, domes included, has a row in the table. `FIELDS` has the names of
the columns. `lookdev.codegen.program.lamps` generates the programs.
"""

from __future__ import annotations

import drjit as dr
import numpy as np

from lookdev.arrays import Bools, Floats32
from lookdev.codegen.program.lamps import lamp_operations
from lookdev.light.lamps import FIELDS, SHAPES, CodedRig
from lookdev.mitsuba.files import file_array, read_image
from lookdev.mitsuba.frozen import device_array
from lookdev.mitsuba.images import bilinear
from lookdev.mitsuba.programs import Evaluation, Program
from lookdev.mitsuba.types import AnyArray, Bool, Color3f, Float, Mitsuba, UInt, Vector3f

_FIELD_NUMBERS = {name: number for number, name in enumerate((*FIELDS, "group"))}


class LampRows:
    """The table of some lights of a rig. In the methods, `lamp` has the numbers of lights in this table.

    Points and vectors are in the rig's frame, unless stated otherwise.

    Parameters
    ----------
    rows : (n, fields + 1)
        A row for each light as in `CodedRig.rows`, with the number of the light's group appended.
    links : (looks, n)
        Whether each light reaches each look. None means that all lights reach all looks.
    """

    def __init__(self, mi: Mitsuba, rows: Floats32, links: Bools | None) -> None:
        self._mi = mi
        self.count = len(rows)
        self._rows = device_array(mi.Float, rows)
        self._links = None if links is None else device_array(mi.Float, links)

    def field(self, lamp: UInt, name: str) -> Float:
        """Return the values of a field of lamps."""
        return dr.gather(self._mi.Float, self._rows, lamp * len(_FIELD_NUMBERS) + _FIELD_NUMBERS[name])

    def turns(self, lamp: UInt) -> Bool:
        """Return whether lamps turn with the rig."""
        return self.field(lamp, "turns") > 0.0

    def link_of(self, lamp: UInt, look: UInt) -> Float | float:
        """Return 1 where lamps reach a look, given by its number, else 0."""
        if self._links is None:
            return 1.0
        return dr.gather(self._mi.Float, self._links, look * self.count + lamp)

    def to_local_point(self, lamp: UInt, point: Vector3f) -> Vector3f:
        """Return points in the frames of lamps, from points in the rig's frame."""
        return self.to_local(lamp, point - self._vector(lamp, "x", "y", "z"))

    def to_local(self, lamp: UInt, v: Vector3f) -> Vector3f:
        """Return vectors in the axes of lamps, from vectors in the axes of the rig."""
        return self._mi.Vector3f(*(dr.dot(v, self._axis(lamp, axis)) for axis in "xyz"))

    def to_rig(self, lamp: UInt, v: Vector3f) -> Vector3f:
        """Return vectors in the axes of the rig, from vectors in the axes of lamps."""
        return v.x * self._axis(lamp, "x") + v.y * self._axis(lamp, "y") + v.z * self._axis(lamp, "z")

    def color(self, lamp: UInt) -> Color3f:
        """Return the radiance of lamps."""
        return self._mi.Color3f(self._vector(lamp, "red", "green", "blue"))

    def _vector(self, lamp: UInt, *names: str) -> Vector3f:
        """Return three fields of lamps as vectors."""
        return self._mi.Vector3f(*(self.field(lamp, name) for name in names))

    def _axis(self, lamp: UInt, axis: str) -> Vector3f:
        """Return an axis, ``"x"``, ``"y"`` or ``"z"``, of lamps."""
        return self._vector(lamp, *(f"{axis}{i}" for i in range(3)))

    def evaluate(self, program: Program, lamp: UInt, name: str, **inputs: Float | Vector3f) -> tuple[Float, ...]:
        """Return output `name` of a program. Its symbols are fields of lamps, or `inputs`, by name."""

        def value(symbol: str) -> AnyArray | float:
            """Return the value of a symbol; a component of a vector is named like ``p[0]``."""
            vector, _, index = symbol.partition("[")
            if index:
                return inputs[vector][int(index[:-1])]
            return inputs[symbol] if symbol in inputs else self.field(lamp, symbol)

        return Evaluation(program, value).values(name)


class Lamps(LampRows):
    """The lamps of one kind in a rig, such as all discs. A lamp with a texture, of kind "picture", is alone.

    In the methods, p is a point, n a unit normal and w a direction, in the frames of the lamps.
    """

    def __init__(self, mi: Mitsuba, rig: CodedRig, kind: str, rows: Floats32, links: Bools | None) -> None:
        super().__init__(mi, rows, links)
        shapings = [emission.shaping for emission in rig.emissions if emission.shaping]
        steps = max((shaping.profile.steps for shaping in shapings if shaping.profile), default=0)
        shaped, falling = rig.needs("shaped"), rig.needs("falling")
        operations, outputs = lamp_operations(kind, shaped=shaped, falling=falling, steps=steps)
        self._program = Program(operations, outputs, mi.Float, (), [device_array(mi.Float, rig.tables())])
        self._image = None
        if kind == "picture":
            (light,) = (lamp for lamp in rig.pictures if rig.pictures.index(lamp) == rows[0, _FIELD_NUMBERS["picture"]])
            assert light.texture, "a picture has a texture"
            self._image = file_array(mi.Float, light.texture, read_image)

    def weight(self, lamp: UInt, p: Vector3f, n: Vector3f) -> Float:
        """Return `lookdev.light.lamps.estimate_irradiance` times the mean radiance."""
        return self.evaluate(self._program, lamp, "weight", p=p, n=n)[0]

    def intersect(self, lamp: UInt, p: Vector3f, w: Vector3f) -> tuple[Float, Float]:
        """Return the distances of lamps along directions, and the pdfs with which `draw` draws these directions.

        The distance is `FAR` where a direction misses the lamp.
        """
        distance, pdf = self.evaluate(self._program, lamp, "meet", p=p, w=w)
        return distance, pdf

    def draw(self, lamp: UInt, p: Vector3f, u1: Float, u2: Float) -> tuple[Vector3f, Float, Float]:
        """Return directions to lamps, sampled by two uniform numbers, the distances of the lamps, and the pdfs."""
        x, y, z, distance, pdf = self.evaluate(self._program, lamp, "draw", p=p, u1=u1, u2=u2)
        return self._mi.Vector3f(x, y, z), distance, pdf

    def radiance(self, lamp: UInt, p: Vector3f, w: Vector3f) -> Color3f:
        """Return the radiance that arrives at points from directions w, which must hit the lamps."""
        radiance = self._mi.Color3f(*self.evaluate(self._program, lamp, "sent", p=p, w=w))
        if self._image is not None:
            s, t = self.evaluate(self._program, lamp, "place", p=p, w=w)
            # Seen from the point, the x axis of the lamp points to the left.
            texel = bilinear(self._mi, self._image, 1.0 - s, t, "clamp", "clamp", self._mi.Bool(True))
            radiance *= self._mi.Color3f(texel.x, texel.y, texel.z)
        return radiance


def lamps_by_kind(mi: Mitsuba, rig: CodedRig, rows: Floats32, links: Bools | None) -> list[Lamps]:
    """Return the lamps of a rig by kind: `rows` and `links` have the rows and links of all lamps in the rig's order."""
    kinds = []
    for kind in rig.kinds:
        of_kind = np.flatnonzero(rows[:, 0] == list(SHAPES).index(kind))
        kinds += [(kind, lamps) for lamps in (np.split(of_kind, len(of_kind)) if kind == "picture" else [of_kind])]
    return [Lamps(mi, rig, kind, rows[n], None if links is None else links[:, n]) for kind, n in kinds]
