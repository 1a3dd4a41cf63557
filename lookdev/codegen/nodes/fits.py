"""Put each fitted function of `lookdev.closures.fits` into a group of nodes, so that a tree has one node for it.

A fit is a polynomial in x and y, or a quotient of two polynomials. A closure's weight or roughness contains fits.
Without groups, their many operations would all be nodes of the tree.
"""

from __future__ import annotations

import numpy as np

from lookdev.closures.fits import closure_fit, closure_table
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.source import GroupSocket, NodeLink, NodeTree
from lookdev.codegen.trace.graph import Graph, GraphNode
from lookdev.codegen.trace.symbolic import SymbolicArray, elements_of, symbol

_PREFIX = "Lookdev Fit "
_INPUTS = ("x", "y")


def match_fit(node: GraphNode) -> tuple[str, dict[str, GraphNode]] | None:
    """Return the name of the group that computes a node, and the group's inputs; None if the node is not a fit."""
    variables = _variables(node)
    if variables is None:
        return None
    x, y = (SymbolicArray(node.graph, np.array(variable, dtype=object)) for variable in variables)
    for name, entry in closure_table()["fits"].items():
        # Fits of x alone stay nodes of the tree. Equal expressions of a graph are the same object.
        if len(entry["numerator"][0]) > 1 and elements_of(closure_fit(name)(x, y))[0] is node:
            return f"{_PREFIX}{name}", dict(zip(_INPUTS, variables, strict=True))
    return None


def is_fit(group: str) -> bool:
    """Return whether `group` is the name of a group that computes a fit."""
    return group.startswith(_PREFIX)


def fit_tree(group: str) -> NodeTree:
    """Return the tree of the group `group`, which computes a fit."""
    graph, builder = Graph(), TreeBuilder(group)
    group_input = builder.add("NodeGroupInput")
    for name in _INPUTS:
        builder.bind([name], NodeLink(group_input, name))
    value = closure_fit(group.removeprefix(_PREFIX))(*(symbol(graph, name) for name in _INPUTS))
    builder.add("NodeGroupOutput", inputs={"Value": builder.scalar(*elements_of(value))})
    return builder.tree([GroupSocket(name, "float") for name in _INPUTS], [GroupSocket("Value", "float")])


def _variables(node: GraphNode) -> tuple[GraphNode, GraphNode] | None:
    """Return the candidates for x and y of a node that may be a fit, or None if the node cannot be one.

    The node of a fit is a polynomial (... y + c) x + (... y + c) by Horner's rule, or a quotient of two polynomials.
    """
    match node.args[0] if node.op == "divide" else node:
        case GraphNode(op="add", args=(GraphNode(op="multiply", args=(_, GraphNode() as x)), remainder)):
            match remainder:
                case GraphNode(op="add", args=(GraphNode(op="multiply", args=(_, GraphNode() as y)), _)):
                    return x, y
    return None
