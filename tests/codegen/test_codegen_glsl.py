"""Generated GLSL in headless Chromium against the models in float64, over the oracles' cases."""

from __future__ import annotations

import base64
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lookdev.brdf import CONTINUOUS, sample
from lookdev.checks.evaluate import Batch, batches_of, evaluate_numpy, point_table
from lookdev.codegen.glsl.functions import PRELUDE, Functions, point_functions, table_texels
from lookdev.codegen.points import point_columns

pytest.importorskip("selenium", reason="selenium is not installed: pip install -e '.[test]'")

from selenium import webdriver

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
pytestmark = [
    pytest.mark.alike,
    pytest.mark.skipif(
        not (CHROMIUM and DRIVER), reason="no Chromium with its driver: apt-get install chromium chromium-driver"
    ),
]

ORACLES = [path for path in sorted((Path(__file__).parents[1] / "oracles").glob("*.jsonl")) if path.stem != "fresnel"]
WIDTH = 256  # texels of a row of points, and pixels of the picture

SHADER = """#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
uniform sampler2D points;
out vec4 result;
int cell;
float column(int k) {{
    int place = cell + k / 4;
    vec4 texel = texelFetch(points, ivec2(place % {width}, place / {width}), 0);
    return texel[k % 4];
}}
float u1 = {u1}, u2 = {u2};
{declared}
{prelude}
{functions}
void main() {{
    cell = (int(gl_FragCoord.x) + {width} * int(gl_FragCoord.y)) * {cells};
{read}
    if ({two_sided} && wo_z < 0.0) {{
        wo_x = -wo_x; wo_y = -wo_y; wo_z = -wo_z;
        wi_x = -wi_x; wi_y = -wi_y; wi_z = -wi_z;
    }}
    result = vec4(0.0);
    if (wo_z > 0.0 && ({transmits} ? wi_z != 0.0 : wi_z > 0.0)) {{
        {call}
    }}
}}
"""

SCRIPT = """
const [fragment, points, tables, width, height, done] = arguments;
const numbers = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
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
    [["points", gl.RGBA, gl.RGBA32F, points], ...tables.map((each, k) => [`look_table${k}`, gl.RED, gl.R32F, each])]
        .forEach(([name, format, internal, [size, text]], unit) => {
            gl.activeTexture(gl.TEXTURE0 + unit);
            texture(format, internal, size, numbers(text));
            gl.uniform1i(gl.getUniformLocation(program, name), unit);
        });
    gl.activeTexture(gl.TEXTURE8);
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

Floats = NDArray[np.float64]


@pytest.fixture(scope="module")
def browser() -> Iterator[webdriver.Chrome]:
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    # Without a GPU, WebGL is SwiftShader's.
    for flag in ("headless=new", "no-sandbox", "disable-dev-shm-usage", "use-angle=swiftshader"):
        options.add_argument(f"--{flag}")
    options.add_argument("--enable-unsafe-swiftshader")
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(str(DRIVER)))
    driver.set_script_timeout(120)
    yield driver
    driver.quit()


EVALUATE = "vec3 f; float pdf; look_evaluate(f, pdf); result = vec4(f / abs(wi_z), pdf);"
DRAW = "vec3 wi; look_draw(wi); result = vec4(wi, 0.0);"
U = (0.3125, 0.71875)


def run_glsl(browser: webdriver.Chrome, batch: Batch, call: str) -> Floats:
    """Return what a call of the functions sets in the browser, (n, 4)."""
    functions, columns = point_functions(batch.layers), point_columns(batch.layers)
    cells = -(-len(columns) // 4)
    table = point_table(batch)
    count = len(table)
    height = -(-count // WIDTH)
    texels = np.zeros((height * cells, WIDTH, 4), np.float32)
    padded = np.zeros((count, 4 * cells), np.float32)
    padded[:, : len(columns)] = table
    texels.reshape(-1, 4)[: count * cells] = padded.reshape(-1, 4)
    fragment = SHADER.format(
        width=WIDTH,
        cells=cells,
        declared="\n".join([*_samplers(functions), *(f"float {name};" for name in columns)]),
        prelude=PRELUDE,
        functions=functions.text,
        read="\n".join(f"    {name} = column({k});" for k, name in enumerate(columns)),
        call=call,
        u1=U[0],
        u2=U[1],
        two_sided=str(functions.two_sided).lower(),
        transmits=str(functions.transmits).lower(),
    )
    tables = [_texture(table_texels(each)) for each in functions.tables]
    found = browser.execute_async_script(SCRIPT, fragment, _texture(texels), tables, WIDTH, height)
    assert isinstance(found, list), f"{found}\n{fragment}"
    return np.array([float(each) for each in found]).reshape(-1, 4)[:count]


def _samplers(functions: Functions) -> list[str]:
    return [f"uniform sampler2D look_table{number};" for number in range(len(functions.tables))]


def _texture(texels: NDArray[np.float32]) -> tuple[tuple[int, int], str]:
    return (texels.shape[1], texels.shape[0]), base64.b64encode(texels.tobytes()).decode("ascii")


@pytest.mark.parametrize("oracle", ORACLES, ids=lambda path: path.stem)
def test_glsl_agrees_with_the_models(oracle: Path, browser: webdriver.Chrome) -> None:
    """Relative to f, and where it is small to the thousandth part of the largest: 2e-4 in 99 % of the channels."""
    models: dict[str, list[Any]] = {}
    for line in oracle.read_text().splitlines():
        models.setdefault(json.loads(line)["model"], []).append(line)
    for model, lines in models.items():
        differences = []
        for batch in batches_of(lines):
            rounded = batch.rounded()
            f, density = evaluate_numpy(rounded)
            expected = np.concatenate([f, density[:, None]], axis=-1)
            found = run_glsl(browser, rounded, EVALUATE)
            differences.append((np.abs(found - expected) / np.maximum(np.abs(expected), 1e-3)).ravel())
        together = np.concatenate(differences)
        assert np.isfinite(together).all(), model
        assert np.quantile(together, 0.99) < 2e-4, (model, np.quantile(together, [0.5, 0.9, 0.99, 1.0]))


def test_directions_are_drawn_as_by_the_models(browser: webdriver.Chrome) -> None:
    """For reflecting models seen from above; where float32 chooses another lobe, another direction."""
    lines = [line for path in ORACLES if path.stem in ("disney", "classic") for line in path.read_text().splitlines()]
    differences = []
    for batch in batches_of(lines):
        above = np.flatnonzero((batch.wo[:, 2] > 0.0) & (batch.wi[:, 2] > 0.0))
        rounded = batch.rounded()
        drawn = sample(rounded.bsdf(), rounded.wo, np.tile(U, (len(rounded.wo), 1)))
        differences.append(np.abs(run_glsl(browser, rounded, DRAW)[:, :3] - drawn)[above].max(axis=-1))
    together = np.concatenate(differences)
    assert len(together) > 500
    assert np.quantile(together, 0.99) < 2e-4


def test_every_continuous_model_has_cases() -> None:
    known = {json.loads(line)["model"] for path in ORACLES for line in path.read_text().splitlines()}
    assert set(CONTINUOUS) <= known
