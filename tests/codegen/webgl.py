"""Fragment shaders in headless Chromium: a page draws one picture and hands its numbers back."""

from __future__ import annotations

import base64
import shutil
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("selenium", reason="selenium is not installed: pip install -e '.[test]'")

from selenium import webdriver

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
NEEDS_CHROMIUM = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason="no Chromium with its driver: apt-get install chromium chromium-driver"
)
WIDTH = 256  # texels of a row of points, and pixels of the picture

Floats = NDArray[np.float64]

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
"""The head of a shader whose pixels are points: `column` reads the point's row of a table, from `CELL` on."""


def cell_code(columns: int) -> str:
    """Return what finds a pixel's row of a table."""
    return f"cell = (int(gl_FragCoord.x) + {WIDTH} * int(gl_FragCoord.y)) * {-(-columns // 4)};"


SCRIPT = """
const [fragment, textures, numbers, width, height, done] = arguments;
const decoded = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
const canvas = document.createElement("canvas");
const gl = canvas.getContext("webgl2");
gl.getExtension("EXT_color_buffer_float");
const texture = (format, internal, size, data) => {
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
        gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, internal, size[0], size[1], 0, format, gl.FLOAT, data);
};
const compiled = (type, text) => {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS))
        throw new Error(gl.getShaderInfoLog(shader));
    return shader;
};
try {
    const program = gl.createProgram();
    gl.attachShader(program, compiled(gl.VERTEX_SHADER, `#version 300 es
        void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`));
    gl.attachShader(program, compiled(gl.FRAGMENT_SHADER, fragment));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS))
        throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    textures.forEach(([name, channels, size, text], unit) => {
        gl.activeTexture(gl.TEXTURE0 + unit);
        const [format, internal] = channels == 1 ? [gl.RED, gl.R32F] : [gl.RGBA, gl.RGBA32F];
        texture(format, internal, size, decoded(text));
        gl.uniform1i(gl.getUniformLocation(program, name), unit);
    });
    for (const [name, values] of Object.entries(numbers))
        gl[`uniform${values.length}fv`](gl.getUniformLocation(program, name), values);
    gl.activeTexture(gl.TEXTURE15);
    gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
    const shown = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, shown);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, width, height);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, shown, 0);
    gl.viewport(0, 0, width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const found = new Float32Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, found);
    done(Array.from(found, x => Number.isFinite(x) ? x : String(x)));
} catch (error) {
    done(String(error));
}
"""


def start_browser() -> Iterator[webdriver.Chrome]:
    """Yield Chromium; without a GPU, WebGL is SwiftShader's."""
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for flag in ("headless=new", "no-sandbox", "disable-dev-shm-usage", "use-angle=swiftshader"):
        options.add_argument(f"--{flag}")
    options.add_argument("--enable-unsafe-swiftshader")
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(str(DRIVER)))
    driver.set_script_timeout(120)
    yield driver
    driver.quit()


def at_points(
    browser: webdriver.Chrome,
    fragment: str,
    table: Floats,
    textures: Mapping[str, NDArray[np.float32]],
    numbers: Mapping[str, Sequence[float]] | None = None,
) -> Floats:
    """Return what a shader gives at the rows of a table (n, columns), (n, 4).

    `textures` are (h, w) or (h, w, 4) by their samplers, `numbers` the uniforms.
    """
    count, columns = table.shape
    cells = -(-columns // 4)
    height = -(-count // WIDTH)
    texels = np.zeros((height * cells, WIDTH, 4), np.float32)
    padded = np.zeros((count, 4 * cells), np.float32)
    padded[:, :columns] = table
    texels.reshape(-1, 4)[: count * cells] = padded.reshape(-1, 4)
    sent = [_texture(name, each) for name, each in {"points": texels, **textures}.items()]
    given = {name: list(each) for name, each in (numbers or {}).items()}
    found = browser.execute_async_script(SCRIPT, fragment, sent, given, WIDTH, height)
    assert isinstance(found, list), f"{found}\n{fragment}"
    return np.array([float(each) for each in found]).reshape(-1, 4)[:count]


def _texture(name: str, texels: NDArray[np.float32]) -> tuple[str, int, tuple[int, int], str]:
    data = base64.b64encode(np.ascontiguousarray(texels, np.float32).tobytes()).decode("ascii")
    return name, 1 if texels.ndim == 2 else 4, (texels.shape[1], texels.shape[0]), data
