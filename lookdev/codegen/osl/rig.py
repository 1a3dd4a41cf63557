"""A rig of several lights in the shader of a look: sections as of one light's kind, and functions of its lamps.

The functions of each shape are traced from `lookdev.light`: radiance, pdf and samples follow the code that the
reference renderer evaluates.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np

from lookdev.codegen.osl.block import Block
from lookdev.codegen.trace.graph import Graph, Scalar
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.light.dome import Dome
from lookdev.light.dome.local import LocalDome
from lookdev.light.emission import cone_factor, falloff_factor, focus_factor, off_axis, shadow_passed
from lookdev.light.lamps import SHAPES, Rig, weight

_BEAM = ("cone", "start", "rise", "focus")
_FALL = ("virtual", "power", "fade", "fade_rise")
_SHADOW = ("shadow", "limit", "zone", "gamma")


_MEET = "vector p, vector w, output float distance, output float pdf"
_DRAW = "vector p, float u1, float u2, output vector w, output float distance, output float pdf"
_SAMPLES = ("    int samples = int(control[2]);",)
# The fraction of the number, a power of two, is half the element's turn (`cycles.scene`).
_SAMPLES_AND_TURN = ("    int samples = 1 << int(floor(log2(control[2]) + 0.01));",)


def read_sections(osl: Traversable) -> dict[str, list[str]]:
    """Return the lines of a file by its sections, which begin with ``//@ section NAME``."""
    sections: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in osl.read_text(encoding="utf-8").splitlines():
        if line.startswith("//@ section "):
            lines = sections.setdefault(line.removeprefix("//@ section ").strip(), [])
        else:
            lines.append(line)
    return sections


def rig_sections(rig: Rig) -> dict[str, list[str]]:
    """Return the lines of each section of several lights, by its name in templates."""
    shaders = files("lookdev") / "shaders"
    sections = read_sections(shaders / "rig.osl.h")
    kinds = {_dome_kind(each) for each in rig.domes}
    filled = {
        name: [
            each
            for line in sections[name]
            for each in (_of_domes(rig, sections, line.split()[-1]) if line.startswith("//@ domes ") else [line])
        ]
        for name in ("macros", "parameters", "setup", "sample", "arrive")
    }
    functions = read_sections(shaders / "dome.osl.h")["functions"] if kinds - {"constant_dome"} else []
    for line in (shaders / "rig.h").read_text(encoding="utf-8").splitlines():
        functions += lamp_functions(rig) if line == "//@ lamp_functions" else [line]
    return {
        "constants": ["#define RIG 1"],
        "samples": list(_SAMPLES_AND_TURN if rig.still else _SAMPLES),
        "light_parameters": filled["parameters"],
        "light_functions": [*functions, *filled["macros"]],
        "light_setup": [],
        "light_sample": filled["sample"],
        "light_density": [],
        "light_lookup": [],
        "rig_setup": filled["setup"],
        "rig_arrive": filled["arrive"],
    }


def _dome_kind(light: Dome | LocalDome) -> str:
    return "local_dome" if isinstance(light, LocalDome) else "constant_dome" if light.constant else "dome"


def _of_domes(rig: Rig, sections: Mapping[str, list[str]], name: str) -> Iterator[str]:
    for number, light in enumerate(rig.domes):
        for line in sections[f"{_dome_kind(light)}_{name}"]:
            yield line.replace("@", str(number)) if line.startswith("//") else _numbered(line, number, rig)


def _numbered(line: str, number: int, rig: Rig) -> str:
    # "#" begins the lines of the preprocessor, too.
    begin = len(line) - len(line.lstrip("#"))
    return (line[:begin] + line[begin:].replace("#", str(len(rig.lamps) + number))).replace("@", str(number))


def lamp_functions(rig: Rig) -> Iterator[str]:
    """Yield the lines of the functions of a rig's lamps, of all kinds and of each."""
    inside = _Tracer()
    direction = inside.vector("w")
    if rig.shaped:
        tint = inside.fields("tint0", "tint1", "tint2", stacked=True)
        cone, start, rise, focus = inside.fields(*_BEAM)
        within = cone_factor(off_axis(direction), cone, start, rise)
        beam = np.expand_dims(within, -1) * focus_factor(direction[..., 2], focus, tint)
        yield from inside.function("color lamp_beam(float lamps[], int at, vector w)", {}, beam)
    distance = symbol(inside.graph, "distance")
    if rig.falling:
        factor = falloff_factor(distance, *inside.fields(*_FALL))
        yield from inside.function("float lamp_falloff(float lamps[], int at, float distance)", {}, factor)
    if rig.shadowed:
        colour = inside.fields("shadow0", "shadow1", "shadow2", stacked=True)
        enable, limit, zone, gamma = inside.fields(*_SHADOW)
        passed = shadow_passed(distance, enable, limit, zone, gamma, colour)
        yield from inside.function("color lamp_passed(float lamps[], int at, float distance)", {}, passed)
    for kind in rig.kinds:
        yield from _shape_functions(kind, rig)
    for name, given in (("meet", _MEET), ("draw", _DRAW)):
        yield from _dispatched("void", name, given, rig)
    yield from _dispatched("float", "weight", "vector p, vector n", rig)


def _shape_functions(kind: str, rig: Rig) -> Iterator[str]:
    trace = _Tracer()
    sizes = trace.fields(*("a", "b")[: len(fields(SHAPES[kind]))])
    shape = SHAPES[kind](*sizes)
    p, w = trace.vector("p"), trace.vector("w")
    met = {"distance": shape.distance(p, w), "pdf": shape.pdf(p, w)}
    yield from trace.function(f"void {kind}_meet(float lamps[], int at, {_MEET})", met)
    u = trace.stacked("u1", "u2")
    drawn = shape.sample(p, u)
    outputs = {f"w[{i}]": drawn[..., i] for i in range(3)}
    outputs |= {"distance": shape.distance(p, drawn), "pdf": shape.pdf(p, drawn)}
    yield from trace.function(f"void {kind}_draw(float lamps[], int at, {_DRAW})", outputs)
    beam = fall = None
    if rig.shaped:
        tint = trace.fields("tint0", "tint1", "tint2")
        beam = (*trace.fields(*_BEAM), (tint[0] + tint[1] + tint[2]) / 3.0)
    if rig.falling and kind != "distant":
        fall = trace.fields(*_FALL)
    (bright,) = trace.fields("mean")
    estimate = bright * weight(shape, beam, fall, p, trace.vector("n"))
    yield from trace.function(f"float {kind}_weight(float lamps[], int at, vector p, vector n)", {}, estimate)


def _dispatched(returns: str, name: str, given: str, rig: Rig) -> Iterator[str]:
    """Yield a function of all kinds of lamps that calls that of the lamp's kind."""
    names = ", ".join(each.split()[-1] for each in given.split(", "))
    yield f"{returns} lamp_{name}(float lamps[], int at, {given})"
    yield "{"
    for number, kind in enumerate(rig.kinds):
        call = f"{kind}_{name}(lamps, at, {names});"
        last = number == len(rig.kinds) - 1
        guard = "" if last else f"if (lamps[at] == {list(SHAPES).index(kind)}) "
        if returns == "void":
            yield f"    {'else ' * (number > 0)}{guard}{call}" if not last or number else f"    {call}"
        else:
            yield f"    {guard}return {call}"
    yield "}"


class _Tracer:
    """A graph of symbols that are read from a lamp's row or from the arguments of a function."""

    def __init__(self) -> None:
        self.graph = Graph()

    def vector(self, name: str) -> Any:
        return symbols(self.graph, [f"{name}[{i}]" for i in range(3)])

    def stacked(self, *names: str) -> Any:
        return symbols(self.graph, names)

    def fields(self, *names: str, stacked: bool = False) -> Any:
        codes = [f"lamps[at + LAMP_{name}]" for name in names]
        return symbols(self.graph, codes) if stacked else tuple(symbol(self.graph, code) for code in codes)

    def function(self, head: str, outputs: Mapping[str, Any], returned: Any = None) -> Iterable[str]:
        """Return the lines of a function that sets outputs, and returns a number or a colour."""
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
        return [head, "{", *block.lines, "}", ""]
