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
from lookdev.codegen.program.lamps import (
    Functions,
    ball_operations,
    lamp_operations,
    part_operations,
    shadow_operations,
)
from lookdev.codegen.source import Operation
from lookdev.light import Dome, Light, RectLight, Stand
from lookdev.light.dome import bins
from lookdev.light.lamps import FIELDS, SHAPES, CodedRig
from lookdev.light.picture import LEVELS

RIG_WIDTH = 2048
"""Numbers of a row of the texture of a rig's numbers, R32F: they follow each other over all rows."""

_P, _W = "int light, vec3 p", "vec3 w"
_PASSED = "int light, float distance, out vec3 passed"
_PART = "float part_s, float part_t, float size"
_BALL = {
    "share": (f"{_P}, out float share", {"share": 1}),
    "meet": (
        f"{_P}, {_W}, out float within, out float distance, out float around",
        {"within": 1, "distance": 1, "around": 1},
    ),
    "draw": (f"{_P}, vec3 onto, out vec3 w", {"w": 3}),
}

_PICTURE = {
    "angle": (f"{_P}, {_PART}, out float angle", {"angle": 1}),
    "place": (f"{_P}, {_W}, out float distance, out float s, out float t", {"distance": 1, "s": 1, "t": 1}),
    "density": (f"{_P}, {_W}, {_PART}, out float pdf", {"pdf": 1}),
    "part": (
        f"{_P}, {_PART}, float u1, float u2, out vec3 w, out float distance, out float pdf",
        {"w": 3, "distance": 1, "pdf": 1},
    ),
}
_LAMP = {
    "weight": (f"{_P}, vec3 n, out float weight", {"weight": 1}),
    "meet": (f"{_P}, {_W}, out float distance, out float pdf", {"distance": 1, "pdf": 1}),
    "draw": (
        f"{_P}, float u1, float u2, out vec3 w, out float distance, out float pdf",
        {"w": 3, "distance": 1, "pdf": 1},
    ),
    "sent": (f"{_P}, {_W}, out vec3 sent", {"sent": 3}),
}
"""Heads of functions, and the widths of what they set."""


@dataclass(frozen=True)
class RigFunctions:
    """The text of a rig's functions, after `functions.PRELUDE`, and what they read.

    Globals are set before a call: ``rig_place`` and the shading frame by ``rig_meet_surface``. ``rig_arriving`` is the
    light from a direction over the density of all that draw it; ``rig_draw`` draws a direction, and ``rig_let`` is the
    share of its light that is not occluded. Where ``SHADOWS`` is not 0, both call ``float occluder_distance(vec3 w,
    float reach, int spared, bool any)``. Uniforms are ``vec4 turns``, sine and cosine of the turns of the lights that
    turn with the rig and of those that stay, and ``sampler2D rig_numbers``, rows of `RIG_WIDTH`, the numbers of which
    are `numbers`. Dome `k` of `domes`, None where it is the same all around, has ``dome<k>_map`` and
    ``dome<k>_points``, RGBA32F, and ``isampler2D dome<k>_slots``; picture `k` of `pictures` is ``picture<k>``, RGBA32F.
    With `tables`, those of IES profiles and pictures, there is ``sampler2D rig_tables``, rows of
    `functions.TABLE_WIDTH`.

    A rig that is `split` has lights whose diffuse and specular light have factors; one that is `plain` is occluded in
    whole, by whatever is met.
    """

    text: str
    numbers: NDArray[np.float32]
    domes: tuple[Dome | None, ...]
    pictures: tuple[RectLight, ...] = ()
    tables: NDArray[np.float32] | None = None
    split: bool = False
    plain: bool = True


@dataclass(frozen=True)
class _Function:
    """A program of some results of another."""

    operations: Sequence[Operation]
    outputs: Mapping[str, tuple[int, ...]]
    constants: tuple[float, ...] = ()


def rig_functions(
    lights: Sequence[Light], lit: Sequence[Sequence[int]], stand: Stand, groups: Sequence[int] = ()
) -> RigFunctions:
    """Return the functions of lights; `lit` has the numbers of the lights of each slot, `groups` the slots' groups."""
    rig = CodedRig.of(lights)
    domes = tuple(None if each.constant else each.map_dome for each in rig.domes)
    numbers = [rig.rows(stand).astype(np.float64)]
    starts = []
    for dome in domes:
        starts.append(sum(map(len, numbers)))
        if dome is not None:
            assert dome.bins_file is not None, "it is sampled"
            numbers.append(np.load(dome.bins_file.path).astype(np.float64).ravel())
    marks = sum(map(len, numbers))
    order = [next(k for k, light in enumerate(lights) if light is each) for each in (*rig.lamps, *rig.domes)]
    numbers.append(np.array([[number in each for number in order] for each in lit], np.float64).ravel())
    casting = sum(map(len, numbers))
    groups = groups or [0] * len(lit)
    numbers.append(np.array([[group not in each for group in groups] for each in rig.spared], np.float64).ravel())
    near = any(not each.far for each in rig.lamps) or any(not each.far for each in rig.domes)
    constants = {
        "RIG_LAMPS": len(rig.lamps),
        "RIG_DOMES": len(domes),
        "RIG_LIGHTS": len(lights),
        "RIG_LOCAL_DOMES": int(any(not each.far for each in rig.domes)),
        "RIG_MARKS": marks,
        "RIG_CASTING": casting,
        "RIG_SLOTS": len(lit),
        "RIG_SPARED": len(rig.spared),
        "RIG_SEEN": int(any(each.emission.camera for each in rig.lamps)),
        "RIG_SHADOWED": int(rig.shadowed),
        "RIG_SPLIT": int(rig.split),
        "PICTURE_LEVELS": LEVELS,
        "RIG_NEAREST": int(near or rig.shadowed),
        "LAMP_FIELDS": len(FIELDS),
        **{f"LAMP_{name}": number for number, name in enumerate(FIELDS)},
    }
    lines = [f"#define {name} {value}" for name, value in constants.items()]
    shaders = files("lookdev") / "shaders"
    if domes:
        lines += [line for line in Dome.table_constants() if "{" not in line]
        lines += [_array("dome_cells", bins.CELLS), _array("dome_first", bins.FIRST), _array("dome_starts", starts)]
        lines += [_array("dome_constant", [int(each.constant) for each in rig.domes])]
        lines += [_array("dome_local", [int(not each.far) for each in rig.domes])]
        lines += (shaders / "dome.glsl").read_text(encoding="utf-8").splitlines()
    own = {"//@ lamp_functions": lambda: _lamp_functions(rig), "//@ dome_functions": lambda: _dome_functions(rig.domes)}
    for line in (shaders / "rig.glsl").read_text(encoding="utf-8").splitlines():
        lines += own[line]() if line in own else [line]
    return RigFunctions(
        "\n".join(lines) + "\n",
        np.concatenate(numbers).astype(np.float32),
        domes,
        rig.pictures,
        rig.tables() if rig.profiled or rig.pictures else None,
        rig.split,
        plain=not (near or rig.shadowed or rig.spared),
    )


def _array(name: str, values: Sequence[int]) -> str:
    return f"const int {name}[{len(values)}] = int[{len(values)}]({', '.join(map(str, values))});"


def _lamp_functions(rig: CodedRig) -> Iterator[str]:
    """Yield the functions of each kind of lamp, and those of any lamp, which call the ones of its kind."""
    profiles = [each.shaping.profile for each in rig.emissions if each.shaping and each.shaping.profile]
    steps = max((each.steps for each in profiles), default=0)
    if profiles or rig.pictures:
        yield "uniform highp sampler2D rig_tables;"
    if rig.shadowed:
        yield from _traced(shadow_operations(), "lamp", {"passed": (_PASSED, {"passed": 3})})
    for kind in rig.kinds:
        functions = lamp_operations(kind, shaped=rig.shaped, falling=rig.falling, steps=steps)
        if kind == "picture":
            untextured = functions[0], {**functions[1], "untextured": functions[1]["sent"]}
            yield from _traced(untextured, kind, {"weight": _LAMP["weight"], "untextured": _LAMP["sent"]})
            yield from _traced(part_operations(), kind, _PICTURE)
            yield from _pictured(len(rig.pictures))
        else:
            yield from _traced(functions, kind, _LAMP)
    for name, (head, _) in _LAMP.items():
        if rig.lamps:
            yield f"void lamp_{name}({head}) {{"
            yield "    int kind = int(rig_field(light, LAMP_kind));"
            given = ", ".join(each.split()[-1] for each in head.split(", "))
            for number, kind in enumerate(rig.kinds):
                test = f"if (kind == {list(SHAPES).index(kind)}) " if number + 1 < len(rig.kinds) else ""
                yield f"    {'else ' if number else ''}{test}{kind}_{name}({given});"
            yield "}"


def _traced(functions: Functions, of: str, heads: Mapping[str, tuple[str, Mapping[str, int]]]) -> Iterator[str]:
    """Yield functions ``<of>_<name>``, which set their results one after the other."""
    operations = [replace(each, name=f"lamp_{each.name}") if each.name in FIELDS else each for each in functions[0]]
    for name, (head, widths) in heads.items():
        left = iter(functions[1][name])
        outputs = {each: tuple(next(left) for _ in range(width)) for each, width in widths.items()}
        yield from _function(_Function(operations, outputs), f"{of}_{name}({head})", tuple(widths))


def _pictured(count: int) -> Iterator[str]:
    """Yield the functions of pictures, and their textures."""
    text = (files("lookdev") / "shaders" / "picture.glsl").read_text(encoding="utf-8")
    yield from (f"uniform highp sampler2D picture{k};" for k in range(count))
    for line in text.splitlines():
        if line != "//@ textures":
            yield line
            continue
        yield "vec3 picture_texel(int number, vec2 place) {"
        yield from (f"    if (number == {k}) return picture_look_up(picture{k}, place);" for k in range(count))
        yield "    return vec3(1.0);"
        yield "}"


def _function(program: _Function, head: str, outputs: Sequence[str]) -> Iterator[str]:
    """Yield the lines of a function of a lamp, which reads the numbers of its row."""
    first, *rest = function_text(program, head, outputs)
    read = set(re.findall(r"\blamp_(\w+)", "\n".join(rest)))
    yield first
    yield from (f"    float lamp_{name} = rig_field(light, LAMP_{name});" for name in FIELDS if name in read)
    # Its only table is that of the rig: a look has its own.
    yield from (line.replace("(look_table0,", "(rig_tables,") for line in rest)


def _dome_functions(domes: Sequence[Light]) -> Iterator[str]:
    """Yield the samplers of domes, and functions that read those of the dome of a number, and of local domes."""
    if not domes:
        return
    if any(not each.far for each in domes):
        yield from _traced(ball_operations(), "ball", _BALL)
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
