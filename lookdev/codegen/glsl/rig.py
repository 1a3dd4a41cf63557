"""The lights of a scene as functions of GLSL ES 3.00: a dome, or a rig of lamps and domes.

Lamps are rows of numbers, and functions traced from `lookdev.light`, as in OSL and for Mitsuba. Domes are sampled with
the tables that the renderer reads.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files

import numpy as np

from lookdev.arrays import Floats32
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
"""Numbers in a row of the texture with a rig's numbers, R32F: they continue from row to row."""

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
"""Heads of functions, and the widths of their outputs."""


@dataclass(frozen=True)
class RigFunctions:
    """The text of a rig's functions, after `functions.PRELUDE`, and the values that they read.

    Globals are set before a call: ``rig_place`` and the shading frame, by ``rig_meet_surface``.

    ``rig_arriving``
        Returns the light from a direction, over the density of all strategies that draw it.
    ``rig_draw``
        Draws a direction, and returns the light from there.
    ``rig_meet_occluders``, ``rig_passed``
        Exist if ``SHADOWS`` is 1: find the occluders in a direction, and return the share of a light that passes them.
        The first calls ``float occluder_distance(vec3 w, float reach, int spared, bool any)``, which is not part of the
        text.

    Uniforms are:

    ``vec4 turns``
        Sine and cosine of the rotation of the lights that rotate with the rig, and of that of the other lights.
    ``sampler2D rig_numbers``
        `numbers`, in rows of `RIG_WIDTH`.
    ``dome<k>_map``, ``dome<k>_points`` (RGBA32F), ``isampler2D dome<k>_slots``
        Dome `k` of `domes`, unless this is None: then its radiance is constant.
    ``picture<k>`` (RGBA32F)
        Picture `k` of `pictures`.
    ``sampler2D rig_tables``
        `tables`, those of IES profiles and pictures, if any, in rows of `functions.TABLE_WIDTH`.

    A rig that is `split` has lights with factors for diffuse and specular light. A rig is `plain` if any surface on the
    way occludes all of a light.
    """

    text: str
    numbers: Floats32
    domes: tuple[Dome | None, ...]
    pictures: tuple[RectLight, ...] = ()
    tables: Floats32 | None = None
    split: bool = False
    plain: bool = True


@dataclass(frozen=True)
class _Function:
    """A program with some outputs of another program."""

    operations: Sequence[Operation]
    outputs: Mapping[str, tuple[int, ...]]
    constants: tuple[float, ...] = ()


def rig_functions(
    lights: Sequence[Light], lights_by_slot: Sequence[Sequence[int]], stand: Stand, groups: Sequence[int] = ()
) -> RigFunctions:
    """Return the functions of lights.

    `lights_by_slot` are the numbers of the lights that light each slot, `groups` the shadow groups of the slots.
    """
    rig = CodedRig.of(lights)
    domes = tuple(None if light.constant else light.map_dome for light in rig.domes)
    numbers = [rig.rows(stand).astype(np.float64)]
    bin_starts = []
    for dome in domes:
        bin_starts.append(sum(map(len, numbers)))
        if dome is not None:
            assert dome.bins_file is not None, "it is sampled"
            numbers.append(np.load(dome.bins_file.path).astype(np.float64).ravel())
    marks_start = sum(map(len, numbers))
    order = [next(k for k, light in enumerate(lights) if light is coded) for coded in (*rig.lamps, *rig.domes)]
    numbers.append(
        np.array([[number in slot_lights for number in order] for slot_lights in lights_by_slot], np.float64).ravel()
    )
    casting_start = sum(map(len, numbers))
    groups = groups or [0] * len(lights_by_slot)
    numbers.append(
        np.array([[group not in excluded for group in groups] for excluded in rig.spared], np.float64).ravel()
    )
    is_near = any(not light.far for light in (*rig.lamps, *rig.domes))
    constants = {
        "RIG_LAMPS": len(rig.lamps),
        "RIG_DOMES": len(domes),
        "RIG_LIGHTS": len(lights),
        "RIG_LOCAL_DOMES": int(any(not light.far for light in rig.domes)),
        "RIG_MARKS": marks_start,
        "RIG_CASTING": casting_start,
        "RIG_SLOTS": len(lights_by_slot),
        "RIG_SPARED": len(rig.spared),
        "RIG_SEEN": int(any(light.emission.camera for light in rig.lamps)),
        "RIG_SHADOWED": int(rig.needs("shadowed")),
        "RIG_SPLIT": int(rig.needs("split")),
        "PICTURE_LEVELS": LEVELS,
        "RIG_NEAREST": int(is_near or rig.needs("shadowed")),
        "LAMP_FIELDS": len(FIELDS),
        **{f"LAMP_{name}": number for number, name in enumerate(FIELDS)},
    }
    lines = [f"#define {name} {value}" for name, value in constants.items()]
    shaders = files("lookdev") / "shaders"
    if domes:
        lines += [line for line in Dome.table_constants() if "{" not in line]
        lines += [_array("dome_cells", bins.CELLS), _array("dome_first", bins.FIRST), _array("dome_starts", bin_starts)]
        lines += [_array("dome_constant", [int(light.constant) for light in rig.domes])]
        lines += [_array("dome_local", [int(not light.far) for light in rig.domes])]
        lines += (shaders / "dome.glsl").read_text(encoding="utf-8").splitlines()
    generated = {
        "//@ lamp_functions": lambda: _lamp_functions(rig),
        "//@ dome_functions": lambda: _dome_functions(rig.domes),
    }
    for line in (shaders / "rig.glsl").read_text(encoding="utf-8").splitlines():
        lines += generated[line]() if line in generated else [line]
    return RigFunctions(
        "\n".join(lines) + "\n",
        np.concatenate(numbers).astype(np.float32),
        domes,
        rig.pictures,
        rig.tables() if rig.needs("profiled") or rig.pictures else None,
        rig.needs("split"),
        plain=not (is_near or rig.needs("shadowed") or rig.spared),
    )


def _array(name: str, values: Sequence[int]) -> str:
    return f"const int {name}[{len(values)}] = int[{len(values)}]({', '.join(map(str, values))});"


def _lamp_functions(rig: CodedRig) -> Iterator[str]:
    """Yield the functions of each kind of lamp, and those for all kinds, which call the functions of a lamp's kind."""
    shapings = [emission.shaping for emission in rig.emissions if emission.shaping]
    profiles = [shaping.profile for shaping in shapings if shaping.profile]
    steps = max((profile.steps for profile in profiles), default=0)
    if profiles or rig.pictures:
        yield "uniform highp sampler2D rig_tables;"
    if rig.needs("shadowed"):
        yield from _traced_functions(shadow_operations(), "lamp", {"passed": (_PASSED, {"passed": 3})})
    for kind in rig.kinds:
        functions = lamp_operations(kind, shaped=rig.needs("shaped"), falling=rig.needs("falling"), steps=steps)
        if kind == "picture":
            untextured = functions[0], {**functions[1], "untextured": functions[1]["sent"]}
            yield from _traced_functions(untextured, kind, {"weight": _LAMP["weight"], "untextured": _LAMP["sent"]})
            yield from _traced_functions(part_operations(), kind, _PICTURE)
            yield from _picture_functions(len(rig.pictures))
        else:
            yield from _traced_functions(functions, kind, _LAMP)
    for name, (head, _) in _LAMP.items():
        if rig.lamps:
            yield f"void lamp_{name}({head}) {{"
            yield "    int kind = int(rig_field(light, LAMP_kind));"
            arguments = ", ".join(parameter.split()[-1] for parameter in head.split(", "))
            for number, kind in enumerate(rig.kinds):
                test = f"if (kind == {list(SHAPES).index(kind)}) " if number + 1 < len(rig.kinds) else ""
                yield f"    {'else ' if number else ''}{test}{kind}_{name}({arguments});"
            yield "}"


def _traced_functions(
    functions: Functions, prefix: str, heads: Mapping[str, tuple[str, Mapping[str, int]]]
) -> Iterator[str]:
    """Yield the lines of functions ``<prefix>_<name>``, whose parameters share the outputs in order."""
    operations = [
        replace(operation, name=f"lamp_{operation.name}") if operation.name in FIELDS else operation
        for operation in functions[0]
    ]
    for name, (head, widths) in heads.items():
        remaining = iter(functions[1][name])
        outputs = {output: tuple(next(remaining) for _ in range(width)) for output, width in widths.items()}
        yield from _function(_Function(operations, outputs), f"{prefix}_{name}({head})", tuple(widths))


def _picture_functions(count: int) -> Iterator[str]:
    """Yield the textures of pictures, and the functions that read them."""
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
    # A lamp's only table is that of the rig, whose name differs from those of looks.
    yield from (line.replace("(look_table0,", "(rig_tables,") for line in rest)


def _dome_functions(domes: Sequence[Light]) -> Iterator[str]:
    """Yield the samplers of domes, the functions of local domes, and functions that read a dome by its number."""
    if not domes:
        return
    if any(not light.far for light in domes):
        yield from _traced_functions(ball_operations(), "ball", _BALL)
    textured = [number for number, light in enumerate(domes) if not light.constant]
    for k in textured:
        yield f"uniform highp sampler2D dome{k}_map, dome{k}_points;"
        yield f"uniform highp isampler2D dome{k}_slots;"
    yield "vec3 dome_map(int dome, vec3 w) {"
    yield from (f"    if (dome == {k}) return dome_look_up(dome{k}_map, w);" for k in textured)
    yield "    return vec3(1.0);"
    yield "}"
    yield "vec3 dome_drawn(int dome, int bin, float share, float u1, float u2, out vec3 w, out float ratio) {"
    for k in textured:
        yield f"    if (dome == {k})"
        yield f"        return dome_sample(dome{k}_slots, dome{k}_points, bin, share, u1, u2, w, ratio);"
    yield "    w = vec3(0.0, 0.0, 1.0);"
    yield "    ratio = 0.0;"
    yield "    return vec3(0.0);"
    yield "}"
