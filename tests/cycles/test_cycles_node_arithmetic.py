"""What Cycles' nodes compute of a traced expression is what NumPy computes of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scripts import tree_pictures

from lookdev.brdf.vectors import dot, mix, mix_color, normalize
from lookdev.codegen import Link, NodeSource
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import elements_of, symbols

pytestmark = pytest.mark.cycles

SIDE = 32


def stacked(*values: Any) -> Any:
    return np.stack(values, axis=-1)


# Of numbers a and b in (0, 2), and of vectors u and v; nowhere near a jump, and nothing negative.
EXPRESSIONS: dict[str, Callable[[Any, Any, Any, Any], Any]] = {
    "sums": lambda a, b, u, v: stacked(a + b, a - b + 2.0, 1.0 - 0.3 * a),
    "products": lambda a, b, u, v: stacked(a * b, a / b, a * b + 1.0),
    "roots": lambda a, b, u, v: stacked(np.sqrt(a), 1.0 / np.sqrt(b), a**b),
    "exponentials": lambda a, b, u, v: stacked(np.exp(-a), np.log(a) + 5.0, np.expm1(a)),
    "a small expm1": lambda a, b, u, v: stacked(-1e5 * np.expm1(-1e-5 * a), np.expm1(1e-5 * b) * 1e5, a),
    "angles": lambda a, b, u, v: stacked(np.sin(a) + 1.0, np.cos(b) + 1.0, np.tan(0.5 * a)),
    "the whole circle": lambda a, b, u, v: stacked(np.arctan2(a - 1.0, b - 1.0) + 4.0, np.floor(3.1 * a), a),
    "ends": lambda a, b, u, v: stacked(np.maximum(a, b), np.minimum(a, b), np.abs(a - b)),
    "comparisons": lambda a, b, u, v: stacked(*(np.where(each, 1.0, 0.0) for each in (a > b, a < b, a >= 1.01 * b))),
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
    """Return a, b, u and v at a place of the square: constant over a pixel, wherever in it the sample is."""
    a, b = ((np.floor((place + 1.0) * (0.5 * SIDE)) + 0.5) * (2.0 / SIDE) for place in (x, y))
    return a, b, stacked(a, b, 0.5 * a + 0.3), stacked(0.5 * b + 0.1, a * 0.9, b)


def source(name: str) -> NodeSource:
    """Return a surface that shines by an expression."""
    graph, builder = Graph(), TreeBuilder(name)
    builder.bind([f"place_{i}" for i in range(3)], Link(builder.add("NewGeometry"), "Position"))
    place = symbols(graph, [f"place_{i}" for i in range(3)])
    value = EXPRESSIONS[name](*arguments(place[0], place[1]))
    emission = builder.add("Emission", inputs={"Color": builder.vector(elements_of(value)), "Strength": 1.0})
    builder.add("OutputMaterial", inputs={"Surface": Link(emission, "Emission")})
    return NodeSource(name, (builder.tree(),), (), name, exact=False)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return tree_pictures({name: source(name) for name in EXPRESSIONS}, tmp_path_factory.mktemp("trees"))


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_cycles_computes_what_numpy_does(name: str, pictures: dict[str, Any]) -> None:
    centres = (np.arange(SIDE) + 0.5) * (2.0 / SIDE) - 1.0
    x, y = np.meshgrid(centres, centres)
    # float32, some operations deep.
    np.testing.assert_allclose(pictures[name], EXPRESSIONS[name](*arguments(x, y)), rtol=1e-5, atol=2e-6)
