"""Fits are detected in traced expressions, and their groups compute what NumPy computes."""

import numpy as np
import pytest
from node_interpreter import Interpreter

from lookdev.closures.fits import closure_fit, closure_table
from lookdev.codegen.nodes.fits import fit_tree, is_fit, match_fit
from lookdev.codegen.nodes.look import generate_nodes
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import elements_of, symbol
from lookdev.material import Layer, Look

NAMES = [name for name, entry in closure_table()["fits"].items() if len(entry["numerator"][0]) > 1]


@pytest.mark.parametrize("name", NAMES)
def test_a_fit_is_found(name: str) -> None:
    graph = Graph()
    x, y = np.sin(symbol(graph, "a")), symbol(graph, "b")
    (node,) = elements_of(closure_fit(name)(x, y))
    assert match_fit(node) == (f"Lookdev Fit {name}", {"x": elements_of(x)[0], "y": elements_of(y)[0]})


def test_other_quotients_are_no_fits() -> None:
    graph = Graph()
    x, y = symbol(graph, "a"), symbol(graph, "b")
    for other in (x / y, (2.0 * y + 1.0) / x, ((2.0 * y + 1.0) * x + (3.0 * y + 2.0)) / (x + 1.0), x * y + y):
        assert match_fit(*elements_of(other)) is None


@pytest.mark.parametrize("name", NAMES)
def test_the_group_computes_the_fit(name: str) -> None:
    x, y = np.random.default_rng(1).uniform(0.0, 1.0, (2, 100)).astype(np.float32)
    tree = fit_tree(f"Lookdev Fit {name}")
    result = Interpreter((tree,)).run(tree.name, {"x": x, "y": y})["Value"]
    expected = closure_fit(name)(x.astype(np.float64), y.astype(np.float64))
    # Coefficients of some tens cancel, in float32.
    np.testing.assert_allclose(result, expected, rtol=1e-4, atol=1e-5)


def test_lobes_share_a_group() -> None:
    source = generate_nodes(Look("look", (Layer("base", "pixar", {}),)), lambda texture: pytest.fail("no texture"))
    names = [tree.name for tree in source.trees if is_fit(tree.name)]
    used_groups = [node.group for tree in source.trees for node in tree.nodes if is_fit(node.group)]
    # The specular and the reflection lobe have a node each.
    assert set(names) == set(used_groups)
    assert len(names) == len(set(names))
    assert all(used_groups.count(name) >= 2 for name in names)
