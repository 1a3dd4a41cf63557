"""The lights of a scene as functions of GLSL ES 3.00: a dome, or a rig of lamps and domes.

Lamps are rows of numbers, and functions traced from `lookdev.light`, as in OSL and for Mitsuba. Domes are sampled with
the tables that the renderer reads.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from lookdev.arrays import Floats32
from lookdev.codegen.glsl.functions import function_lines
from lookdev.codegen.program.lamps import (
    FunctionOperations,
    ball_operations,
    lamp_operations,
    part_operations,
    shadow_operations,
)
from lookdev.codegen.program.writer import ProgramWriter
from lookdev.codegen.templates import expand_template
from lookdev.light import Dome, Light, RectLight, RigOrigin
from lookdev.light.dome import bins
from lookdev.light.lamps import FIELDS, SHAPES, CodedRig
from lookdev.light.picture import LEVELS

RIG_WIDTH = 2048
"""Numbers in a row of the texture with a rig's numbers, R32F: they continue from row to row."""

_P, _W = "int light, vec3 p", "vec3 w"
_PART = "float part_s, float part_t, float size"
_SAMPLE_OUTPUTS = "out vec3 w, out float distance, out float pdf"
_SHADOW = {"passed": "int light, float distance, out vec3 passed"}
_BALL = {
    "share": f"{_P}, out float share",
    "meet": f"{_P}, {_W}, out float within, out float distance, out float around",
    "draw": f"{_P}, vec3 onto, out vec3 w",
}
_PICTURE = {
    "angle": f"{_P}, {_PART}, out float angle",
    "place": f"{_P}, {_W}, out float distance, out float s, out float t",
    "density": f"{_P}, {_W}, {_PART}, out float pdf",
    "part": f"{_P}, {_PART}, float u1, float u2, {_SAMPLE_OUTPUTS}",
}
_LAMP = {
    "weight": f"{_P}, vec3 n, out float weight",
    "meet": f"{_P}, {_W}, out float distance, out float pdf",
    "draw": f"{_P}, float u1, float u2, {_SAMPLE_OUTPUTS}",
    "sent": f"{_P}, {_W}, out vec3 sent",
}
"""Parameters of GLSL functions, by name; the ``out`` parameters are the numbers of a traced result, in order."""

_FIELD = "lamp_{}"
"""The name of the GLSL variable that has a field of a lamp's row."""


@dataclass(frozen=True)
class RigFunctions:
    """The text of a rig's functions, after `functions.PRELUDE`, and the values that they read.

    The caller first calls ``rig_meet_surface``, which sets the globals ``rig_place``, the shading point, and the
    shading frame.

    ``rig_arriving``
        Returns the light from a direction, divided by the density with which all strategies together draw the
        direction.
    ``rig_draw``
        Draws a direction, and returns the light from there.
    ``rig_meet_occluders``, ``rig_passed``
        Exist if ``SHADOWS`` is 1. The first finds the occluders in a direction, by a function that is not part of the
        text, ``float occluder_distance(vec3 w, float reach, int spared, bool any)``. The second returns the share of a
        light that passes them.

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

    A rig is `split` if a light has factors for diffuse and specular light. A rig is `plain` if every occluder blocks
    all of every light.
    """

    text: str
    numbers: Floats32
    domes: tuple[Dome | None, ...]
    pictures: tuple[RectLight, ...] = ()
    tables: Floats32 | None = None
    split: bool = False
    plain: bool = True


def rig_functions(
    lights: Sequence[Light], lights_by_slot: Sequence[Sequence[int]], origin: RigOrigin, groups: Sequence[int] = ()
) -> RigFunctions:
    """Return the functions of lights.

    For each slot, `lights_by_slot` has the numbers of the lights that illuminate it, and `groups` has its shadow group.
    """
    rig = CodedRig.from_lights(lights)
    domes = tuple(None if light.constant else light.map_dome for light in rig.domes)
    numbers = [rig.rows(origin).astype(np.float64)]
    bin_starts = []
    for dome in domes:
        bin_starts.append(sum(map(len, numbers)))
        if dome is not None:
            assert dome.bins_file is not None, "it is sampled"
            numbers.append(np.load(dome.bins_file.path).astype(np.float64).ravel())
    # For each slot, and each light in the rig's order: 1 if the light illuminates the slot, else 0.
    marks_start = sum(map(len, numbers))
    rig_order = [next(k for k, light in enumerate(lights) if light is coded) for coded in (*rig.lamps, *rig.domes)]
    numbers.append(
        np.array(
            [[number in slot_lights for number in rig_order] for slot_lights in lights_by_slot], np.float64
        ).ravel()
    )
    # For each set of groups that a shadow link excludes, and each slot: 1 if the slot casts a shadow, else 0.
    casting_start = sum(map(len, numbers))
    groups = groups or [0] * len(lights_by_slot)
    numbers.append(
        np.array([[group not in excluded for group in groups] for excluded in rig.shadow_excluded], np.float64).ravel()
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
        "RIG_SPARED": len(rig.shadow_excluded),
        "RIG_SEEN": int(any(light.emission.camera for light in rig.lamps)),
        "RIG_SHADOWED": int(rig.needs("shadowed")),
        "RIG_SPLIT": int(rig.needs("split")),
        "PICTURE_LEVELS": LEVELS,
        "RIG_NEAREST": int(is_near or rig.needs("shadowed")),
        "LAMP_FIELDS": len(FIELDS),
        **{f"LAMP_{name}": number for number, name in enumerate(FIELDS)},
    }
    lines = [f"#define {name} {value}" for name, value in constants.items()]
    if domes:
        lines += [line for line in Dome.table_constants() if "{" not in line]
        lines += [_array("dome_cells", bins.CELLS), _array("dome_first", bins.FIRST), _array("dome_starts", bin_starts)]
        lines += [_array("dome_constant", [int(light.constant) for light in rig.domes])]
        lines += [_array("dome_local", [int(not light.far) for light in rig.domes])]
        lines += expand_template("dome.glsl", {}).splitlines()
    generated = {"lamp_functions": [*_lamp_functions(rig)], "dome_functions": [*_dome_functions(rig.domes)]}
    lines.append(expand_template("rig.glsl", generated))
    return RigFunctions(
        "\n".join(lines),
        np.concatenate(numbers).astype(np.float32),
        domes,
        rig.pictures,
        rig.tables() if rig.needs("profiled") or rig.pictures else None,
        rig.needs("split"),
        plain=not (is_near or rig.needs("shadowed") or rig.shadow_excluded),
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
        yield from _traced_functions(shadow_operations(field=_FIELD), "lamp", _SHADOW)
    for kind in rig.kinds:
        functions = lamp_operations(
            kind, shaped=rig.needs("shaped"), falling=rig.needs("falling"), steps=steps, field=_FIELD
        )
        if kind == "picture":
            untextured = functions[0], {**functions[1], "untextured": functions[1]["sent"]}
            yield from _traced_functions(untextured, kind, {"weight": _LAMP["weight"], "untextured": _LAMP["sent"]})
            yield from _traced_functions(part_operations(field=_FIELD), kind, _PICTURE)
            yield from _picture_functions(len(rig.pictures))
        else:
            yield from _traced_functions(functions, kind, _LAMP)
    for name, parameters in _LAMP.items():
        if rig.lamps:
            yield f"void lamp_{name}({parameters}) {{"
            yield "    int kind = int(rig_field(light, LAMP_kind));"
            arguments = ", ".join(parameter.split()[-1] for parameter in parameters.split(", "))
            for number, kind in enumerate(rig.kinds):
                test = f"if (kind == {list(SHAPES).index(kind)}) " if number + 1 < len(rig.kinds) else ""
                yield f"    {'else ' if number else ''}{test}{kind}_{name}({arguments});"
            yield "}"


def _traced_functions(functions: FunctionOperations, prefix: str, parameters: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of functions ``<prefix>_<name>``, which read the numbers of a lamp's row."""
    operations, results = functions
    for name, signature in parameters.items():
        numbers = iter(results[name])
        outputs = re.findall(r"out (\w+) (\w+)", signature)
        program = ProgramWriter(
            operations, {output: tuple(islice(numbers, 3 if kind == "vec3" else 1)) for kind, output in outputs}
        )
        first, *rest = function_lines(program, f"{prefix}_{name}({signature})")
        fields_read = set(re.findall(r"\blamp_(\w+)", "\n".join(rest)))
        yield first
        yield from (
            f"    float lamp_{field} = rig_field(light, LAMP_{field});" for field in FIELDS if field in fields_read
        )
        # A lamp's only table is that of the rig, whose name differs from those of looks.
        yield from (line.replace("(look_table0,", "(rig_tables,") for line in rest)


def _picture_functions(count: int) -> Iterator[str]:
    """Yield the textures of pictures, and the functions that read them."""
    yield from (f"uniform highp sampler2D picture{k};" for k in range(count))
    textures = (f"    if (number == {k}) return picture_look_up(picture{k}, place);" for k in range(count))
    texel = ["vec3 picture_texel(int number, vec2 place) {", *textures, "    return vec3(1.0);", "}"]
    yield from expand_template("picture.glsl", {"textures": texel}).splitlines()


def _dome_functions(domes: Sequence[Light]) -> Iterator[str]:
    """Yield the samplers of domes, the functions of local domes, and functions that read a dome by its number."""
    if not domes:
        return
    if any(not light.far for light in domes):
        yield from _traced_functions(ball_operations(field=_FIELD), "ball", _BALL)
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
