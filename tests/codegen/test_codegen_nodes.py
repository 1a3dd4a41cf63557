"""Trees of nodes compute what the traced NumPy code computes, in few nodes."""

from collections import Counter
from typing import Any

import numpy as np
import pytest
from node_interpreter import Interpreter, shape_input

from lookdev.brdf.vectors import cross, dot, mix, mix_color, normalize, vector
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.source import GroupSocket, NodeLink, NodeTree
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import SymbolicArray, elements_of, symbol, symbols
from lookdev.errors import CodegenError

FLOATS = ("a", "b", "c")
VECTORS = ("u", "v", "w")


def builder() -> tuple[TreeBuilder, dict[str, SymbolicArray]]:
    """Return a builder whose group has three floats and three vectors as inputs, and their symbols."""
    graph, nodes = Graph(), TreeBuilder("test")
    group_input = nodes.add("NodeGroupInput")
    for name in FLOATS:
        nodes.bind([name], NodeLink(group_input, name))
    for name in VECTORS:
        nodes.bind([f"{name}_{i}" for i in range(3)], NodeLink(group_input, name))
    values = {name: symbol(graph, name) for name in FLOATS}
    return nodes, values | {name: symbols(graph, [f"{name}_{i}" for i in range(3)]) for name in VECTORS}


def build(result: Any) -> NodeTree:
    """Return the tree whose one output is a function of the symbols."""
    nodes, values = builder()
    traced = result(**values)
    elements = elements_of(traced)
    out = nodes.scalar(elements[0]) if traced.shape == () else nodes.vector(elements)
    nodes.add("NodeGroupOutput", inputs={"out": out})
    inputs = [GroupSocket(name, "float") for name in FLOATS] + [
        GroupSocket(name, "vector", (0.0, 0.0, 0.0)) for name in VECTORS
    ]
    return nodes.tree(inputs, [GroupSocket("out", "float" if traced.shape == () else "vector")])


def kinds(tree: NodeTree) -> Counter[str]:
    """Count the nodes of a tree by kind and operation, without those of its interface."""
    return Counter(
        str(node.properties.get("operation", node.kind)) for node in tree.nodes if not node.kind.startswith("NodeGroup")
    )


def check(result: Any, low: float = 0.1, high: float = 2.0) -> Counter[str]:
    """Compare a tree with the function that it was traced from, over random numbers; return its nodes."""
    tree = build(result)
    rng = np.random.default_rng(5)
    values = {name: rng.uniform(low, high, 64).astype(np.float32) for name in FLOATS}
    values |= {name: rng.uniform(low, high, (64, 3)).astype(np.float32) for name in VECTORS}
    expected = result(**{name: value.astype(np.float64) for name, value in values.items()})
    result_of_nodes = Interpreter((tree,)).run("test", values)["out"]
    result_of_nodes = shape_input("out", result_of_nodes, scalar=np.ndim(expected) == 1)
    # Some tens of roundings of numbers near 1.
    np.testing.assert_allclose(np.broadcast_to(result_of_nodes, np.shape(expected)), expected, rtol=2e-5, atol=2e-6)
    return kinds(tree)


@pytest.mark.parametrize(
    "result",
    [
        lambda a, b, **_: a + b,
        lambda a, b, **_: (a - b) / (a + 2.0 * b),
        lambda a, b, **_: np.maximum(a, b) * np.minimum(a, 0.7) - np.abs(b - 1.0),
        lambda a, b, c, **_: np.sqrt(a) + np.exp(-b) + np.log(c) + a**b,
        lambda a, b, c, **_: np.sin(a) + np.cos(b) * np.tan(0.5 * c) + np.arctan2(a - 1.0, b - 1.0) + np.floor(3.0 * a),
        lambda a, b, **_: np.expm1(a - b),
        lambda a, b, c, **_: np.where(a > b, a, c) + np.where(a >= b, c, b * c) + np.where(a < 1.0, 2.0, c),
        lambda a, b, c, **_: np.where((a > b) & (b > c), a, 0.0) + np.where((a > b) | ~(b <= c), a, b),
        lambda a, b, **_: np.where(np.floor(2.0 * a) == np.floor(2.0 * b), a, b) + np.where(a == b, 1.0, 0.0),
        lambda a, b, c, **_: 1.0 - 2.0 * a + (3.0 * b - 1.0) * c,
        lambda u, v, **_: u * v + u,
        lambda a, u, v, **_: mix_color(u, v, a) * np.floor(2.0 * u),
        lambda a, u, v, **_: np.stack([u[..., 0] * a, v[..., 1], np.sqrt(u[..., 2])], axis=-1),
        lambda u, v, **_: dot(u, v) + u[..., 1],
        lambda a, u, v, **_: np.where(np.expand_dims(a > 1.0, -1), u, v) / np.maximum(u, 0.5),
        lambda u, v, w, **_: normalize(u - w) + normalize(v),
        # Two components of a vector that one node computes, and a third of another vector.
        lambda u, v, w, **_: vector(cross(u, v)[..., 0], cross(u, v)[..., 1], cross(u, w)[..., 2]),
        lambda u, v, **_: vector(*(u[..., i] * (1.0 / np.sqrt(dot(w, w))) for i, w in enumerate((u, u, v)))),
        lambda u, **_: vector(normalize(u)[..., 0], normalize(u)[..., 1], u[..., 2] / (1.0 / np.sqrt(dot(u, u)))),
    ],
)
def test_nodes_compute_what_was_traced(result: Any) -> None:
    check(result)


def test_expm1_keeps_small_numbers() -> None:
    tree = build(lambda a, **_: np.expm1(a))
    x = np.array([-20.0, -1.0, -1e-6, 1e-7, 3e-3, 1.0, 20.0], dtype=np.float32)
    result = Interpreter((tree,)).run("test", {"a": x})["out"]
    np.testing.assert_allclose(result, np.expm1(x.astype(np.float64)), rtol=4e-6)


@pytest.mark.parametrize(
    ("result", "nodes"),
    [
        (lambda a, b, c, **_: a * b + c, {"MULTIPLY_ADD": 1}),
        (lambda a, b, **_: b - 2.0 * a, {"MULTIPLY_ADD": 1}),
        (lambda a, b, c, **_: mix(a, b, c), {"Mix": 1}),
        (lambda a, b, **_: mix(1.0, a, b), {"Mix": 1}),
        (lambda a, b, **_: mix(a, 1.0, b), {"Mix": 1}),
        (lambda a, **_: 1.0 / np.sqrt(a), {"INVERSE_SQRT": 1}),
        (lambda u, v, **_: u * v, {"MULTIPLY": 1}),
        (lambda a, u, **_: u * np.expand_dims(a, -1), {"SCALE": 1}),
        (lambda u, **_: u * 3.0, {"SCALE": 1}),
        (lambda a, u, v, **_: mix_color(u, v, a), {"Mix": 1}),
        (lambda u, v, **_: dot(u, v), {"DOT_PRODUCT": 1}),
        (lambda u, **_: dot(u, np.array([0.3, 0.6, 0.1])), {"DOT_PRODUCT": 1}),
        (lambda u, **_: (u[..., 0] + u[..., 1] + u[..., 2]) * (1.0 / 3.0), {"DOT_PRODUCT": 1}),
        (lambda u, **_: np.sum(u, axis=-1) * (1.0 / 3.0), {"DOT_PRODUCT": 1}),
        (lambda u, v, **_: cross(u, v), {"CROSS_PRODUCT": 1}),
        (lambda u, **_: cross(u, np.array([0.3, 0.6, 0.1])), {"CROSS_PRODUCT": 1}),
        (lambda u, **_: normalize(u), {"NORMALIZE": 1}),
        (lambda a, **_: np.stack([a, a, a], axis=-1), {}),
        (lambda u, **_: u[..., 1], {"SeparateXYZ": 1}),
        # A component of a vector that a node computes anyway.
        (
            lambda u, v, **_: (u * v) * np.expand_dims((u * v)[..., 0], -1),
            {"MULTIPLY": 1, "SeparateXYZ": 1, "SCALE": 1},
        ),
        # Equal parts are computed once.
        (lambda a, b, **_: np.sin(a + b) * np.exp(np.sin(a + b)), {"ADD": 1, "SINE": 1, "EXPONENT": 1, "MULTIPLY": 1}),
    ],
)
def test_few_nodes(result: Any, nodes: dict[str, int]) -> None:
    assert check(result) == nodes


def test_a_vector_never_depends_on_its_own_part() -> None:
    # Each component is the sine of the previous one: as one vector, it would depend on itself.
    def chain(a: Any, u: Any, **_: Any) -> Any:
        first = np.sin(u[..., 0])
        second = np.sin(first)
        return np.stack([first, second, np.sin(second)], axis=-1)

    assert check(chain) == {"SINE": 3, "SeparateXYZ": 1, "CombineXYZ": 1}


def test_deep_graphs_need_no_recursion() -> None:
    def deep(a: Any, b: Any, **_: Any) -> Any:
        for _number in range(3000):
            a = np.sin(a) * b
        return a

    assert sum(kinds(build(deep)).values()) == 6000
    assert sum(kinds(build(lambda a, b, **_: np.stack([0.0 * a, deep(a, b), 1.0 - a], axis=-1))).values()) == 6002


def test_random_expressions() -> None:
    """Random combinations of vectors and components have the values of NumPy."""
    for seed in range(30):

        def result(seed: int = seed, **values: Any) -> Any:
            rng = np.random.default_rng(seed)
            scalars, vectors = [values[name] for name in FLOATS], [values[name] for name in VECTORS]
            for _number in range(25):
                a, b = (scalars[rng.integers(len(scalars))] for _ in range(2))
                u, v = (vectors[rng.integers(len(vectors))] for _ in range(2))
                match rng.integers(7):
                    case 0:
                        scalars.append(0.5 * np.sin(a * b) + 1.0)
                    case 1:
                        scalars.append(np.where(a > b, a, 0.5 * b) / (1.0 + a))
                    case 2:
                        scalars.append(dot(normalize(u), normalize(v)) + 0.1)
                    case 3:
                        scalars.append(np.minimum(u[..., 1] + v[..., 2], 1.5))
                    case 4:
                        vectors.append(mix_color(u, v, np.clip(a, 0.0, 1.0)) * 0.9 + 0.1)
                    case 5:
                        vectors.append(np.stack([0.7 * np.sin(a) + 1.0, b, u[..., 0]], axis=-1))
                    case 6:
                        vectors.append(np.minimum(u * v + v, 1.9))
            return np.expand_dims(scalars[-1], -1) * vectors[-1] + vectors[-2]

        check(result)


def test_what_is_not_bound_is_named() -> None:
    nodes, values = builder()
    graph = values["a"].graph
    total = values["a"] + symbol(graph, "lost") * symbol(graph, "gone")
    with pytest.raises(CodegenError, match=r"test read unbound symbols: gone, lost; bound: a, b, c"):
        nodes.scalar(*elements_of(total))


def test_constants_must_be_finite() -> None:
    nodes, values = builder()
    with pytest.raises(CodegenError, match="inf"):
        nodes.scalar(*elements_of(values["a"] * np.inf))


def test_only_what_leads_to_an_output_is_there() -> None:
    nodes, values = builder()
    nodes.scalar(*elements_of(np.sin(values["b"])))
    nodes.add("NodeGroupOutput", inputs={"out": nodes.scalar(*elements_of(np.cos(values["a"])))})
    tree = nodes.tree([GroupSocket(name, "float") for name in FLOATS], [GroupSocket("out", "float")])
    assert [socket.name for socket in tree.inputs] == ["a"]
    assert kinds(tree) == {"COSINE": 1}


def test_nodes_stand_in_order_and_apart() -> None:
    tree = build(lambda a, b, u, v, **_: mix_color(u * v, normalize(u + v), np.sin(a) * b) * np.expand_dims(a, -1))
    earlier: set[str] = set()
    for node in tree.nodes:
        for link in node.inputs.values():
            if isinstance(link, NodeLink):
                assert link.node in earlier
                source = next(other for other in tree.nodes if other.name == link.node)
                assert source.position[0] < node.position[0]
        earlier.add(node.name)
    assert len(earlier) == len(tree.nodes)
    positions = [node.position for node in tree.nodes]
    for index, (x, y) in enumerate(positions):
        for other_x, other_y in positions[index + 1 :]:
            assert abs(x - other_x) >= 200 or abs(y - other_y) >= 100
