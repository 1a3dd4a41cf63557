"""Write a look as functions of GLSL ES 3.00, for the designer's and the explorer's pages in the browser.

The functions look up the look's images, evaluate its mask expressions and its stack of layers, and compute the shading
frame. A live constant, one that the user edits, is a uniform of GLSL: its value changes without compiling again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from lookdev.codegen.glsl.functions import function_lines
from lookdev.codegen.program.look import LivePredicate, generate_program, live_numbers
from lookdev.codegen.source import ImageBinding, ProgramSource
from lookdev.material import Bump, Look, Texture

# The GLSL type of a mesh attribute, by `AttributeBinding.kind`.
_TYPES = {"uv": "vec2", "float": "float", "color": "vec3", "vector": "vec3"}
# Declarations of the globals that the functions read (`LookFunctions`).
_DIRECTIONS = "float wo_x, wo_y, wo_z, wi_x, wi_y, wi_z, u1, u2, inside, hand;"
_MESH = "vec3 mesh_normal, mesh_tangent, mesh_facet, viewer;"

TEXTURE_FUNCTIONS = """
// Bilinear filter, row 0 at the top, with the wrap modes of UsdUVTexture; in mode black, texels outside are 0.
ivec2 look_texel(float place, float size, int wrap) {
    bool there = wrap != 3 || (place >= 0.0 && place < size);
    if (wrap == 0) place -= size * floor(place / size);
    if (wrap == 1) { place -= 2.0 * size * floor(place / (2.0 * size)); place = min(place, 2.0 * size - 1.0 - place); }
    return ivec2(int(clamp(place, 0.0, size - 1.0)), there ? 1 : 0);
}
vec4 look_bilinear(highp sampler2D image, vec2 st, int wrap_s, int wrap_t) {
    vec2 size = vec2(textureSize(image, 0)), place = vec2(st.x, 1.0 - st.y) * size - 0.5, corner = floor(place);
    vec4 total = vec4(0.0);
    for (int dy = 0; dy < 2; dy++) for (int dx = 0; dx < 2; dx++) {
        vec2 at = corner + vec2(dx, dy), weight = 1.0 - abs(place - at);
        ivec2 column = look_texel(at.x, size.x, wrap_s), row = look_texel(at.y, size.y, wrap_t);
        if (column.y * row.y == 1) total += weight.x * weight.y * texelFetch(image, ivec2(column.x, row.x), 0);
    }
    return total;
}
float look_slope(float place, int wrap) {
    if (wrap == 1) return mod(floor(place), 2.0) == 1.0 ? -1.0 : 1.0;
    return wrap == 2 && (place < 0.0 || place > 1.0) ? 0.0 : 1.0;
}
"""
"""The functions that `look_read` calls. A shader contains this text once, before the functions of its looks."""

# The numbers of UsdUVTexture's wrap modes in `TEXTURE_FUNCTIONS`.
_WRAPS = {"repeat": 0, "mirror": 1, "clamp": 2, "black": 3}


@dataclass(frozen=True)
class LookFunctions:
    """The GLSL text of a look's functions, and the values that they read.

    In a shader, `functions.PRELUDE` and `TEXTURE_FUNCTIONS` precede `text`. `program` is the look's program, from which
    the functions are written.

    The shader first sets these globals:

    - for each mesh attribute that the look reads, the global named `AttributeBinding.parameter`;
    - ``mesh_normal``, ``mesh_tangent``, ``mesh_facet`` (the triangle's normal) and ``viewer`` (the direction to the
      viewer), vectors in world space;
    - ``hand``, the handedness of the mesh's frame, 1 or -1: the argument `hand` of `shading_frame`.

    It then calls ``look_read`` and ``look_frame``. Before it calls the other functions, it sets the directions ``wo_x``
    to ``wi_z``, in the shading frame and above its horizon, the random numbers ``u1`` and ``u2``, and ``inside``, above
    0 where the viewer is inside the solid.

    ``look_read()``
        Looks up the images, at the coordinates in the attributes.
    ``look_frame(tangent, bitangent, normal, facet)``
        Sets the axes of the shading frame and the facet's normal, in world space.
    ``look_evaluate(value, pdf)``
        Sets the BSDF times the cosine, and the density with which ``look_draw`` draws ``wi``.
    ``look_draw(wi)``
        Draws a direction in the shading frame by ``u1`` and ``u2``.
    ``look_presence(presence)``
        Sets the presence. This function exists if `program` is `see_through`.
    ``look_delta<k>(direction, factor)``
        Sets the direction of delta lobe `k`, and the factor of light from there. The direction's z is 0 where the lobe
        does not scatter.

    `numbers` has the values of the uniforms that are live constants, by name; each is a ``float`` or a ``vec3``. The
    image of look-up ``<name>`` is the uniform ``sampler2D look_<name>`` (RGBA32F). If the image has UDIM tiles, each
    tile is a uniform ``sampler2D look_<name>_<tile>``. Table `k` of the program is ``sampler2D look_table<k>`` (R32F),
    in rows of `functions.TABLE_WIDTH` numbers.
    """

    text: str
    numbers: Mapping[str, tuple[float, ...]]
    program: ProgramSource


def look_functions(
    look: Look, resolve: Callable[[Texture | Bump], Path], live: LivePredicate, *, split: bool = False
) -> LookFunctions:
    """Return the functions of a look; its `live` constants are uniforms of GLSL.

    `resolve` and `live` are those of `generate_program`. With `split`, the function for evaluation is
    ``look_evaluate(value, pdf, diffuse)``; ``diffuse`` is the part of ``value`` from diffuse lobes.

    Raises
    ------
    TextureError
        An image is missing or unreadable.
    """
    program = generate_program(look, resolve, live=live)
    symbols_read = {operation.name.partition("[")[0] for operation in program.operations if operation.op == "symbol"}
    numbers = {name: values for name, values in live_numbers(look, live).items() if name in symbols_read}
    lines = [_DIRECTIONS, _MESH]
    lines += [f"uniform {'vec3' if len(values) == 3 else 'float'} {name};" for name, values in numbers.items()]
    lines += [f"uniform highp sampler2D look_table{number};" for number in range(len(program.tables))]
    mesh_variables = {"shading_tangent"}  # its value is the global `mesh_tangent`
    bindings = [binding for binding in program.attributes if binding.parameter not in mesh_variables]
    lines += [f"{_TYPES[binding.kind]} {binding.parameter};" for binding in bindings]
    for look_up in program.look_ups:
        lines += [f"vec3 {look_up.name}; float {look_up.name}_a;"]
        lines += [f"uniform highp sampler2D {_sampler_name(look_up, tile)};" for tile in look_up.files]
    look_up_lines = (f"    {line}" for look_up in program.look_ups for line in _look_up_lines(look_up))
    lines += ["void look_read() {", *look_up_lines, "}"]
    frame = "out vec3 tangent, out vec3 bitangent, out vec3 normal, out vec3 facet"
    lines += function_lines(program, f"look_frame({frame})")
    lines += function_lines(program, f"look_evaluate(out vec3 value, out float pdf{', out vec3 diffuse' * split})")
    lines += function_lines(program, "look_draw(out vec3 wi)")
    for number in range(program.deltas):
        delta = program.outputs[f"delta{number}"]  # direction, factor, group
        delta_program = replace(program, outputs={"direction": delta[:3], "factor": delta[3:6]})
        lines += function_lines(delta_program, f"look_delta{number}(out vec3 direction, out vec3 factor)")
    if program.see_through:
        lines += function_lines(program, "look_presence(out float presence)")
    return LookFunctions("\n".join(lines) + "\n", numbers, program)


def _sampler_name(look_up: ImageBinding, tile: int) -> str:
    """Return the name of the sampler of a look-up's image; `tile` is the number of a UDIM tile, or 0."""
    return f"look_{look_up.name}_{tile}" if tile else f"look_{look_up.name}"


def _look_up_lines(look_up: ImageBinding) -> Iterator[str]:
    """Yield the lines that read the image of a look-up, and set its variables ``<name>`` and ``<name>_a``."""
    # The constructor mat3x2 takes columns, while `transform` has rows.
    m = ", ".join(repr(look_up.transform[k]) for k in (0, 3, 1, 4, 2, 5))
    wraps = f"{_WRAPS[look_up.wrap_s]}, {_WRAPS[look_up.wrap_t]}"
    yield "{"
    yield f"    vec2 st = mat3x2({m}) * vec3({look_up.uv}, 1.0);"
    if 0 in look_up.files:
        yield f"    vec4 texel = look_bilinear({_sampler_name(look_up, 0)}, st, {wraps});"
        if look_up.slopes:
            s, t = _WRAPS[look_up.wrap_s], _WRAPS[look_up.wrap_t]
            yield f"    texel.xy *= vec2(look_slope(st.x, {s}), look_slope(st.y, {t}));"
    else:
        # Tile 1001 + i + 10 j has s in [i, i + 1) and t in [j, j + 1). Its wrap mode is clamp, number 2.
        yield "    vec2 tile = floor(st); vec4 texel = vec4(0.0);"
        for number in look_up.files:
            i, j = (number - 1001) % 10, (number - 1001) // 10
            in_tile = f"tile == vec2({i}.0, {j}.0)"
            yield f"    if ({in_tile}) texel = look_bilinear({_sampler_name(look_up, number)}, st - tile, 2, 2);"
    yield f"    {look_up.name} = texel.rgb; {look_up.name}_a = texel.a;"
    yield "}"
