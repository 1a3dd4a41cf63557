"""Write the lights of a scene, lamps and domes, as functions of GLSL ES 3.00, for the designer's view in the browser.

Each light is a row of numbers (`lookdev.light.lamps.FIELDS`), which the functions read from a texture. The functions of
lamps are traced from `lookdev.light`, as in OSL and for Mitsuba. Domes are sampled by the same tables as in Cycles.
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
"""The width in texels of the texture that holds a rig's numbers, one per texel (R32F), row after row."""

# The parameters of the GLSL functions, by the functions' names in `program.lamps`, which also describes their results.
# There is a dict for the shadow of a lamp, for a dome with a finite radius ("ball"), for a textured rectangle
# ("picture") and for a lamp of any kind. The ``out`` parameters are the numbers of a traced result, in order. ``light``
# is the number of the light, ``p`` the shading point and ``w`` a direction, both in the light's coordinates.
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

# The name of the GLSL variable that has a field of a lamp's row.
_FIELD = "lamp_{}"


@dataclass(frozen=True)
class RigFunctions:
    """The GLSL text of a rig's functions, and the values that they read.

    In a shader, `functions.PRELUDE` precedes `text`. At each shading point, the shader first calls
    ``rig_meet_surface``, which stores the point, the shading frame and the number of the asset's slot in globals.

    ``rig_arriving``
        Returns the radiance from a direction, summed over the lights. The radiance of each light is divided by the
        density with which the BSDF's and the light's strategies together draw the direction.
    ``rig_draw``
        Draws a direction to a light, and returns the radiance from there.
    ``rig_meet_occluders``
        Finds the occluders in a direction. It exists if the macro ``SHADOWS`` is 1. It calls a function that the shader
        defines, ``float occluder_distance(vec3 w, float reach, int spared, bool any)``. This function returns the
        distance of the nearest occluder within ``reach``, or with ``any`` the distance of an arbitrary one. It ignores
        the slots of set number ``spared`` in `CodedRig.shadow_excluded`.
    ``rig_passed``
        Returns the share of a light that passes the occluders found. It exists if ``SHADOWS`` is 1.

    The text declares these uniforms:

    ``vec4 turns``
        The sine and cosine of the rotation angle of the lights that turn with the rig, then the sine and cosine of the
        rotation angle of the other lights.
    ``sampler2D rig_numbers``
        The texture of `numbers`, in rows of `RIG_WIDTH`.
    ``dome<k>_map``, ``dome<k>_points`` (RGBA32F), ``isampler2D dome<k>_slots``
        The map and the sampling tables of dome `k` of `domes`. In `domes`, a dome of constant radiance is None; it has
        no textures.
    ``picture<k>`` (RGBA32F)
        The texture of rectangle light `k` of `pictures`.
    ``sampler2D rig_tables``
        The texture of `tables`, in rows of `functions.TABLE_WIDTH`: the numbers of IES profiles, and the luminance
        trees of pictures. `tables` is None if there are neither.

    A rig is `split` if a light has factors for its diffuse and specular light. A rig is `plain` if every occluder
    blocks all light of every lamp and dome, at any distance.
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
    """Return the functions of lights that illuminate an asset.

    A slot is a part of the asset with a look of its own. For each slot, `lights_by_slot` has the indices in `lights` of
    the lights that illuminate the slot. `groups` has each slot's shadow group: a light's shadow link excludes whole
    groups. `origin` places the shader's coordinates in the world.
    """
    rig = CodedRig.from_lights(lights)
    domes = tuple(None if light.constant else light.map_dome for light in rig.domes)
    # The contents of `RigFunctions.numbers`, block after block; the constants below are the indices of the blocks.
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
    is_near = any(not light.is_infinitely_far for light in (*rig.lamps, *rig.domes))
    constants = {
        "RIG_LAMPS": len(rig.lamps),
        "RIG_DOMES": len(domes),
        "RIG_LIGHTS": len(lights),
        "RIG_LOCAL_DOMES": int(any(not light.is_infinitely_far for light in rig.domes)),
        "RIG_MARKS": marks_start,
        "RIG_CASTING": casting_start,
        "RIG_SLOTS": len(lights_by_slot),
        "RIG_SPARED": len(rig.shadow_excluded),
        # Whether the camera sees a lamp.
        "RIG_SEEN": int(any(light.emission.camera for light in rig.lamps)),
        "RIG_SHADOWED": int(rig.needs("shadowed")),
        "RIG_SPLIT": int(rig.needs("split")),
        "PICTURE_LEVELS": LEVELS,
        # Whether a shadow depends on the distance of the nearest occluder.
        "RIG_NEAREST": int(is_near or rig.needs("shadowed")),
        "LAMP_FIELDS": len(FIELDS),
        **{f"LAMP_{name}": number for number, name in enumerate(FIELDS)},
    }
    lines = [f"#define {name} {value}" for name, value in constants.items()]
    if domes:
        lines += [line for line in Dome.table_constants() if "{" not in line]
        lines += [_array("dome_cells", bins.CELLS), _array("dome_first", bins.FIRST), _array("dome_starts", bin_starts)]
        lines += [_array("dome_constant", [int(light.constant) for light in rig.domes])]
        lines += [_array("dome_local", [int(not light.is_infinitely_far) for light in rig.domes])]
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
    """Return the GLSL declaration of a constant array."""
    return f"const int {name}[{len(values)}] = int[{len(values)}]({', '.join(map(str, values))});"


def _lamp_functions(rig: CodedRig) -> Iterator[str]:
    """Yield functions for each kind of lamp, such as ``rect_draw``, then those for any lamp, such as ``lamp_draw``.

    A function for any lamp calls the function of the lamp's kind.
    """
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
            # The template `picture.glsl` has the other functions of a picture, which call the traced ones.
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
    """Yield the lines of the functions ``<prefix>_<name>``; `parameters` has their GLSL parameters by name.

    Each function first reads the fields that it needs from the light's row into variables.
    """
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
        # The traced code has one table, number 0. It is the texture `rig_tables`, not the table of a look.
        yield from (line.replace("(look_table0,", "(rig_tables,") for line in rest)


def _picture_functions(count: int) -> Iterator[str]:
    """Yield the samplers of `count` pictures, the textures of rectangle lights, and the functions that read them."""
    yield from (f"uniform highp sampler2D picture{k};" for k in range(count))
    textures = (f"    if (number == {k}) return picture_look_up(picture{k}, place);" for k in range(count))
    texel = ["vec3 picture_texel(int number, vec2 place) {", *textures, "    return vec3(1.0);", "}"]
    yield from expand_template("picture.glsl", {"textures": texel}).splitlines()


def _dome_functions(domes: Sequence[Light]) -> Iterator[str]:
    """Yield the samplers of domes, and the functions of domes with a finite radius.

    Then yield two functions that take the number of a dome: ``dome_map`` looks up the dome's map, and ``dome_drawn``
    draws a direction.
    """
    if not domes:
        return
    if any(not light.is_infinitely_far for light in domes):
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
