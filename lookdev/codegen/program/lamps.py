"""Trace the functions of lights in `lookdev.light`, for OSL, GLSL and Mitsuba, which sample the same lights.

In the traced code, the numbers of a light are symbols: the fields of the light's row (`lookdev.light.lamps.FIELDS`).
The code is thus the same for all lights of a kind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from typing import ParamSpec, TypeAlias, cast

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.table import NumberTable
from lookdev.codegen.program.writer import ProgramWriter
from lookdev.codegen.source import ProgramOperation
from lookdev.codegen.trace.graph import Graph, Scalar
from lookdev.codegen.trace.symbolic import elements_of, symbols
from lookdev.light import spherical_rectangle as spherical
from lookdev.light.dome.local import directions_to_ball, exit_ball, fade_factor
from lookdev.light.emission import DEGREES, azimuth, cone_factor, falloff_factor, focus_factor, off_axis, shadow_factor
from lookdev.light.ies import profile_factor
from lookdev.light.lamps import SHAPES, estimate_irradiance
from lookdev.light.picture import CELL_SEGMENTS
from lookdev.light.rect import TexturedRectangle

BEAM, TINT = ("cone", "start", "rise", "focus"), ("tint0", "tint1", "tint2")
"""The fields of a lamp's row that `cone_factor` and `focus_factor` of `lookdev.light.emission` read."""

FALLOFF = ("virtual", "power", "fade", "fade_rise")
"""The fields of a lamp's row that `falloff_factor` of `lookdev.light.emission` reads."""

SHADOW_FIELDS = ("shadow", "limit", "zone", "gamma", "shadow0", "shadow1", "shadow2")
"""The fields of a lamp's row that `shadow_factor` of `lookdev.light.emission` reads."""

FunctionOperations = tuple[list[ProgramOperation], Mapping[str, tuple[int, ...]]]
"""The operations of several functions; then the indices of the operations that have a function's results, by name."""

TracedFunctions: TypeAlias = Mapping[str, Callable[[], list[Scalar]]]
"""Callables by a function's name: each traces the function, and returns its results as scalars."""

_TABLES = NumberTable(np.zeros((1, 1)))
"""A placeholder for the rig's tables, whose numbers are known only when a program runs."""

_Arguments = ParamSpec("_Arguments")


class LampSymbols:
    """Makes the symbols of one graph: the arguments of functions, and the fields of a lamp's row.

    The format string `field`, such as ``"lamp_{}"``, makes the name of a field's symbol from the field's name.
    """

    def __init__(self, field: str = "{}") -> None:
        self._graph, self._field = Graph(), field

    def numbers(self, *names: str) -> Floats:
        """Return named symbols as an array (len(names),)."""
        return cast("Floats", symbols(self._graph, names))  # the functions of lights run on symbols, too

    def vector(self, name: str) -> Floats:
        """Return the symbols ``<name>[0]`` to ``<name>[2]`` as an array (3,)."""
        return self.numbers(*(f"{name}[{i}]" for i in range(3)))

    def fields(self, *names: str) -> Floats:
        """Return the symbols of fields of the row as an array (len(names),)."""
        return self.numbers(*map(self._field.format, names))


def trace_lamp(kind: str, *, shaped: bool, falling: bool, steps: int = 0, field: str = "{}") -> TracedFunctions:
    """Return the functions of a kind of lamp; `kind` is a key of `lookdev.light.lamps.SHAPES`.

    The symbols of the functions are the fields of a lamp's row, formatted by `field`, and these arguments in the lamp's
    coordinates: the shading point p, a direction w from there, the shading normal n, and the random numbers u1 and u2.
    The functions return:

    ``weight``
        `lookdev.light.lamps.estimate_irradiance` at p and n, times the mean radiance.
    ``meet``
        The distance from p to the lamp along w, and the pdf with which ``draw`` draws w.
    ``draw``
        A direction to the lamp drawn by u1 and u2 (3 numbers), the distance to the lamp, and the pdf.
    ``sent``
        The radiance (3 numbers) that arrives at p along -w, without the texture of a picture.
    ``place``
        The coordinates in the texture where w meets the lamp. Only the kind ``"picture"``, a textured rectangle, has
        this function.

    A lamp that is `shaped` has a beam, and a lamp that is `falling` has a falloff. If `steps` is not 0, ``sent`` also
    looks up an IES profile; `steps` is the number of bisections that find an angle in the profile's table.
    """
    row = LampSymbols(field)
    sizes = row.fields(*("a", "b")[: len(fields(SHAPES[kind]))])
    shape = (
        SHAPES[kind](*sizes)
        if kind != "picture"
        else TexturedRectangle(sizes[0], sizes[1], _TABLES, row.fields("tree")[0])
    )
    p, w, n = map(row.vector, "pwn")
    cone, tint = row.fields(*BEAM), row.fields(*TINT)
    falloff = (
        tuple(row.fields(*FALLOFF)) if falling and kind != "distant" else None
    )  # a distant light is infinitely far

    def estimate() -> list[Scalar]:
        beam = (*cone, tint.sum(axis=-1) / 3.0) if shaped else None
        return elements_of(row.fields("mean")[0] * estimate_irradiance(shape, beam, falloff, p, n))

    def meet(direction: Floats) -> list[Scalar]:
        return [*elements_of(shape.distance(p, direction)), *elements_of(shape.pdf(p, direction))]

    def sample() -> list[Scalar]:
        direction = shape.sample(p, row.numbers("u1", "u2"))
        return [*elements_of(direction), *meet(direction)]

    def radiance() -> list[Scalar]:
        sent = row.fields("red", "green", "blue")
        if shaped:
            within = cone_factor(off_axis(w), *cone[:3])
            sent = sent * np.expand_dims(within, -1) * focus_factor(w[..., 2], cone[3], tint)
        if steps:
            profile, scale, angle_scale = row.fields("profile", "profile_scale", "angle_scale")
            offset = np.maximum(profile, 0.0)
            factor = profile_factor(_TABLES, offset, steps, DEGREES * off_axis(w), azimuth(w), scale, angle_scale)
            sent = sent * np.expand_dims(np.where(profile >= 0.0, factor, 1.0), -1)
        if falloff is not None:
            sent = sent * np.expand_dims(falloff_factor(np.sqrt((p * p).sum(axis=-1)), *falloff), -1)
        return elements_of(sent)

    functions = {"weight": estimate, "meet": lambda: meet(w), "draw": sample, "sent": radiance}
    if kind == "picture":
        hit = spherical.intersect_rectangle(p, w, *sizes)[1]
        functions["place"] = lambda: [*elements_of(hit.s), *elements_of(hit.t)]
    return functions


def trace_shadow(field: str = "{}") -> TracedFunctions:
    """Return the function ``passed``: the share of a light (3 numbers) that passes an occluder.

    The symbols of the function are `SHADOW_FIELDS`, formatted by `field`, and ``distance``, the occluder's distance.
    """
    row = LampSymbols(field)
    enable, limit, zone, gamma = row.fields(*SHADOW_FIELDS[:4])
    share = shadow_factor(row.numbers("distance")[0], enable, limit, zone, gamma, row.fields(*SHADOW_FIELDS[4:]))
    return {"passed": lambda: elements_of(share)}


def trace_parts(field: str = "{}") -> TracedFunctions:
    """Return the functions of a rectangular part of a textured rectangle light, which is called a picture.

    The symbols of the functions are the fields of the light's row, formatted by `field`, the arguments p, w, u1 and u2
    of `trace_lamp`, and part_s, part_t and size. The part begins at part_s and part_t, and extends by size along both
    sides. These three numbers are fractions of the picture's sides. The functions return:

    ``angle``
        The approximate solid angle of the part from p (`lookdev.light.picture`).
    ``part``
        A direction to the part drawn by u1 and u2 (3 numbers), the distance to the picture, and the pdf.
    ``density``
        The pdf with which ``part`` draws a direction w that meets the part.
    ``place``
        The distance from p to the whole picture along w, and the two coordinates where w meets it.
    """
    row = LampSymbols(field)
    (width, height), (s, t, size) = row.fields("a", "b"), row.numbers("part_s", "part_t", "size")
    p, w = map(row.vector, "pw")
    part = spherical.project_part(p, width, height, s, t, size)

    def pdf(point: spherical.RectanglePoint) -> list[Scalar]:
        within = [np.clip((coordinate - start) / size, 0.0, 1.0) for coordinate, start in ((point.s, s), (point.t, t))]
        return elements_of(spherical.density(part, spherical.RectanglePoint(within[0], within[1], point.x, point.y)))

    distance, hit = spherical.intersect_rectangle(p, w, width, height)
    direction = spherical.directions_to_points(p, spherical.draw(part, row.numbers("u1", "u2")))
    direction_distance, direction_hit = spherical.intersect_rectangle(p, direction, width, height)
    angle = spherical.project_part(p, width, height, s, t, size, CELL_SEGMENTS).solid_angle
    return {
        "angle": lambda: elements_of(angle),
        "place": lambda: [*elements_of(distance), *elements_of(hit.s), *elements_of(hit.t)],
        "density": lambda: pdf(hit),
        "part": lambda: [*elements_of(direction), *elements_of(direction_distance), *pdf(direction_hit)],
    }


def trace_ball(field: str = "{}") -> TracedFunctions:
    """Return the functions of a local dome, whose map is on a ball of finite radius about the dome's centre.

    The symbols of the functions are the fields a and b of the dome's row, formatted by `field`: the distance from the
    centre at which the light begins to fade, and the radius. The other symbols are the arguments: p and w of
    `trace_lamp`, and the direction onto. The functions return:

    ``share``
        The share of the dome's light that arrives at p.
    ``meet``
        Three numbers: 1 if p is in the ball, else 0; the distance from p to the ball along w; and, for a small piece of
        the ball there, its solid angle seen from the centre, divided by its solid angle seen from p.
    ``draw``
        The direction (3 numbers) from p to a point of the ball: the point in the direction onto from the centre.
    """
    row = LampSymbols(field)
    start, radius = row.fields("a", "b")
    p, w, onto = map(row.vector, ("p", "w", "onto"))
    hits, distance, solid_angle_ratio = exit_ball(p, w, radius)
    inside = np.where(hits, 1.0, 0.0)
    return {
        "share": lambda: elements_of(fade_factor(p, start, radius)),
        "meet": lambda: [*elements_of(inside), *elements_of(distance), *elements_of(solid_angle_ratio)],
        "draw": lambda: elements_of(directions_to_ball(p, onto, radius)),
    }


def _write_functions(trace: Callable[_Arguments, TracedFunctions]) -> Callable[_Arguments, FunctionOperations]:
    """Return a function with the arguments of `trace` that writes the traced functions as operations.

    Results are cached by the arguments.
    """

    def write(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> FunctionOperations:
        writer = ProgramWriter()
        for name, trace_outputs in trace(*args, **kwargs).items():
            writer.add(name, trace_outputs())
        assert not writer.constants, "lights have no uniforms"
        return writer.operations, writer.outputs

    return cast("Callable[_Arguments, FunctionOperations]", cache(write))


# These functions write the traced functions above as operations.
lamp_operations = _write_functions(trace_lamp)
shadow_operations = _write_functions(trace_shadow)
part_operations = _write_functions(trace_parts)
ball_operations = _write_functions(trace_ball)
