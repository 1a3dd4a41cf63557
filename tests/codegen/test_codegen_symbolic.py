"""Symbolic arrays: they fold, share, refuse what has no counterpart, and compute what NumPy computes."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from lookdev.brdf import LOBES, PARAMETERS
from lookdev.brdf.lobes import Directions
from lookdev.codegen.brdf import WI, WO, trace_lobes
from lookdev.codegen.graph import OPERATIONS, Graph, Node
from lookdev.codegen.osl import _CODE
from lookdev.codegen.symbolic import SymbolicArray, elements_of, symbol, symbols
from lookdev.errors import CodegenError


@pytest.fixture
def graph() -> Graph:
    return Graph()


@pytest.fixture
def x(graph: Graph) -> SymbolicArray:
    return symbol(graph, "x")


@pytest.fixture
def v(graph: Graph) -> SymbolicArray:
    return symbols(graph, ["v_x", "v_y", "v_z"])


def node(value: Any) -> Any:
    (element,) = elements_of(value)
    return element


def test_what_folds_is_an_ordinary_array(x: SymbolicArray, v: SymbolicArray) -> None:
    for folded, wanted in (
        (x * 0.0, 0.0),
        (0.0 * v, np.zeros(3)),
        (x - x, 0.0),
        (x / x, 1.0),
        (0.0 / x, 0.0),
        (v * np.zeros(3) + 2.0, np.full(3, 2.0)),
        (np.sum(v * 0.0 + 1.0, axis=-1), 3.0),
        (np.clip(x * 0.0 - 1.0, 0.0, 1.0), 0.0),
        (np.where(x > 0.0, 2.0, 2.0), 2.0),
        (np.logical_and(x > 0.0, False), False),
        (np.logical_or(x > 0.0, True), True),
    ):
        assert not isinstance(folded, SymbolicArray), wanted
        np.testing.assert_array_equal(folded, wanted)


def test_what_changes_nothing_is_no_operation(x: SymbolicArray) -> None:
    for same in (
        x + 0.0, 0.0 + x, x - 0.0, x * 1.0, 1.0 * x, x / 1.0, +x, np.negative(-x), np.power(x, 1.0),
        np.maximum(x, x), np.minimum(x, x), np.where(True, x, 3.0), np.where(np.array(False), 3.0, x),
        np.where(x > 0.0, x, x),
    ):  # fmt: skip
        assert node(same) is node(x)


def test_components_fold_one_by_one(x: SymbolicArray) -> None:
    y, zero, seven = elements_of(x * np.array([1.0, 0.0, 1.0]) + np.array([0.0, 0.0, 7.0]))
    assert y is node(x)
    assert zero == 0.0
    assert not isinstance(zero, Node)
    assert isinstance(seven, Node)


def test_equal_expressions_are_one_node(x: SymbolicArray, v: SymbolicArray) -> None:
    assert node(np.sqrt(x * 2.0 + 1.0)) is node(np.sqrt(x * 2.0 + 1.0))
    assert node(np.square(x)) is node(x * x) is node(x**2.0)
    grey = elements_of(np.expand_dims(x, -1) * np.ones(3) + 0.5)
    assert grey[0] is grey[1] is grey[2]
    assert node(v[..., 1]) is elements_of(v)[1]


@pytest.mark.parametrize(("a", "b"), [(1.0, True), (0.0, False), (0.0, -0.0)])
def test_constants_that_compare_equal_stay_apart(graph: Graph, a: float, b: float) -> None:
    assert graph.apply("arctan2", graph.symbol("x"), a) is not graph.apply("arctan2", graph.symbol("x"), b)


def test_shapes_are_those_of_numpy(x: SymbolicArray, v: SymbolicArray) -> None:
    assert (x.shape, x.ndim, v.shape, v.ndim) == ((), 0, (3,), 1)
    assert np.stack([x, x * 2.0], axis=-1).shape == (2,)
    assert np.expand_dims(x, -1).shape == (1,)
    assert np.sum(v, axis=-1).shape == ()
    assert (v * np.expand_dims(x, -1)).shape == (3,)


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda x, v: np.arccos(x), "numpy.arccos, which has no generated counterpart; known: absolute, add"),
        (lambda x, v: np.isnan(x), "numpy.isnan, which has no generated counterpart"),
        (
            lambda x, v: np.cross(v, v),
            "numpy.cross, which symbolic arrays do not know; known: clip, expand_dims, stack, sum, where",
        ),
        (lambda x, v: np.add.reduce(v), "numpy.add.reduce"),
        (lambda x, v: np.sum(v, axis=None), "sums over axis None; only the last axis"),
        (lambda x, v: bool(x), "branches on a value known only at run time; use numpy.where"),
    ],
)
def test_what_has_no_counterpart_is_told(v: SymbolicArray, x: SymbolicArray, use: Any, message: str) -> None:
    with pytest.raises(CodegenError, match=message):
        use(x, v)


def test_a_branch_on_a_comparison_is_told(x: SymbolicArray) -> None:
    with pytest.raises(CodegenError, match=r"use numpy\.where"):
        _ = 1.0 if x > 0.5 else 0.0


def compute(value: Any, symbols: dict[str, Any], done: dict[Node, Any]) -> Any:
    """Evaluate a node with NumPy's own functions, by name."""
    if not isinstance(value, Node):
        return value
    if value not in done:
        if value.op == "symbol":
            done[value] = symbols[value.args[0]]
        else:
            function: Any = getattr(np, value.op)
            done[value] = function(*(compute(arg, symbols, done) for arg in value.args))
    return done[value]


def test_every_operation_computes_what_numpy_does(graph: Graph) -> None:
    rng = np.random.default_rng(1)
    a, b = rng.uniform(0.1, 0.9, (2, 50))
    for op in sorted(OPERATIONS):
        given = {"condition": a > 0.5, "a": a, "b": b} if op == "where" else {"a": a, "b": b}
        names = list(given)[: getattr(getattr(np, op), "nin", 3)]
        traced = graph.apply(op, *(graph.symbol(name) for name in names))
        wanted = getattr(np, op)(*(given[name] for name in names))
        np.testing.assert_array_equal(compute(traced, given, {}), wanted, err_msg=op)


def test_every_operation_that_stays_has_code() -> None:
    # These two are always rewritten as the graph is built.
    assert OPERATIONS - {"positive", "square"} == set(_CODE)


def _settings() -> list[Any]:
    return [
        pytest.param(
            model, dict(zip(tokens, values, strict=True)), textured, id=f"{model}-{'-'.join(values)}-{textured}"
        )
        for model, parameters in PARAMETERS.items()
        for tokens in [[p.name for p in parameters.values() if p.kind == "token"]]
        for values in product(*(parameters[name].choices for name in tokens))
        for textured in ("all", "none", "some")
    ]


@pytest.mark.parametrize(("model", "tokens", "textured"), _settings())
def test_a_traced_model_computes_what_numpy_does(
    model: str, tokens: dict[str, str], textured: str, graph: Graph
) -> None:
    rng = np.random.default_rng(2)
    count = 500

    def directions() -> Any:
        cos = rng.uniform(1e-3, 1.0, count)
        phi = rng.uniform(0.0, 2.0 * np.pi, count)
        sin = np.sqrt(1.0 - cos * cos)
        return np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=-1)

    wo, wi = directions(), directions()
    numbers: dict[str, Any] = {"u1": rng.random(count), "u2": rng.random(count)}
    numbers |= dict(zip((*WO, *WI), [*wo.T, *wi.T], strict=True))
    traced: dict[str, Any] = dict(tokens)
    direct: dict[str, Any] = dict(tokens)
    for number, (name, parameter) in enumerate(PARAMETERS[model].items()):
        if parameter.kind == "token":
            continue
        color = parameter.kind == "color"
        if textured == "all" or (textured == "some" and number % 2):
            direct[name] = rng.random((count, 3) if color else count) * parameter.hard[1]
            names = [f"{name}_{i}" for i in range(3)] if color else [name]
            numbers |= dict(zip(names, direct[name].reshape(count, -1).T, strict=True))
            traced[name] = symbols(graph, names) if color else symbol(graph, name)
        else:
            traced[name] = direct[name] = rng.random(3 if color else ()) * parameter.hard[1]
    done: dict[Node, Any] = {}

    def agree(values: Any, wanted: Any) -> None:
        got = np.stack([np.broadcast_to(compute(value, numbers, done), count) for value in values], axis=-1)
        # Sixteen digits, some of which cancellation in a model may take.
        np.testing.assert_allclose(got, wanted.reshape(count, -1), rtol=1e-12)

    lobes = LOBES[model](direct)
    pair = Directions.of(wo, wi)
    results = trace_lobes(graph, LOBES[model](traced))
    assert [result.name for result in results] == [lobe.name for lobe in lobes]
    for result, lobe in zip(results, lobes, strict=True):
        agree([result.share], np.broadcast_to(lobe.selection(wo), count))
        agree(result.f, lobe.evaluate(pair))
        agree([result.pdf], lobe.pdf(pair))
        got = [np.broadcast_to(compute(value, numbers, done), count) for value in result.wi]
        np.testing.assert_allclose(np.stack(got, axis=-1), lobe.sample(wo, numbers["u1"], numbers["u2"]), atol=1e-12)
