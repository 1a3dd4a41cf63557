"""Cycles' nodes compute the same as NumPy for traced expressions, textures and slopes of textures."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from warm_blender import BlenderProcess

from lookdev.brdf.parameters import Parameter
from lookdev.brdf.vectors import dot, mix, mix_color, normalize
from lookdev.codegen.inputs import SymbolicSurface
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.nodes.inputs import bind_inputs
from lookdev.codegen.source import NodeLink, NodeSource, NodeTree
from lookdev.codegen.trace.graph import Graph, Symbol, reachable_nodes
from lookdev.codegen.trace.symbolic import elements_of, symbols
from lookdev.material import Bump, Coordinates, Formula, Texture
from lookdev.material.expression import parse
from lookdev.material.textures import image_file, sample_slopes, sample_texture
from lookdev.material.values import SourceValues

pytestmark = pytest.mark.cycles


SIDE = 32


def stacked(*values: Any) -> Any:
    return np.stack(values, axis=-1)


# Expressions of numbers a and b in (0, 2) and of vectors u and v, away from jumps and without negative values.
EXPRESSIONS: dict[str, Callable[[Any, Any, Any, Any], Any]] = {
    "sums": lambda a, b, u, v: stacked(a + b, a - b + 2.0, 1.0 - 0.3 * a),
    "products": lambda a, b, u, v: stacked(a * b, a / b, a * b + 1.0),
    "roots": lambda a, b, u, v: stacked(np.sqrt(a), 1.0 / np.sqrt(b), a**b),
    "exponentials": lambda a, b, u, v: stacked(np.exp(-a), np.log(a) + 5.0, np.expm1(a)),
    "a small expm1": lambda a, b, u, v: stacked(-1e5 * np.expm1(-1e-5 * a), np.expm1(1e-5 * b) * 1e5, a),
    "angles": lambda a, b, u, v: stacked(np.sin(a) + 1.0, np.cos(b) + 1.0, np.tan(0.5 * a)),
    "the whole circle": lambda a, b, u, v: stacked(np.arctan2(a - 1.0, b - 1.0) + 4.0, np.floor(3.1 * a), a),
    "ends": lambda a, b, u, v: stacked(np.maximum(a, b), np.minimum(a, b), np.abs(a - b)),
    "comparisons": lambda a, b, u, v: stacked(*(np.where(mask, 1.0, 0.0) for mask in (a > b, a < b, a >= 1.01 * b))),
    "more comparisons": lambda a, b, u, v: stacked(
        np.where(a <= 1.01 * b, a, b), np.where(np.floor(2.1 * a) == np.floor(2.1 * b), a, b), np.where(a < 1.0, 2.0, a)
    ),
    "logic": lambda a, b, u, v: stacked(
        np.where((a > 0.7) & (b > 0.3), a, b), np.where((a > 1.5) | (b > 1.1), a, 0.0), np.where(~(a > b), a, 3.0)
    ),
    "blends": lambda a, b, u, v: stacked(mix(a, b, 0.5 * a), mix(1.0, a, 0.5 * b), mix(a, 1.0, 0.5 * b)),
    "vectors": lambda a, b, u, v: u * v + np.maximum(u, v) / v,
    "vectors and numbers": lambda a, b, u, v: u * np.expand_dims(a, -1) + np.abs(u - v) * 0.5,
    "vectors in steps": lambda a, b, u, v: np.floor(2.1 * u) + np.sin(v) + np.minimum(u, 0.5),
    "waves of vectors": lambda a, b, u, v: np.cos(0.5 * u) + np.tan(0.5 * v) + u**v,
    "blended vectors": lambda a, b, u, v: mix_color(u, v, 0.5 * a) + mix(u, v, 0.5 * u),
    "chosen vectors": lambda a, b, u, v: np.where(np.expand_dims(a > b, -1), u, v),
    "directions": lambda a, b, u, v: normalize(u) + np.expand_dims(dot(u, v) * 0.1, -1),
    "parts": lambda a, b, u, v: stacked((u * v)[..., 2], b, normalize(u)[..., 0]),
}


def arguments(x: Any, y: Any) -> tuple[Any, ...]:
    """Return a, b, u and v at a point of the square; they are constant over a pixel, whatever its sample."""
    a, b = ((np.floor((coordinate + 1.0) * (0.5 * SIDE)) + 0.5) * (2.0 / SIDE) for coordinate in (x, y))
    return a, b, stacked(a, b, 0.5 * a + 0.3), stacked(0.5 * b + 0.1, a * 0.9, b)


def source(name: str) -> NodeSource:
    """Return a surface that emits the value of an expression."""
    graph, builder = Graph(), TreeBuilder(name)
    builder.bind([f"place_{i}" for i in range(3)], NodeLink(builder.add("NewGeometry"), "Position"))
    position = symbols(graph, [f"place_{i}" for i in range(3)])
    value = EXPRESSIONS[name](*arguments(position[0], position[1]))
    emission = builder.add("Emission", inputs={"Color": builder.vector(elements_of(value)), "Strength": 1.0})
    builder.add("OutputMaterial", inputs={"Surface": NodeLink(emission, "Emission")})
    return NodeSource(name, (builder.tree(),), (), name, exact=False)


@pytest.fixture(scope="module")
def pictures(blender: BlenderProcess) -> dict[str, Any]:
    results: dict[str, Any] = blender.call("probes.render_trees", {name: source(name) for name in EXPRESSIONS}, SIDE)
    return results


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_cycles_computes_what_numpy_does(name: str, pictures: dict[str, Any]) -> None:
    centres = (np.arange(SIDE) + 0.5) * (2.0 / SIDE) - 1.0
    x, y = np.meshgrid(centres, centres)
    # float32, some operations deep.
    np.testing.assert_allclose(pictures[name], EXPRESSIONS[name](*arguments(x, y)), rtol=1e-5, atol=2e-6)


WRAPS: tuple[Any, ...] = ("black", "clamp", "repeat", "mirror")
# The probe's square reaches from -1 to 1: coordinates from -2.3 to 2.9.
TRANSFORM = (2.0, 0.4, 0.1, -0.4, 2.2, 0.3)
# Light is not negative.
ABOVE = {"scale": (1.0,) * 4, "bias": (2.0,) * 4}
COLOR = Parameter("x", "color", (0.0, 0.0, 0.0), hard=(0.0, 1e3))


def picture(file: Path, seed: int) -> Path:
    pixels = np.random.default_rng(seed).uniform(-1.0, 2.0, (3, 5, 4)).astype(np.float32)
    assert oiio.ImageBuf(pixels).write(str(file))
    return file


def use_positions_as_uv(tree: NodeTree) -> NodeTree:
    """Use positions on the probe's square in place of the UV map, which the square lacks."""
    nodes = []
    for node in tree.nodes:
        inputs = {
            socket: replace(value, socket="Position") if isinstance(value, NodeLink) and value.socket == "UV" else value
            for socket, value in node.inputs.items()
        }
        kind = {"kind": "NewGeometry", "properties": {}} if node.kind == "UVMap" else {}
        nodes.append(replace(node, inputs=inputs, **kind))
    return replace(tree, nodes=tuple(nodes))


def emission_material(source: Any) -> NodeSource:
    """Return a material that emits the value that a look reads."""
    inputs = SymbolicSurface(Graph(), image_file)
    if isinstance(source, Bump):
        x, y, _ = elements_of(SourceValues(inputs)._bump_normal(source) + 20.0)
        value = [x, y, 20.0]
    else:
        value = elements_of(SourceValues(inputs).parameter_value(source, COLOR))
    builder = TreeBuilder("emitting")
    bind_inputs(builder, inputs, [node.name for node in reachable_nodes(value) if isinstance(node, Symbol)])
    light = builder.add("Emission", inputs={"Color": builder.vector(value)})
    builder.add("OutputMaterial", inputs={"Surface": NodeLink(light, "Emission")})
    return NodeSource("emitting", (use_positions_as_uv(builder.tree()),), (), "", False)


@pytest.mark.both_pythons
def test_cycles_looks_up_what_the_reference_does(blender: BlenderProcess, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    file = picture(tmp_path / "picture.exr", 1)
    for seed, tile in enumerate((1001, 1002, 1012)):
        picture(tmp_path / f"set.{tile}.exr", seed)
    textures = {
        f"{s} {t} {channel}": Texture(file, channel, "raw", s, t, "st", TRANSFORM, **ABOVE)
        for s, t in itertools.product(WRAPS, WRAPS)
        for channel in ("rgb", "a")
    }
    textures["as it is"] = Texture(file, "rgb", "raw", **ABOVE)
    textures["tiles"] = Texture(tmp_path / "set.<UDIM>.exr", "rgb", "raw", transform=TRANSFORM, **ABOVE)
    bumps = {
        f"bump {s} {t}": Bump(Texture(file, "g", "raw", s, t, "st", TRANSFORM))
        for s, t in (*((wrap, wrap) for wrap in WRAPS), ("mirror", "clamp"))
    }
    coordinates = Formula(parse("st + 2"), {"st": Coordinates("st")}, {"st": "color"})
    sources = {
        name: emission_material(look_up) for name, look_up in {**textures, **bumps, "place": coordinates}.items()
    }

    pictures = blender.call("probes.render_trees", sources, 32)
    st = pictures["place"][..., :2].astype(np.float64) - 2.0
    # Coordinates of a few units, and values of a few, in float32; slopes between texels of about 10 a unit.
    for name, texture in textures.items():
        expected = sample_texture(texture, st)
        expected = expected[..., None] * np.ones(3) if expected.ndim == 2 else expected
        np.testing.assert_allclose(pictures[name], expected, rtol=0.0, atol=2e-5, err_msg=name)
    m = np.reshape(TRANSFORM, (2, 3))
    image = st @ m[:, :2].T + m[:, 2]
    # Away from the lines where slopes jump, at which the last digit of a coordinate decides.
    clear = (np.abs(image - np.round(image)) > 1e-5).all(axis=-1)
    for name, bump in bumps.items():
        expected = 20.0 - sample_slopes(bump.height, st)
        np.testing.assert_allclose(pictures[name][clear, :2], expected[clear], rtol=0.0, atol=3e-4, err_msg=name)
