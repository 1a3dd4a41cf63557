"""Lights of a rig on Dr.Jit's arrays: rows of numbers, and functions of them (`lookdev.codegen.program.lamps`)."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from lookdev.codegen.program.lamps import SHADOW_FIELDS, lamp_operations, shadow_operations
from lookdev.light.lamps import FIELDS, SHAPES, CodedRig
from lookdev.mitsuba.files import file_array, read_image
from lookdev.mitsuba.frozen import held
from lookdev.mitsuba.images import bilinear
from lookdev.mitsuba.programs import Place, Program
from lookdev.mitsuba.surface import Arriving

_NUMBERS = {name: number for number, name in enumerate((*FIELDS, "group"))}
_SPLIT = ("diffuse", "specular")


class Rows:
    """Lights of a rig: `rows` (n, fields + 1) as `CodedRig.rows`, and the numbers of their groups behind them.

    All places and vectors are of the rig's frame. `linked` (looks, n) are the looks that each
    lights, None: each lights all.
    """

    def __init__(self, mi: Any, rows: NDArray[np.float32], linked: NDArray[np.bool_] | None) -> None:
        self._mi = mi
        self.count = len(rows)
        self._rows = held(mi.Float, rows)
        self._linked = None if linked is None else held(mi.Float, linked)

    def field(self, lamp: Any, name: str) -> Any:
        """Return a number of lamps, by their own numbers."""
        return dr.gather(self._mi.Float, self._rows, lamp * len(_NUMBERS) + _NUMBERS[name])

    def turns(self, lamp: Any) -> Any:
        """Return whether lamps turn with the rig."""
        return self.field(lamp, "turns") > 0.0

    def linked(self, lamp: Any, look: Any) -> Any:
        """Return 1 where a look is lit by lamps, else 0."""
        if self._linked is None:
            return 1.0
        return dr.gather(self._mi.Float, self._linked, look * self.count + lamp)

    def local(self, lamp: Any, place: Any) -> Any:
        """Return places in the frame of lamps."""
        return self.inside(lamp, place - self._vector(lamp, "x", "y", "z"))

    def inside(self, lamp: Any, v: Any) -> Any:
        """Return vectors by the axes of lamps."""
        return self._mi.Vector3f(*(dr.dot(v, self._axis(lamp, axis)) for axis in "xyz"))

    def outside(self, lamp: Any, v: Any) -> Any:
        """Return vectors by the axes of the rig, from those by the axes of lamps."""
        return v.x * self._axis(lamp, "x") + v.y * self._axis(lamp, "y") + v.z * self._axis(lamp, "z")

    def color(self, lamp: Any) -> Any:
        """Return the radiance of lamps."""
        return self._mi.Color3f(self._vector(lamp, "red", "green", "blue"))

    def _vector(self, lamp: Any, *names: str) -> Any:
        return self._mi.Vector3f(*(self.field(lamp, name) for name in names))

    def _axis(self, lamp: Any, axis: str) -> Any:
        return self._vector(lamp, *(f"{axis}{i}" for i in range(3)))

    def called(self, program: Program, lamp: Any, name: str, **given: Any) -> tuple[Any, ...]:
        """Return an output of a program whose symbols are the fields of lamps, and what is given besides."""

        def value(wanted: str) -> Any:
            vector, _, index = wanted.partition("[")
            if index:
                return given[vector][int(index[:-1])]
            return given[wanted] if wanted in given else self.field(lamp, wanted)

        return Place(program, value).values(name)


class Lamps(Rows):
    """The lamps of one kind of a rig; those with a texture are each a kind of their own."""

    def __init__(
        self, mi: Any, rig: CodedRig, kind: str, rows: NDArray[np.float32], linked: NDArray[np.bool_] | None
    ) -> None:
        super().__init__(mi, rows, linked)
        shapings = [each.shaping for each in rig.emissions if each.shaping]
        steps = max((each.profile.steps for each in shapings if each.profile), default=0)
        operations, outputs = lamp_operations(kind, shaped=rig.shaped, falling=rig.falling, steps=steps)
        self._program = Program(operations, outputs, mi.Float, (), [held(mi.Float, rig.tables())])
        self._image = None
        if kind == "picture":
            (light,) = (each for each in rig.pictures if rig.pictures.index(each) == rows[0, _NUMBERS["picture"]])
            assert light.texture, "it is a picture"
            self._image = file_array(mi.Float, light.texture, read_image)

    def weight(self, lamp: Any, p: Any, n: Any) -> Any:
        """Return `lookdev.light.lamps.weight` times the mean radiance."""
        return self.called(self._program, lamp, "weight", p=p, n=n)[0]

    def meet(self, lamp: Any, p: Any, w: Any) -> tuple[Any, Any]:
        """Return the distance along directions, `FAR` where a lamp is missed, and the density of its samples."""
        distance, pdf = self.called(self._program, lamp, "meet", p=p, w=w)
        return distance, pdf

    def draw(self, lamp: Any, p: Any, u1: Any, u2: Any) -> tuple[Any, Any, Any]:
        """Draw directions to lamps; return them, distances and densities."""
        x, y, z, distance, pdf = self.called(self._program, lamp, "draw", p=p, u1=u1, u2=u2)
        return self._mi.Vector3f(x, y, z), distance, pdf

    def sent(self, lamp: Any, p: Any, w: Any) -> Any:
        """Return the radiance that lamps send to places along -w, which meets them."""
        sent = self._mi.Color3f(*self.called(self._program, lamp, "sent", p=p, w=w))
        if self._image is not None:
            s, t = self.called(self._program, lamp, "place", p=p, w=w)
            # As a place sees it, x is to the left.
            texel = bilinear(self._mi, self._image, 1.0 - s, t, "clamp", "clamp", self._mi.Bool(True))
            sent *= self._mi.Color3f(texel.x, texel.y, texel.z)
        return sent


def kinds_of(mi: Any, rig: CodedRig, rows: NDArray[np.float32], linked: NDArray[np.bool_] | None) -> list[Lamps]:
    """Return the lamps of a rig by kinds, from their rows and links, in the rig's order."""
    found = []
    for kind in rig.kinds:
        of_kind = np.flatnonzero(rows[:, 0] == list(SHAPES).index(kind))
        found += [(kind, each) for each in (np.split(of_kind, len(of_kind)) if kind == "picture" else [of_kind])]
    return [Lamps(mi, rig, kind, rows[n], None if linked is None else linked[:, n]) for kind, n in found]


class Controls:
    """What lights let through: shadows of parts, of a colour or an end, and factors of diffuse and specular light.

    The light of the first `groups` of lights is kept apart.
    """

    def __init__(self, mi: Any, rig: CodedRig, groups: int) -> None:
        self._mi = mi
        self.groups = groups
        self.spared = rig.spared or ((),)
        self.shadowed, self.split = rig.shadowed, rig.split
        self._names = (*["spares"] * bool(rig.spared), *(SHADOW_FIELDS * rig.shadowed), *(_SPLIT * rig.split))
        self._names += ("group",) * bool(groups)
        operations, outputs = shadow_operations()
        self._program = Program(operations, outputs, mi.Float)

    def none(self) -> tuple[Any, ...]:
        """Return numbers of no light."""
        return tuple(self._mi.Float(0.0) for _ in self._names)

    def of(self, rows: Rows, lamp: Any) -> tuple[Any, ...]:
        """Return the numbers of lamps that `let` takes."""
        return tuple(rows.field(lamp, name) for name in self._names)

    def by_group(self, controls: tuple[Any, ...], arriving: Arriving) -> list[Arriving]:
        """Return light, and what of it is of each group that is kept apart."""
        specular, diffuse = arriving
        of_each = [controls[-1] == number for number in range(self.groups)]
        return [arriving, *((dr.select(here, specular, 0.0), dr.select(here, diffuse, 0.0)) for here in of_each)]

    def spares(self, controls: tuple[Any, ...], which: int) -> Any:
        """Return whether lights spare a set of parts, by its number in `spared`."""
        return controls[0] == which if len(self.spared) > 1 else self._mi.Bool(True)

    def let(
        self, controls: tuple[Any, ...], distance: Any, occluders: list[Any], straight: bool = False
    ) -> tuple[Any, Any]:
        """Return the shares that reach specular and diffuse lobes; `straight`: the light is not reflected.

        The distance is that of the light; occluders are by the sets of parts that they spare.
        """
        mi = self._mi
        named = dict(zip(self._names, controls, strict=True))
        occluder = occluders[0]
        for which in range(1, len(self.spared)):
            occluder = dr.select(named["spares"] == which, occluders[which], occluder)
        occluded = distance > occluder
        passed = mi.Color3f(0.0)
        if self.shadowed:

            def value(name: str) -> Any:
                return dr.select(occluded, occluder, 0.0) if name == "distance" else named[name]

            passed = mi.Color3f(*Place(self._program, value).values("passed"))
        share = dr.select(occluded, passed, mi.Color3f(1.0))
        if straight or not self.split:
            return share, share
        return share * named["specular"], share * named["diffuse"]
