"""Lights of a rig on Dr.Jit's arrays: rows of numbers, and programs on them (`lookdev.codegen.program.lamps`)."""

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
    """Lights of a rig: `rows` (n, fields + 1) as in `CodedRig.rows`, with the numbers of the lights' groups appended.

    All points and vectors are in the rig's frame. `links` (looks, n) says which looks each light reaches; None means
    all.
    """

    def __init__(self, mi: Mitsuba, rows: Floats32, links: Bools | None) -> None:
        self._mi = mi
        self.count = len(rows)
        self._rows = device_array(mi.Float, rows)
        self._links = None if links is None else device_array(mi.Float, links)

    def field(self, lamp: UInt, name: str) -> Float:
        """Return a field of lamps, by their numbers."""
        return dr.gather(self._mi.Float, self._rows, lamp * len(_FIELD_NUMBERS) + _FIELD_NUMBERS[name])

    def turns(self, lamp: UInt) -> Bool:
        """Return where lamps turn with the rig."""
        return self.field(lamp, "turns") > 0.0

    def link_of(self, lamp: UInt, look: UInt) -> Float | float:
        """Return 1 where lamps reach a look, else 0."""
        if self._links is None:
            return 1.0
        return dr.gather(self._mi.Float, self._links, look * self.count + lamp)

    def to_local_point(self, lamp: UInt, point: Vector3f) -> Vector3f:
        """Return points in the frame of lamps."""
        return self.to_local(lamp, point - self._vector(lamp, "x", "y", "z"))

    def to_local(self, lamp: UInt, v: Vector3f) -> Vector3f:
        """Return vectors in the axes of lamps."""
        return self._mi.Vector3f(*(dr.dot(v, self._axis(lamp, axis)) for axis in "xyz"))

    def to_rig(self, lamp: UInt, v: Vector3f) -> Vector3f:
        """Return vectors in the axes of the rig, from vectors in the axes of lamps."""
        return v.x * self._axis(lamp, "x") + v.y * self._axis(lamp, "y") + v.z * self._axis(lamp, "z")

    def color(self, lamp: UInt) -> Color3f:
        """Return the radiance of lamps."""
        return self._mi.Color3f(self._vector(lamp, "red", "green", "blue"))

    def _vector(self, lamp: UInt, *names: str) -> Vector3f:
        return self._mi.Vector3f(*(self.field(lamp, name) for name in names))

    def _axis(self, lamp: UInt, axis: str) -> Vector3f:
        return self._vector(lamp, *(f"{axis}{i}" for i in range(3)))

    def evaluate(self, program: Program, lamp: UInt, name: str, **inputs: Float | Vector3f) -> tuple[Float, ...]:
        """Return an output of a program whose symbols are fields of lamps and the `inputs`."""

        def value(symbol: str) -> AnyArray | float:
            vector, _, index = symbol.partition("[")
            if index:
                return inputs[vector][int(index[:-1])]
            return inputs[symbol] if symbol in inputs else self.field(lamp, symbol)

        return Evaluation(program, value).values(name)


class Lamps(LampRows):
    """The lamps of one kind in a rig; each lamp with a texture is a kind of its own."""

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
        """Return the distance along directions, `FAR` where they miss the lamp, and the density of its samples."""
        distance, pdf = self.evaluate(self._program, lamp, "meet", p=p, w=w)
        return distance, pdf

    def draw(self, lamp: UInt, p: Vector3f, u1: Float, u2: Float) -> tuple[Vector3f, Float, Float]:
        """Return sampled directions to lamps, distances and densities."""
        x, y, z, distance, pdf = self.evaluate(self._program, lamp, "draw", p=p, u1=u1, u2=u2)
        return self._mi.Vector3f(x, y, z), distance, pdf

    def radiance(self, lamp: UInt, p: Vector3f, w: Vector3f) -> Color3f:
        """Return the radiance that lamps send to points along -w; w has to hit them."""
        radiance = self._mi.Color3f(*self.evaluate(self._program, lamp, "sent", p=p, w=w))
        if self._image is not None:
            s, t = self.evaluate(self._program, lamp, "place", p=p, w=w)
            # Seen from the point, x of the lamp is to the left.
            texel = bilinear(self._mi, self._image, 1.0 - s, t, "clamp", "clamp", self._mi.Bool(True))
            radiance *= self._mi.Color3f(texel.x, texel.y, texel.z)
        return radiance


def lamps_by_kind(mi: Mitsuba, rig: CodedRig, rows: Floats32, links: Bools | None) -> list[Lamps]:
    """Return the lamps of a rig by kind, from their rows and links, in the rig's order."""
    kinds = []
    for kind in rig.kinds:
        of_kind = np.flatnonzero(rows[:, 0] == list(SHAPES).index(kind))
        kinds += [(kind, lamps) for lamps in (np.split(of_kind, len(of_kind)) if kind == "picture" else [of_kind])]
    return [Lamps(mi, rig, kind, rows[n], None if links is None else links[:, n]) for kind, n in kinds]
