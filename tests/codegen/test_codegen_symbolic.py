"""Symbolic arrays fold, share nodes, refuse operations without a counterpart, and compute what NumPy computes."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from random_parameters import directions

from lookdev.brdf import CONTINUOUS_MODELS, MODELS, Bsdf, StackLayer, evaluate_cosine, stack_bsdf
from lookdev.brdf.lobes import Delta, DirectionPair
from lookdev.brdf.table import NumberTable, look_up
from lookdev.codegen.operators import CODE
from lookdev.codegen.osl.bsdf import WI, WO, trace_lobes
from lookdev.codegen.trace.graph import (
    OPERATIONS,
    Graph,
    GraphNode,
    Symbol,
    TableCell,
    Uniform,
    dependent_nodes,
    post_order,
    reachable_nodes,
)
from lookdev.codegen.trace.lobes import INSIDE, present_deltas, present_lobes, trace_mixture
from lookdev.codegen.trace.symbolic import SymbolicArray, elements_of, symbol, symbols, uniforms
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
    for folded, expected in (
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
        assert not isinstance(folded, SymbolicArray), expected
        np.testing.assert_array_equal(folded, expected)


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
    assert not isinstance(zero, GraphNode)
    assert isinstance(seven, GraphNode)


def test_equal_expressions_are_one_node(x: SymbolicArray, v: SymbolicArray) -> None:
    assert node(np.sqrt(x * 2.0 + 1.0)) is node(np.sqrt(x * 2.0 + 1.0))
    assert node(np.square(x)) is node(x * x) is node(x**2.0)
    grey = elements_of(np.expand_dims(x, -1) * np.ones(3) + 0.5)
    assert grey[0] is grey[1] is grey[2]
    assert node(v[..., 1]) is elements_of(v)[1]


@pytest.mark.parametrize(("a", "b"), [(1.0, True), (0.0, False), (0.0, -0.0)])
def test_constants_that_compare_equal_stay_apart(graph: Graph, a: float, b: float) -> None:
    assert graph.apply("arctan2", graph.symbol("x"), a) is not graph.apply("arctan2", graph.symbol("x"), b)


def test_what_is_computed_from_uniforms_and_constants_is_uniform(graph: Graph) -> None:
    varied = uniforms(graph, [0.3, 0.7]) * 5.0
    assert np.array_equal(varied, [1.5, 3.5])
    assert [type(element) for element in elements_of(varied)] == [Uniform, Uniform]
    assert type(graph.apply("multiply", 0.3, 5.0)) is float


def test_a_node_depends_on_the_symbols_under_it_alone(graph: Graph) -> None:
    a, b = graph.symbol("a"), graph.symbol("b")
    first, second = graph.apply("sin", a), graph.apply("sin", b)
    both = graph.apply("add", first, second)
    assert dependent_nodes([both], frozenset({"a"})) == {a, first, both}


def test_nodes_come_once_and_after_their_operands(graph: Graph) -> None:
    a = graph.symbol("a")
    sine, cosine = graph.apply("sin", a), graph.apply("cos", a)
    both = graph.apply("add", sine, cosine)
    assert list(post_order([sine, both, 1.0, a])) == [a, sine, cosine, both]
    assert list(post_order([both], stop=lambda node: node is sine)) == [a, cosine, both]
    assert list(post_order([both], stop=lambda node: node is both)) == []
    assert reachable_nodes([both, a, a]).keys() == {both, cosine, a, sine}
    assert reachable_nodes([both], stop=[sine, cosine]).keys() == {both, sine, cosine}


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
        (lambda x, v: np.cross(v, v), "numpy.cross, which symbolic arrays lack; they have: broadcast_arrays, clip, "),
        (lambda x, v: np.add.reduce(v), "numpy.add.reduce"),
        (lambda x, v: np.sum(v, axis=None), "sums over axis None; only the last axis"),
        (lambda x, v: bool(x), "branches on a value known only at run time; use numpy.where"),
        (lambda x, v: 1.0 if x > 0.5 else 0.0, "branches on a value known only at run time; use numpy.where"),
    ],
)
def test_what_has_no_counterpart_is_reported(v: SymbolicArray, x: SymbolicArray, use: Any, message: str) -> None:
    with pytest.raises(CodegenError, match=message):
        use(x, v)


def compute(value: Any, symbols: dict[str, Any], results: dict[GraphNode, Any]) -> Any:
    """Evaluate a node with NumPy's own functions, by name."""
    if not isinstance(value, GraphNode):
        return value
    if value not in results:
        if isinstance(value, Symbol):
            results[value] = symbols[value.name]
        elif isinstance(value, TableCell):
            row, column = (np.asarray(compute(index, symbols, results)).astype(np.intp) for index in value.args)
            cell = value.table.values[row, column]
            results[value] = cell if value.channel is None else cell[..., value.channel]
        else:
            function: Any = getattr(np, value.op)
            results[value] = function(*(compute(arg, symbols, results) for arg in value.args))
    return results[value]


def test_every_operation_computes_what_numpy_does(graph: Graph) -> None:
    a, b = np.random.default_rng(1).uniform(0.1, 0.9, (2, 50))
    for op in sorted(OPERATIONS):
        values = {"condition": a > 0.5, "a": a, "b": b} if op == "where" else {"a": a, "b": b}
        names = list(values)[: getattr(getattr(np, op), "nin", 3)]
        traced = graph.apply(op, *(graph.symbol(name) for name in names))
        expected = getattr(np, op)(*(values[name] for name in names))
        np.testing.assert_array_equal(compute(traced, values, {}), expected, err_msg=op)


def test_colors_of_a_table_are_the_last_axis(graph: Graph) -> None:
    table, columns = NumberTable(np.arange(24.0).reshape(2, 4, 3)), {"a": 3.0, "b": 0.0}
    traced = look_up(table, 1.0, symbols(graph, list(columns)))  # type: ignore[arg-type]
    assert traced.shape == (2, 3)
    assert [compute(element, columns, {}) for element in elements_of(traced)] == [21.0, 22.0, 23.0, 12.0, 13.0, 14.0]


@pytest.mark.parametrize("name", ["mirror", "glass"])
def test_traced_directions_are_those_of_numpy_from_outside_and_inside(graph: Graph, name: str) -> None:
    bsdf, wo = MODELS[name].bsdf(MODELS[name].complete({})), directions(np.random.default_rng(3), 40)
    inside = np.arange(40) % 2
    numbers = dict(zip((*WO, INSIDE), [*wo.T, inside], strict=True))
    for delta, expected in zip(present_deltas(graph, bsdf), bsdf.deltas(wo, inside > 0), strict=True):
        for part, values in ((delta.direction, expected.direction), (delta.value, expected.value)):
            columns = [np.broadcast_to(compute(element, numbers, {}), 40) for element in elements_of(part)]
            np.testing.assert_allclose(np.stack(columns, axis=-1), values, rtol=1e-12)


@pytest.mark.parametrize(("color", "present"), [((0.0, 0.0, 0.0), False), ((0.0, 0.0, 0.5), True)])
def test_a_single_direction_without_light_vanishes(
    graph: Graph, v: SymbolicArray, color: tuple[float, ...], present: bool
) -> None:
    bsdf = Bsdf(lambda _: (), deltas=lambda wo, inside: (Delta("model", "name", wo, np.array(color)),))
    assert bool(present_deltas(graph, bsdf)) == present
    textured = Bsdf(lambda _: (), deltas=lambda wo, inside: (Delta("model", "name", wo, v * np.array(color)),))
    assert bool(present_deltas(graph, textured)) == present


def test_the_viewer_is_above_the_horizon_and_each_lobe_has_a_share(graph: Graph) -> None:
    model = CONTINUOUS_MODELS["disney"]
    bsdf = model.bsdf(model.complete({}) | {name: symbol(graph, name) for name in ("metallic", "clearcoat")})
    mixture = trace_mixture(graph, present_lobes(graph, bsdf))
    assert len(mixture.lobes) > 2
    for value in (mixture.wo[..., 2], mixture.total_share, *(lobe.share for lobe in mixture.lobes)):
        assert elements_of(value > 0.0) == [True]


def test_every_operation_that_stays_has_code() -> None:
    # These two are always rewritten while the graph is built.
    assert OPERATIONS - {"positive", "square"} == set(CODE)


# Stacks of every model, with every token, of both layerings, and of both models.
_STACKS: dict[str, list[tuple[str, dict[str, str], Any]]] = {
    **{
        "-".join((name, *values)): [(name, dict(zip(forms, values, strict=True)), "over")]
        for name, forms in ((name, model.forms()) for name, model in CONTINUOUS_MODELS.items())
        for values in product(*forms.values())
    },
    "over": [("pixar", {"energy": "published"}, "over")] * 3,
    "transmit": [("pixar", {"energy": "published"}, mode) for mode in ("over", "transmit", "transmit")],
    "mixed": [("pixar", {"energy": "conserving"}, "over"), ("disney", {"variant": "2012"}, "over")],
    "apart": [("disney", {}, "over"), ("disney", {"fresnel": "conductor"}, "over"), ("disney", {}, "over")],
}


# In every stack, some parameters are symbols. In one stack of each model, and in those of several layers, also all or
# none.
_ENDS = {layers[0][0] if len(layers) == 1 else name: name for name, layers in _STACKS.items()}.values()


@pytest.mark.parametrize(
    ("name", "textured"),
    [
        pytest.param(name, textured, marks=() if textured == "some" or name in _ENDS else pytest.mark.proof)
        for name in _STACKS
        for textured in ("all", "none", "some")
    ],
)
def test_a_traced_stack_computes_what_numpy_does(name: str, textured: str, graph: Graph) -> None:
    rng = np.random.default_rng(2)
    count = 500
    wo, wi = directions(rng, count), directions(rng, count)
    numbers: dict[str, Any] = {"u1": rng.random(count), "u2": rng.random(count)}
    direct, traced = [], []
    for index, (model, tokens, mode) in enumerate(_STACKS[name]):
        values: dict[str, Any] = MODELS[model].tokens(tokens)
        symbolic: dict[str, Any] = dict(values)
        for number, (key, parameter) in enumerate(MODELS[model].parameters.items()):
            if parameter.kind == "token":
                continue
            vector = parameter.kind != "float"
            varies = textured == "all" or (textured == "some" and number % 2)
            low, high = parameter.hard
            shape = ((count,) if varies else ()) + ((3,) if vector else ())
            values[key] = symbolic[key] = low + (high - low) * rng.random(shape)
            if varies:
                names = [f"layer{index}_{key}_{i}" for i in range(3)] if vector else [f"layer{index}_{key}"]
                numbers |= dict(zip(names, values[key].reshape(count, -1).T, strict=True))
                symbolic[key] = symbols(graph, names) if vector else symbol(graph, names[0])
        mask = numbers[f"mask{index}"] = rng.random(count)
        direct.append(StackLayer(model, values, mask, mode))
        traced.append(StackLayer(model, symbolic, symbol(graph, f"mask{index}"), mode))

    bsdf, traced_bsdf = stack_bsdf(direct), stack_bsdf(traced)
    lights = {False: wi, True: wi * [1.0, 1.0, -1.0]}
    sides = {
        transmits: numbers | dict(zip((*WO, *WI), [*wo.T, *light.T], strict=True))
        for transmits, light in lights.items()
    }
    done: dict[bool, dict[GraphNode, Any]] = {False: {}, True: {}}

    def compute_columns(values: Any, transmits: bool) -> Any:
        columns = [compute(value, sides[transmits], done[transmits]) for value in values]
        return np.stack([np.broadcast_to(column, count) for column in columns], axis=-1)

    def agree(values: Any, expected: Any, transmits: bool = False, runs: Any = True) -> None:
        # Of sixteen digits, cancellation in a model can lose some.
        expected = np.broadcast_to(expected, (count, len(values)))
        np.testing.assert_allclose(np.where(runs, compute_columns(values, transmits), 0.0), expected, rtol=1e-12)

    agree(elements_of(traced_bsdf.presence), np.reshape(bsdf.presence, (-1, 1)))
    lobes = [lobe for lobe in bsdf.lobes(wo) if np.any(lobe.share > 0.0)]
    mixture = trace_lobes(graph, present_lobes(graph, traced_bsdf))
    assert [result.name for result in mixture.lobes] == [lobe.name for lobe in lobes]
    u1, upper = numbers["u1"] * sum(lobe.share for lobe in lobes), np.zeros(count)
    for result, lobe in zip(mixture.lobes, lobes, strict=True):
        side = lights[lobe.transmits]
        local_o, local_i = lobe.local_directions(wo, side)
        valid = local_i[:, 2] > 0.0
        density = lobe.pdf(DirectionPair.from_directions(local_o, np.where(valid[:, None], local_i, local_o)))
        agree([result.share], np.reshape(lobe.share, (-1, 1)))
        runs = True if result.side is None else compute_columns([result.side], lobe.transmits)
        agree(result.value, evaluate_cosine(Bsdf(lambda _, lobe=lobe: (lobe,)), wo, side), lobe.transmits, runs)
        share = lobe.share if len(lobes) > 1 else 1.0
        agree([result.density], np.where(valid, share * density, 0.0)[:, None], lobe.transmits, runs)
        # Shares can be too different for a quotient.
        width = np.where(lobe.share > 0.0, lobe.share, 1.0)
        remapped = np.minimum(np.clip(u1 - upper, 0.0, width) / width, 0.99999994)
        expected_wi, upper = (
            lobe.draw(remapped if len(lobes) > 1 else numbers["u1"], numbers["u2"]),
            upper + lobe.share,
        )
        # A lobe is sampled only where it has a share.
        present = np.broadcast_to(lobe.share > 0.0, count)
        with np.errstate(divide="ignore", invalid="ignore"):
            directions_drawn = compute_columns(result.wi, lobe.transmits)
        np.testing.assert_allclose(
            directions_drawn[present], np.broadcast_to(expected_wi, (count, 3))[present], atol=1e-12
        )
