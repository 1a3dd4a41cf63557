"""Fragment shaders in headless Chromium: a page draws pictures, whose pixels are points, and returns their values."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lookdev.arrays import Floats, Floats32

WIDTH = 256  # texels of a row of points, and pixels of the picture


POINTS = f"""#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
uniform sampler2D points;
out vec4 result;
int cell;
float column(int k) {{
    int place = cell + k / 4;
    vec4 texel = texelFetch(points, ivec2(place % {WIDTH}, place / {WIDTH}), 0);
    return texel[k % 4];
}}
"""
"""The head of a shader whose pixels are points: `column` reads the point's row of a table, from `cell` on."""


@dataclass(frozen=True)
class Picture:
    """A shader, the rows of its table (n, columns), textures (h, w) or (h, w, 4) by their samplers, and uniforms."""

    fragment: str
    table: Floats
    textures: Mapping[str, Floats32] = field(default_factory=dict)
    numbers: Mapping[str, Sequence[float]] = field(default_factory=dict)


def read_columns(names: Mapping[str, int], columns: int) -> str:
    """Return the code that finds a pixel's row of a table, and sets variables to columns, by the columns' numbers."""
    lines = [f"cell = (int(gl_FragCoord.x) + {WIDTH} * int(gl_FragCoord.y)) * {-(-columns // 4)};"]
    return "\n".join([*lines, *(f"{name} = column({k});" for name, k in names.items())])


SCRIPT = """
const [pictures, texels, done] = arguments;
const decode = async (text) =>
  new Float32Array(await (await fetch(`data:application/octet-stream;base64,${text}`)).arrayBuffer());
const encoded = (floats) => {
  const bytes = new Uint8Array(floats.buffer), parts = [];
  for (let k = 0; k < bytes.length; k += 8192) parts.push(String.fromCharCode(...bytes.subarray(k, k + 8192)));
  return btoa(parts.join(""));
};
const gl = document.createElement("canvas").getContext("webgl2");
gl.getExtension("EXT_color_buffer_float");
gl.getExtension("KHR_parallel_shader_compile");
const vertex = `#version 300 es
  void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;
const link = ({fragment}) => {
  const program = gl.createProgram();
  for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  return program;
};
const floats = (width, height) => {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, width, height);
  return texture;
};
const draw = ({textures, numbers, width, height}, program) => {
  if (!gl.getProgramParameter(program, gl.LINK_STATUS))
    throw new Error([...gl.getAttachedShaders(program).map((each) => gl.getShaderInfoLog(each)),
                     gl.getProgramInfoLog(program)].join("\\n"));
  gl.useProgram(program);
  textures.forEach(([name, channels, [across, along], place], unit) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
    const [format, internal] = channels == 1 ? [gl.RED, gl.R32F] : [gl.RGBA, gl.RGBA32F];
    gl.texImage2D(gl.TEXTURE_2D, 0, internal, across, along, 0, format, gl.FLOAT, decoded[place]);
    gl.uniform1i(gl.getUniformLocation(program, name), unit);
  });
  for (const [name, values] of Object.entries(numbers))
    gl[`uniform${values.length}fv`](gl.getUniformLocation(program, name), values);
  gl.activeTexture(gl.TEXTURE15);
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, floats(width, height), 0);
  gl.viewport(0, 0, width, height);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const pixels = new Float32Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, pixels);
  gl.deleteProgram(program);
  return encoded(pixels);
};
let decoded = [], number = 0;
const drawn = async () => {
  const programs = pictures.map(link);
  decoded = await Promise.all(texels.map(decode));
  return pictures.map((picture, k) => { number = k; return draw(picture, programs[k]); });
};
drawn().catch((error) => [number, String(error)]).then((found) => {
  gl.getExtension("WEBGL_lose_context").loseContext();
  done(found);
});
"""


def draw_pictures(browser: Any, pictures: Sequence[Picture]) -> list[Floats]:
    """Return the results of each shader at the rows of its table, (n, 4); the shaders compile in parallel."""
    texels: dict[str, int] = {}  # indices by content, since tables of measured data are large and shared

    def texture(name: str, values: Floats32) -> tuple[str, int, tuple[int, int], int]:
        data = base64.b64encode(np.ascontiguousarray(values, np.float32).tobytes()).decode("ascii")
        index = texels.setdefault(data, len(texels))
        return name, 1 if values.ndim == 2 else 4, (values.shape[1], values.shape[0]), index

    sent = [
        {
            "fragment": picture.fragment,
            "textures": [
                texture(*texture_values)
                for texture_values in ({"points": _rows(picture.table)} | {**picture.textures}).items()
            ],
            "numbers": {name: list(values) for name, values in picture.numbers.items()},
            "width": WIDTH,
            "height": -(-len(picture.table) // WIDTH),
        }
        for picture in pictures
    ]
    results = browser.execute_async_script(SCRIPT, sent, list(texels))
    assert all(isinstance(text, str) for text in results), f"{results[1]}\n{pictures[results[0]].fragment}"
    decoded = [np.frombuffer(base64.b64decode(text), np.float32).reshape(-1, 4).astype(float) for text in results]
    return [values[: len(picture.table)] for values, picture in zip(decoded, pictures, strict=True)]


def _rows(table: Floats) -> Floats32:
    count, columns = table.shape
    cells, height = -(-columns // 4), -(-count // WIDTH)
    texels = np.zeros((height * cells, WIDTH, 4), np.float32)
    texels.reshape(-1, 4)[: count * cells].reshape(count, -1)[:, :columns] = table
    return texels
