"""A rig of several lights in the shader of a look: the sections that one light has, and functions of its lamps.

The functions of each shape are traced from `lookdev.light`: radiance, pdf and samples follow the code that the
reference renderer evaluates.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import TypeAlias, cast

import numpy as np

from lookdev.arrays import Floats
from lookdev.codegen.osl.block import Block
from lookdev.codegen.trace.graph import Graph, Scalar
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.light.base import Light
from lookdev.light.emission import cone_factor, falloff_factor, focus_factor, off_axis, shadow_passed
from lookdev.light.lamps import SHAPES, CodedRig, weight
from lookdev.light.picture import CELL_SEGMENTS
from lookdev.light.shape import Shape
from lookdev.light.spherical_rectangle import Point, density, draw, meet_plane, seen_part, towards_plane

Lines: TypeAlias = tuple[str, ...]

_BEAM = ("cone", "start", "rise", "focus")
_FALL = ("virtual", "power", "fade", "fade_rise")
_SHADOW = ("shadow", "limit", "zone", "gamma")


_MEET = "vector p, vector w, output float distance, output float pdf"
_DRAW = "vector p, float u1, float u2, output vector w, output float distance, output float pdf"
_SAMPLES = ("    int samples = int(control[2]);",)
# The number is a power of two, the samples, times 1 plus half the element's turn (`cycles.scene`).
_SAMPLES_AND_TURN = ("    int samples = 1 << int(floor(log2(control[2]) + 0.01));",)


def read_sections(osl: Traversable) -> dict[str, list[str]]:
    """Return the lines of a file by section; a section begins with ``//@ section NAME``."""
    sections: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in osl.read_text(encoding="utf-8").splitlines():
        if line.startswith("//@ section "):
            lines = sections.setdefault(line.removeprefix("//@ section ").strip(), [])
        else:
            lines.append(line)
    return sections


def rig_sections(rig: CodedRig) -> dict[str, list[str]]:
    """Return the lines of each section of several lights, by the section's name in templates."""
    shaders = files("lookdev") / "shaders"
    sections = read_sections(shaders / "rig.osl.h")
    kinds = {_dome_kind(light) for light in rig.domes}
    expanded = {
        name: [part_line for line in sections[name] for part_line in _expand_line(rig, sections, line)]
        for name in ("macros", "parameters", "setup", "seen", "sample", "arrive")
    }
    functions = read_sections(shaders / "dome.osl.h")["functions"] if kinds - {"constant_dome"} else []
    generated = {
        "//@ shape_functions": lambda: _shapes(rig),
        "//@ lamp_functions": lambda: _lamp_functions(rig),
    }
    for line in (shaders / "rig.h").read_text(encoding="utf-8").splitlines():
        functions += generated[line]() if line in generated else [line]
    return {
        "constants": ["#define RIG 1"],
        "samples": list(_SAMPLES_AND_TURN if rig.needs("still") else _SAMPLES),
        "light_parameters": expanded["parameters"],
        "light_functions": [*functions, *expanded["macros"]],
        "light_setup": [],
        "light_sample": expanded["sample"],
        "light_density": [],
        "light_lookup": [],
        "rig_setup": expanded["setup"],
        "rig_seen": expanded["seen"],
        "rig_arrive": expanded["arrive"],
    }


def _dome_kind(light: Light) -> str:
    return "constant_dome" if light.constant else light.kind


def _expand_line(rig: CodedRig, sections: Mapping[str, list[str]], line: str) -> Iterable[str]:
    """Return the lines that replace a line ``//@ domes NAME`` or ``//@ pictures NAME``; other lines stay."""
    match line.split():
        case ["//@", "domes", name]:
            return _dome_lines(rig, sections, name)
        case ["//@", "pictures", name]:
            lines = sections[f"picture_{name}"]
            return (part_line.replace("@", str(number)) for number in range(len(rig.pictures)) for part_line in lines)
    return (line,)


def _dome_lines(rig: CodedRig, sections: Mapping[str, list[str]], name: str) -> Iterator[str]:
    for number, light in enumerate(rig.domes):
        kind = _dome_kind(light)
        section = f"{kind}_{name}"
        for line in sections[section if section in sections else f"dome_{name}"]:
            yield line.replace("@", str(number)) if line.startswith("//") else _fill_numbers(line, number, rig)


def _fill_numbers(line: str, number: int, rig: CodedRig) -> str:
    # A "#" at the beginning of a line is one of the preprocessor's.
    begin = len(line) - len(line.lstrip("#"))
    return (line[:begin] + line[begin:].replace("#", str(len(rig.lamps) + number))).replace("@", str(number))


def _shapes(rig: CodedRig) -> Iterator[str]:
    """Yield the functions that lamps of all kinds share, and those of each shape."""
    beam, falloff, shadow = _control_functions()
    yield from (*beam * rig.needs("shaped"), *falloff * rig.needs("falling"), *shadow * rig.needs("shadowed"))
    for kind in rig.kinds:
        yield from _picture_functions() if kind == "picture" else _shape_functions(kind)
        yield from _weight_function(kind, rig.needs("shaped"), rig.needs("falling") and kind != "distant")


@cache
def _control_functions() -> tuple[Lines, Lines, Lines]:
    """Return the functions of a beam, of a falloff, and of a shadow."""
    trace = _Tracer()
    direction, distance = trace.vector("w"), symbol(trace.graph, "distance")
    tint = trace.stack_fields("tint0", "tint1", "tint2")
    cone, start, rise, focus = trace.fields(*_BEAM)
    within = cone_factor(off_axis(direction), cone, start, rise)
    beam = np.expand_dims(within, -1) * focus_factor(direction[..., 2], focus, tint)
    factor = falloff_factor(distance, *trace.fields(*_FALL))
    colour = trace.stack_fields("shadow0", "shadow1", "shadow2")
    enable, limit, zone, gamma = trace.fields(*_SHADOW)
    share = shadow_passed(distance, enable, limit, zone, gamma, colour)
    return (
        trace.function("color lamp_beam(float lamps[], int at, vector w)", {}, beam),
        trace.function("float lamp_falloff(float lamps[], int at, float distance)", {}, factor),
        trace.function("color lamp_passed(float lamps[], int at, float distance)", {}, share),
    )


def _lamp_functions(rig: CodedRig) -> Iterator[str]:
    """Yield functions for all kinds of lamps, which call those of a lamp's kind."""
    if rig.lamps:
        yield from _dispatch_function(rig, "void lamp_meet", _MEET, tables=True)
        yield from _dispatch_function(rig, "void lamp_draw", _DRAW, tables=True)
        yield from _dispatch_function(rig, "float lamp_weight", "vector p, vector n")


@cache
def _shape_functions(kind: str) -> Lines:
    trace = _Tracer()
    shape = trace.shape(kind)
    p, w = trace.vector("p"), trace.vector("w")
    outputs_of_meet = {"distance": shape.distance(p, w), "pdf": shape.pdf(p, w)}
    meet = trace.function(f"void {kind}_meet(float lamps[], float tables[], int at, {_MEET})", outputs_of_meet)
    direction = shape.sample(p, trace.numbers("u1", "u2"))
    outputs = {f"w[{i}]": direction[..., i] for i in range(3)}
    outputs |= {"distance": shape.distance(p, direction), "pdf": shape.pdf(p, direction)}
    return meet + trace.function(f"void {kind}_draw(float lamps[], float tables[], int at, {_DRAW})", outputs)


@cache
def _weight_function(kind: str, shaped: bool, falling: bool) -> Lines:
    trace = _Tracer()
    beam = fall = None
    if shaped:
        tint = trace.fields("tint0", "tint1", "tint2")
        beam = (*trace.fields(*_BEAM), (tint[0] + tint[1] + tint[2]) / 3.0)
    if falling:
        fall = trace.fields(*_FALL)
    (bright,) = trace.fields("mean")
    estimate = bright * weight(trace.shape(kind), beam, fall, trace.vector("p"), trace.vector("n"))
    return trace.function(f"float {kind}_weight(float lamps[], int at, vector p, vector n)", {}, estimate)


@cache
def _picture_functions() -> Lines:
    """Return functions of a part of a rectangle: from s, t on, of a size in both (`lookdev.light.picture`).

    s, t and the size are fractions of the rectangle's sides.
    """
    trace = _Tracer()
    width, height = trace.fields("a", "b")
    p, w = trace.vector("p"), trace.vector("w")
    s, t, size = (trace.number(name) for name in ("part_s", "part_t", "size"))
    size_parameters = "float part_s, float part_t, float size"
    angle = seen_part(p, width, height, s, t, size, CELL_SEGMENTS).solid_angle
    functions = trace.function(f"float rect_part_angle(float lamps[], int at, vector p, {size_parameters})", {}, angle)
    distance, point = meet_plane(p, w, width, height)
    places = {"distance": distance, "s": point.s, "t": point.t}
    head = "vector p, vector w, output float distance, output float s, output float t"
    functions += trace.function(f"void rect_place(float lamps[], int at, {head})", places)
    part_seen = seen_part(p, width, height, s, t, size)

    def pdf(point: Point) -> Floats:
        within = [np.clip((coordinate - start) / size, 0.0, 1.0) for coordinate, start in ((point.s, s), (point.t, t))]
        value: Floats = density(part_seen, Point(within[0], within[1], point.x, point.y))
        return value

    head = f"vector p, vector w, {size_parameters}"
    functions += trace.function(f"float rect_part_density(float lamps[], int at, {head})", {}, pdf(point))
    direction = towards_plane(p, draw(part_seen, trace.numbers("u1", "u2")))
    distance, point = meet_plane(p, direction, width, height)
    outputs = {**{f"w[{i}]": direction[..., i] for i in range(3)}, "distance": distance, "pdf": pdf(point)}
    head = f"vector p, {size_parameters}, float u1, float u2, output vector w, output float distance, output float pdf"
    return functions + trace.function(f"void rect_part_draw(float lamps[], int at, {head})", outputs)


def _dispatch_function(rig: CodedRig, name: str, parameters: str, *, tables: bool = False) -> Iterator[str]:
    """Yield the lines of a function for all kinds of lamps, which calls that of a lamp's kind."""
    suffix = name.split()[-1].removeprefix("lamp_")
    first = "lamps, tables, at" if tables else "lamps, at"
    names = ", ".join((first, *(parameter.split()[-1] for parameter in parameters.split(", "))))
    yield f"{name}(float lamps[],{' float tables[],' * tables} int at, {parameters})"
    yield "{"
    *others, last = rig.kinds
    for kind in others:
        yield f"    if (lamps[at] == {list(SHAPES).index(kind)}) {{"
        yield f"        {'return ' * name.startswith('float')}{kind}_{suffix}({names});"
        yield "    } else"
    yield f"    {'return ' * name.startswith('float')}{last}_{suffix}({names});"
    yield "}"


class _Tracer:
    """A graph whose symbols are fields of a lamp's row, or arguments of a function."""

    def __init__(self) -> None:
        self.graph = Graph()

    def vector(self, name: str) -> Floats:
        return self.numbers(*(f"{name}[{i}]" for i in range(3)))

    def numbers(self, *names: str) -> Floats:
        return cast("Floats", symbols(self.graph, names))  # the functions of lights run on symbols, too

    def number(self, name: str) -> Floats:
        return cast("Floats", symbol(self.graph, name))

    def shape(self, kind: str) -> Shape:
        shape: Shape = SHAPES[kind](*self.fields(*("a", "b")[: len(fields(SHAPES[kind]))]))
        return shape

    def fields(self, *names: str) -> tuple[Floats, ...]:
        return tuple(self.number(f"lamps[at + LAMP_{name}]") for name in names)

    def stack_fields(self, *names: str) -> Floats:
        return self.numbers(*(f"lamps[at + LAMP_{name}]" for name in names))

    def function(self, head: str, outputs: Mapping[str, Floats], returned: Floats | None = None) -> Lines:
        """Return the lines of a function that sets outputs, and returns a number or a colour if `returned` is set."""
        block = Block("v", indent=1)
        values: dict[str, Scalar] = {name: elements_of(value)[0] for name, value in outputs.items()}
        result = [] if returned is None else elements_of(returned)
        block.prepare([*values.values(), *result])
        codes = {name: block.name(value) for name, value in values.items()}
        final = [block.expression(value) for value in result]
        for name, code in codes.items():
            block.write(f"{name} = {code};")
        if final:
            block.write(f"return {final[0]};" if len(final) == 1 else f"return color({', '.join(final)});")
        return head, "{", *block.lines, "}", ""
