"""The lights of a scene as functions of GLSL ES 3.00: a dome, or a rig of lamps and domes.

Lamps are rows of numbers and functions traced from `lookdev.light`, as in OSL and for Mitsuba; domes are drawn from by
the tables that the renderer reads.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from lookdev.codegen.glsl.functions import function_text
from lookdev.codegen.program.lamps import lamp_operations
from lookdev.codegen.source import Operation
from lookdev.light import Dome, Light, Stand
from lookdev.light.dome import bins
from lookdev.light.lamps import FIELDS, SHAPES, CodedRig

RIG_WIDTH = 2048
"""Numbers of a row of the texture of a rig's numbers, R32F: they follow each other over all rows."""

_P, _W = "int light, vec3 p", "vec3 w"
_MEET = f"{_P}, {_W}, out float distance, out float pdf"
_WEIGHT, _SENT = f"{_P}, vec3 n, out float weight", f"{_P}, {_W}, out vec3 sent"
_DRAW = f"{_P}, float u1, float u2, out vec3 w, out float distance, out float pdf"


@dataclass(frozen=True)
class RigFunctions:
    """The text of a rig's functions, after `functions.PRELUDE`, and what they read.

    Globals are set before a call: ``rig_place`` and the shading frame by ``rig_meet_surface``. ``rig_arriving`` is the
    light from a direction over the density of all that draw it; ``rig_draw`` draws a direction. Uniforms are
    ``vec4 turns``, sine and cosine of the turns of the lights that turn with the rig and of those that stay, and
    ``sampler2D rig_numbers``, rows of `RIG_WIDTH`, the numbers of which are `numbers`. A dome `k` of `domes` that is
    not constant has ``dome<k>_map`` and ``dome<k>_points``, RGBA32F, and ``isampler2D dome<k>_slots``. With
    `tables`, those of IES profiles, there is ``sampler2D rig_tables``, rows of `functions.TABLE_WIDTH`.
    """

    text: str
    numbers: NDArray[np.float32]
    domes: tuple[Dome, ...]
    tables: NDArray[np.float32] | None = None


@dataclass(frozen=True)
class _Function:
    """A program of some results of another."""

    operations: Sequence[Operation]
    outputs: Mapping[str, tuple[int, ...]]
    constants: tuple[float, ...] = ()


def rig_functions(lights: Sequence[Light], lit: Sequence[Sequence[int]], stand: Stand) -> RigFunctions:
    """Return the functions of lights; `lit` has the numbers of the lights of each slot."""
    rig = CodedRig.of(lights)
    domes = tuple(each for each in rig.domes if isinstance(each, Dome))
    assert len(rig.lamps) + len(domes) == len(lights), "local domes are left out before"
    numbers = [rig.rows(stand).astype(np.float64)]
    starts = []
    for dome in domes:
        starts.append(sum(map(len, numbers)))
        if not dome.constant:
            assert dome.bins_file is not None, "it is sampled"
            numbers.append(np.load(dome.bins_file.path).astype(np.float64).ravel())
    marks = sum(map(len, numbers))
    order = [next(k for k, light in enumerate(lights) if light is each) for each in (*rig.lamps, *domes)]
    numbers.append(np.array([[number in each for number in order] for each in lit], np.float64).ravel())
    constants = {
        "RIG_LAMPS": len(rig.lamps),
        "RIG_DOMES": len(domes),
        "RIG_LIGHTS": len(lights),
        "RIG_MARKS": marks,
        "RIG_SEEN": int(any(each.emission.camera for each in rig.lamps)),
        "LAMP_FIELDS": len(FIELDS),
        **{f"LAMP_{name}": number for number, name in enumerate(FIELDS)},
    }
    lines = [f"#define {name} {value}" for name, value in constants.items()]
    shaders = files("lookdev") / "shaders"
    if domes:
        lines += [line for line in Dome.table_constants() if "{" not in line]
        lines += [_array("dome_cells", bins.CELLS), _array("dome_first", bins.FIRST)]
        lines += [_array("dome_starts", starts), _array("dome_constant", [int(each.constant) for each in domes], "int")]
        lines += (shaders / "dome.glsl").read_text(encoding="utf-8").splitlines()
    own = {"//@ lamp_functions": lambda: _lamp_functions(rig), "//@ dome_functions": lambda: _dome_functions(domes)}
    for line in (shaders / "rig.glsl").read_text(encoding="utf-8").splitlines():
        lines += own[line]() if line in own else [line]
    text, tables = "\n".join(lines) + "\n", rig.tables() if rig.profiled else None
    return RigFunctions(text, np.concatenate(numbers).astype(np.float32), domes, tables)


def _array(name: str, values: Sequence[int], kind: str = "int") -> str:
    return f"const {kind} {name}[{len(values)}] = {kind}[{len(values)}]({', '.join(map(str, values))});"


def _lamp_functions(rig: CodedRig) -> Iterator[str]:
    """Yield the functions of each kind of lamp, and those of any lamp, which call the ones of its kind."""
    profiles = [each.shaping.profile for each in rig.emissions if each.shaping and each.shaping.profile]
    steps = max((each.steps for each in profiles), default=0)
    if profiles:
        yield "uniform highp sampler2D rig_tables;"
    for kind in rig.kinds:
        operations, results = lamp_operations(kind, shaped=rig.shaped, falling=rig.falling, steps=steps)
        named = [replace(each, name=f"lamp_{each.name}") if each.name in FIELDS else each for each in operations]
        met, drawn = results["meet"], results["draw"]
        meeting = _Function(named, {"distance": met[:1], "pdf": met[1:]})
        drawing = _Function(named, {"w": drawn[:3], "distance": drawn[3:4], "pdf": drawn[4:]})
        yield from _function(meeting, f"{kind}_meet({_MEET})", ("distance", "pdf"))
        yield from _function(drawing, f"{kind}_draw({_DRAW})", ("w", "distance", "pdf"))
        for name, head in (("weight", _WEIGHT), ("sent", _SENT)):
            yield from _function(_Function(named, {name: results[name]}), f"{kind}_{name}({head})", (name,))
    for name, head in {"meet": _MEET, "draw": _DRAW, "weight": _WEIGHT, "sent": _SENT}.items():
        if rig.lamps:
            yield f"void lamp_{name}({head}) {{"
            yield "    int kind = int(rig_field(light, LAMP_kind));"
            given = ", ".join(each.split()[-1] for each in head.split(", "))
            for number, kind in enumerate(rig.kinds):
                test = f"if (kind == {list(SHAPES).index(kind)}) " if number + 1 < len(rig.kinds) else ""
                yield f"    {'else ' if number else ''}{test}{kind}_{name}({given});"
            yield "}"


def _function(program: _Function, head: str, outputs: Sequence[str]) -> Iterator[str]:
    """Yield the lines of a function of a lamp, which reads the numbers of its row."""
    first, *rest = function_text(program, head, outputs)
    read = set(re.findall(r"\blamp_(\w+)", "\n".join(rest)))
    yield first
    yield from (f"    float lamp_{name} = rig_field(light, LAMP_{name});" for name in FIELDS if name in read)
    # Its only table is that of the rig: a look has its own.
    yield from (line.replace("(look_table0,", "(rig_tables,") for line in rest)


def _dome_functions(domes: Sequence[Dome]) -> Iterator[str]:
    """Yield the samplers of domes, and functions that read those of the dome of a number."""
    varied = [number for number, each in enumerate(domes) if not each.constant]
    for k in varied:
        yield f"uniform highp sampler2D dome{k}_map, dome{k}_points;"
        yield f"uniform highp isampler2D dome{k}_slots;"
    yield "vec3 dome_map(int dome, vec3 w) {"
    yield from (f"    if (dome == {k}) return dome_look_up(dome{k}_map, w);" for k in varied)
    yield "    return vec3(1.0);"
    yield "}"
    yield "vec3 dome_drawn(int dome, int bin, float share, float u1, float u2, out vec3 w, out float ratio) {"
    for k in varied:
        yield f"    if (dome == {k})"
        yield f"        return dome_sample(dome{k}_slots, dome{k}_points, bin, share, u1, u2, w, ratio);"
    yield "    w = vec3(0.0, 0.0, 1.0);"
    yield "    ratio = 0.0;"
    yield "    return vec3(0.0);"
    yield "}"
