"""Write the OSL of a scene's lights, which is part of the surface shader of every look (`osl.surface`).

A single light whose kind has an OSL file of its own is rendered by this file. All other lights are a rig. The functions
of a rig's lamps are traced from `lookdev.light`: radiance, pdf and samples follow the code that the reference renderer
evaluates.

The OSL file of a kind begins with a comment, and is then divided into sections by lines ``//@ section NAME``. The
template `lookdev/shaders/surface.osl` includes each section at a line ``//@ light_NAME``. Sections can read:

- the globals of the shader, where ``P`` is relative to the centre of the asset's bounding sphere;
- ``turn``, the rotation of the light about z in radians;
- ``IBL_SAMPLES``, which is 0 if directions are drawn from the BSDF alone. No other macro or variable of sampling then
  exists.

These are the sections:

``parameters``
    Parameters of the shader. `lookdev.light.LightCode` has their values.
``functions``
    Functions, which precede the shader.
``setup``
    Runs at each shading point if ``IBL_SAMPLES > 0``. ``n`` is the shading normal, ``seed`` the point's scramble.
    ``front_samples`` is the number of directions for light from the viewer's side of the surface. With ``TRANSMITS``,
    ``back_samples`` is the number of directions for light from the other side.
``sample``
    Draws sample ``number`` of the pixel, for the other side if ``back`` is 1. Samples are numbered from 0, separately
    for front and back. The section sets the direction ``wi`` and its ``radiance``. If the probability of the draw is
    not exactly the pdf, it also sets ``ratio``, the pdf divided by the probability.
``density``
    Adds to ``density``, for each side, the pdf of ``wi`` times the number of samples for this side. Also sets
    ``radiance``.
``lookup``
    Sets ``radiance`` to the light from direction ``wi``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import chain
from typing import TypeAlias

import numpy as np

from lookdev.codegen.osl.block import Block
from lookdev.codegen.program.lamps import BEAM, FALLOFF, TINT, LampSymbols, trace_lamp, trace_parts, trace_shadow
from lookdev.codegen.templates import SHADERS, expand_template, read_sections
from lookdev.codegen.trace.graph import Scalar
from lookdev.codegen.trace.symbolic import elements_of
from lookdev.errors import CodegenError
from lookdev.light import LIGHT_KINDS, Light, coded_light
from lookdev.light.emission import cone_factor, falloff_factor, focus_factor, off_axis
from lookdev.light.lamps import SHAPES, CodedRig

SECTIONS = ("parameters", "functions", "setup", "sample", "density", "lookup")
"""The sections of the OSL file of a light's kind."""

Lines: TypeAlias = tuple[str, ...]
"""Lines of OSL."""

_FIELD = "lamps[at + LAMP_{}]"  # the text of a field of a lamp, whose row begins at index `at` of the array `lamps`
# Parameters and heads of functions of lamps. p is the shading point and w a direction, both in the lamp's coordinates.
_ROW = "float lamps[], int at"
_MEET = "vector p, vector w, output float distance, output float pdf"
_DRAW = "vector p, float u1, float u2, output vector w, output float distance, output float pdf"
_SHAPE_HEADS = {
    "meet": f"void KIND_meet(float lamps[], float tables[], int at, {_MEET})",
    "draw": f"void KIND_draw(float lamps[], float tables[], int at, {_DRAW})",
}
# A part of a textured rectangle begins at part_s, part_t; these and its size are fractions of the rectangle's sides.
_PART = "float part_s, float part_t, float size"
_PART_HEADS = {
    "angle": f"float rect_part_angle({_ROW}, vector p, {_PART})",
    "place": f"void rect_place({_ROW}, vector p, vector w, output float distance, output float s, output float t)",
    "density": f"float rect_part_density({_ROW}, vector p, vector w, {_PART})",
    "part": f"void rect_part_draw({_ROW}, {_DRAW.replace('vector p,', f'vector p, {_PART},')})",
}
# The line that reads the number of samples from a parameter.
_SAMPLES = ("    int samples = int(control[2]);",)
# This line replaces the line above in a rig with lights that do not turn with the rig: `cycles.scene` passes the number
# of samples, a power of two, times 1 + e / 720, where e is the asset's rotation in degrees.
_SAMPLES_AND_TURN = ("    int samples = 1 << int(floor(log2(control[2]) + 0.01));",)


def light_sections(lights: Sequence[Light]) -> dict[str, list[str]]:
    """Return the lines that the lights add to the template `surface.osl`, by the name of the placeholder.

    Raises
    ------
    CodegenError
        The file of a kind lacks a section, or has an unknown one.
    """
    single = coded_light(lights)
    if single is None:
        return _rig_sections(CodedRig.from_lights(lights))
    osl = LIGHT_KINDS[single.kind].osl
    assert osl is not None, "a light that is coded has OSL"
    sections = read_sections(osl)
    if mismatched := sorted(sections.keys() ^ set(SECTIONS)):
        names = ", ".join(mismatched)
        raise CodegenError(f"{osl.name}: a light has sections {', '.join(SECTIONS)}; unknown or missing: {names}")
    empty: dict[str, list[str]] = {"rig_setup": [], "rig_seen": [], "rig_arrive": []}
    light = {f"light_{name}": code for name, code in sections.items()}
    return {"constants": ["#define RIG 0"], "samples": list(_SAMPLES), **empty, **light}


def _rig_sections(rig: CodedRig) -> dict[str, list[str]]:
    """Return the lines that a rig adds to the template `surface.osl`, by the name of the placeholder."""
    sections = read_sections(SHADERS / "rig.osl.h")
    kinds = {_dome_kind(light) for light in rig.domes}
    expanded = {
        name: list(chain.from_iterable(_expand_line(rig, sections, line) for line in sections[name]))
        for name in ("macros", "parameters", "setup", "seen", "sample", "arrive")
    }
    functions = read_sections(SHADERS / "dome.osl.h")["functions"] if kinds - {"constant_dome"} else []
    generated = {"shape_functions": [*_shape_functions(rig)], "lamp_functions": [*_lamp_functions(rig)]}
    functions += expand_template("rig.h", generated).splitlines()
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
    """Return the name with which a dome's sections in `rig.osl.h` begin."""
    return "constant_dome" if light.constant else light.kind


def _expand_line(rig: CodedRig, sections: Mapping[str, list[str]], line: str) -> Iterable[str]:
    """Return the lines that replace a line of `rig.osl.h`.

    A line ``//@ domes NAME`` is replaced by the lines of `_dome_lines`. A line ``//@ pictures NAME`` is replaced by the
    section ``picture_NAME``, once for each textured lamp. Other lines stay as they are.
    """
    match line.split():
        case ["//@", "domes", name]:
            return _dome_lines(rig, sections, name)
        case ["//@", "pictures", name]:
            lines = sections[f"picture_{name}"]
            return (part_line.replace("@", str(number)) for number in range(len(rig.pictures)) for part_line in lines)
    return (line,)


def _dome_lines(rig: CodedRig, sections: Mapping[str, list[str]], name: str) -> Iterator[str]:
    """Yield the lines of each dome: the section ``<kind>_<name>``, or ``dome_<name>`` if there is no such section."""
    for number, light in enumerate(rig.domes):
        kind = _dome_kind(light)
        section = f"{kind}_{name}"
        for line in sections[section if section in sections else f"dome_{name}"]:
            yield line.replace("@", str(number)) if line.startswith("//") else _fill_numbers(line, number, rig)


def _fill_numbers(line: str, number: int, rig: CodedRig) -> str:
    """Replace ``@`` by the number of a dome among domes, and ``#`` by its number among all lights of the rig."""
    # A "#" at the beginning of a line belongs to the preprocessor.
    begin = len(line) - len(line.lstrip("#"))
    return (line[:begin] + line[begin:].replace("#", str(len(rig.lamps) + number))).replace("@", str(number))


def _shape_functions(rig: CodedRig) -> Iterator[str]:
    """Yield the lines of the functions that lamps of all kinds share, then of the functions of each kind."""
    beam, falloff, shadow = _control_functions()
    yield from (*beam * rig.needs("shaped"), *falloff * rig.needs("falling"), *shadow * rig.needs("shadowed"))
    for kind in rig.kinds:
        yield from _kind_functions(kind, rig.needs("shaped"), rig.needs("falling"))


@cache
def _control_functions() -> tuple[Lines, Lines, Lines]:
    """Return the lines of the functions of a lamp's beam, of its falloff, and of its shadow."""
    row = LampSymbols(_FIELD)
    direction, tint = row.vector("w"), row.fields(*TINT)
    *cone, focus = row.fields(*BEAM)
    within = cone_factor(off_axis(direction), *cone)
    beam = np.expand_dims(within, -1) * focus_factor(direction[..., 2], focus, tint)
    falloff = falloff_factor(*row.numbers("distance"), *row.fields(*FALLOFF))
    return (
        _function_lines(f"color lamp_beam({_ROW}, vector w)", elements_of(beam)),
        _function_lines(f"float lamp_falloff({_ROW}, float distance)", elements_of(falloff)),
        _function_lines(f"color lamp_passed({_ROW}, float distance)", trace_shadow(_FIELD)["passed"]()),
    )


def _lamp_functions(rig: CodedRig) -> Iterator[str]:
    """Yield the lines of functions for any lamp, which call the functions of the lamp's kind."""
    if rig.lamps:
        yield from _dispatch_function(rig, "void lamp_meet", _MEET, tables=True)
        yield from _dispatch_function(rig, "void lamp_draw", _DRAW, tables=True)
        yield from _dispatch_function(rig, "float lamp_weight", "vector p, vector n")


@cache
def _kind_functions(kind: str, shaped: bool, falling: bool) -> Lines:
    """Return the lines of the functions of a kind of lamp.

    For a picture, these are the functions of `trace_parts`, and ``weight`` of `trace_lamp`.
    """
    lamp = trace_lamp(kind, shaped=shaped, falling=falling, field=_FIELD)
    traced, heads = (trace_parts(_FIELD), _PART_HEADS) if kind == "picture" else (lamp, _SHAPE_HEADS)
    functions = [_function_lines(head.replace("KIND", kind), traced[name]()) for name, head in heads.items()]
    functions.append(_function_lines(f"float {kind}_weight({_ROW}, vector p, vector n)", lamp["weight"]()))
    return tuple(chain(*functions))


def _dispatch_function(rig: CodedRig, name: str, parameters: str, *, tables: bool = False) -> Iterator[str]:
    """Yield the lines of the function `name`, which calls the function of a lamp's kind.

    The type of the result precedes the name in `name`. `parameters` are the parameters after the lamp's row. With
    `tables`, the function also takes the rig's tables.
    """
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


def _function_lines(head: str, values: Sequence[Scalar]) -> Lines:
    """Return the lines of a function that sets its ``output`` parameters to values.

    `head` is the function's type, name and parameters. If there are no outputs, the function returns the values.
    """
    components = {"float": ("",), "vector": ("[0]", "[1]", "[2]")}
    outputs = [name + part for kind, name in re.findall(r"output (\w+) (\w+)", head) for part in components[kind]]
    block = Block("v", indent=1)
    block.prepare(values)
    codes = [block.name(value) if outputs else block.expression(value) for value in values]
    if outputs:
        for name, code in zip(outputs, codes, strict=True):
            block.write(f"{name} = {code};")
    else:
        block.write(f"return {codes[0]};" if len(codes) == 1 else f"return color({', '.join(codes)});")
    return head, "{", *block.lines, "}", ""
