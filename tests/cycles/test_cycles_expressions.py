"""Mask expressions and sets of tiles as OSL, run inside Cycles in float32, against NumPy."""

import re
from typing import Any

import numpy as np
import OpenEXR
import pytest
from osl_snippets import evaluate
from warm_blender import BlenderProcess

from lookdev.arrays import Floats
from lookdev.codegen.inputs import SymbolicSurface
from lookdev.codegen.osl.block import Block
from lookdev.codegen.osl.inputs import emit_look_up
from lookdev.codegen.templates import expand_template
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import elements_of, symbol
from lookdev.material import Texture
from lookdev.material.expression import parse
from lookdev.material.expression.shaping import FUNCTIONS, OPERATORS
from lookdev.material.textures import linear_texture, sample_texture
from lookdev.material.values import SourceValues

pytestmark = pytest.mark.cycles


# Every function and operator; x and y in [-2, 3], z in [0, 1], a third of them whole numbers or halves.
EXPRESSIONS = [
    "abs(x) + min(x, y) * max(y, z)",
    "atan2(y, abs(x) + 0.1)",  # at its cut the sign of a zero decides, which float32 code does not keep
    "bias(z, 0.3) + gamma(z, 2.2) + contrast(z, 0.8)",
    "boxstep(x, y)",
    "linearstep(x, 0, 2) + smoothstep(y, -1, 1)",
    "gaussstep(x, -1, 2)",
    "floor(x) + ceil(y) + round(x) - trunc(y) + fract(x)",
    "cellnoise(x, y, z)",
    "clamp(x, 0, 1) * invert(z)",
    "sin(x) + cos(y) - tan(z)",
    "exp(x) + log(z) + sqrt(x)",
    "fit(x, -2, 3, 0, 1) + mix(x, y, z) + lerp(y, x, z)",
    "luminance([x, y, z]) + saturate([x, y, z], 0.5)[1]",
    "mod(x, 0.75) + x % y",
    "noise(x * 4) + noise(x * 4, y * 4) + noise(x * 4, y * 4, z * 4)",
    "pow(z, x) + z ^ 2 + x ^ 3 + 2 ^ y",
    "remap(x, 0.5, 0.25, 0.5, smooth)",
    "x / y + z / 0 - 1 / (x - x)",
    "x < y ? x <= 0 : (x > 1) + (y >= 1)",
    "(x == floor(x)) + (y != 1) + (!z) + (x && y) + (x || z)",
    "-x * (y - z) + E - PI",
]


def _points() -> Floats:
    rng = np.random.default_rng(2012)
    points = rng.uniform([-2.0, -2.0, 0.0], [3.0, 3.0, 1.0], (1024, 3))
    points[::3] = np.round(points[::3] * 2.0) / 2.0
    return points.astype(np.float32).astype(np.float64)


def _code(text: str) -> str:
    graph = Graph()
    values = {name: symbol(graph, f"in[{index}]") for index, name in enumerate("xyz")}
    elements = elements_of(parse(text).evaluate(values, dict.fromkeys(values, "float")))
    block = Block("v", indent=1)
    block.prepare(elements)
    (operands,) = [block.expression(element) for element in elements]
    return "\n".join([*block.lines, f"    value = color({operands});"])


def _tiles_code(texture: Texture) -> str:
    inputs = SymbolicSurface(Graph(), lambda source: linear_texture(source))  # type: ignore[arg-type]
    SourceValues(inputs).source_value(texture, color=True)
    lines, bindings = emit_look_up("lookup0", inputs.look_up("lookup0"))
    text = "\n".join(["vector uv_st = vector(in[0], in[1], 0);", *lines, "value = lookup0;"])
    for binding in bindings:
        text = re.sub(rf"\b{binding.parameter}\b", f'"{binding.file.path}"', text)
    return text


@pytest.fixture(scope="module")
def answers(blender: BlenderProcess, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("expressions")
    rng = np.random.default_rng(3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LOOKDEV_CACHE", str(folder / "cache"))
        for tile in (1001, 1002, 1012):
            pixels = rng.random((4, 8, 4)).astype(np.float32)
            OpenEXR.File({}, {"RGBA": pixels}).write(str(folder / f"dirt.{tile}.exr"))
        texture = Texture(folder / "dirt.<UDIM>.exr", "rgb", "raw", transform=(0.5, 0.05, 0.9, -0.05, 0.5, 1.0))
        probes = {f"e{number}": (_points(), _code(text)) for number, text in enumerate(EXPRESSIONS)}
        probes["tiles"] = _points(), _tiles_code(texture)
        _, values = evaluate(blender, probes, expand_template("texture.h", {}))
        return values | {"expected tiles": sample_texture(texture, _points()[:, :2])}


def test_every_function_is_there() -> None:
    used = " ".join(EXPRESSIONS)
    assert all(f"{name}(" in used for name in FUNCTIONS)
    assert all(sign in used for sign in OPERATORS if not sign.isalpha())


@pytest.mark.parametrize("number", range(len(EXPRESSIONS)), ids=EXPRESSIONS)
def test_an_expression_means_the_same_in_float32(answers: dict[str, Any], number: int) -> None:
    values = dict(zip("xyz", _points().T, strict=True))
    expected = parse(EXPRESSIONS[number]).evaluate(values, dict.fromkeys(values, "float"))
    got = answers[f"e{number}"][:, 0]
    assert np.isfinite(got).all()
    np.testing.assert_allclose(got, np.broadcast_to(expected, got.shape), rtol=1e-4, atol=1e-4)


def test_tiles_are_found(answers: dict[str, Any]) -> None:
    expected = answers["expected tiles"]
    # Some places have a tile, some have none.
    assert 0.1 < np.mean(expected.max(axis=-1) > 0.0) < 0.9
    np.testing.assert_allclose(answers["tiles"], expected, atol=2e-5)
