"""Derivatives of traced graphs in forward mode, for fits of a look's parameters to pictures by gradients.

A tangent is the derivative of a node with respect to the chosen symbol. Tangents are nodes of the same graph, which
folds them, and shares equal ones.

- Griewank, A. and Walther, A. 2008. Evaluating Derivatives, second edition, chapter 3: the tangents of operations.

The derivative of ``where`` is the derivative of the branch taken. Conditions, whole numbers (``floor``) and cells of
tables have derivative 0. At 0, where the derivative of a root or a power can be infinite, the result is 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from lookdev.codegen.trace.graph import Graph, GraphNode, Scalar, Symbol, post_order


def derivatives(graph: Graph, roots: Sequence[Scalar], name: str) -> list[Scalar]:
    """Return the derivatives of nodes and constants with respect to a named symbol."""
    tangents: dict[GraphNode, Scalar] = {}
    operations = _GraphOperations(graph)

    def tangent_of(value: Scalar) -> Scalar:
        return tangents[value] if isinstance(value, GraphNode) else 0.0

    for node in post_order(roots):
        if isinstance(node, Symbol):
            tangents[node] = 1.0 if node.name == name else 0.0
        else:
            operand_tangents = [tangent_of(value) if node.op != "look_up" else 0.0 for value in node.args]
            is_varying = any(isinstance(value, GraphNode) or value != 0.0 for value in operand_tangents)
            rule = _RULES.get(node.op) if is_varying else None
            tangents[node] = rule(operations, node, *node.args, *operand_tangents) if rule else 0.0
    return [tangent_of(value) for value in roots]


class _GraphOperations:
    """The operations of a graph as methods, named like the operations, such as ``multiply(a, b)``."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph

    def __getattr__(self, op: str) -> Callable[..., Scalar]:
        return lambda *args: self._graph.apply(op, *args)

    def scale(self, tangent: Scalar, factor: Callable[[], Scalar], valid: Scalar) -> Scalar:
        """Return a tangent times `factor()`, or 0 where `valid` is false.

        If the tangent is the constant 0, so is the result, and the factor is not traced.
        """
        if not isinstance(tangent, GraphNode) and tangent == 0.0:
            return 0.0
        return self.where(valid, self.multiply(tangent, factor()), 0.0)


def _power(g: _GraphOperations, node: GraphNode, a: Scalar, b: Scalar, da: Scalar, db: Scalar) -> Scalar:
    """Return the tangent of `node` = a^b, from the tangents da and db; 0 where a is not positive."""
    positive = g.greater(a, 0.0)
    base = g.scale(da, lambda: g.multiply(b, g.power(a, g.subtract(b, 1.0))), positive)
    return g.add(base, g.scale(db, lambda: g.multiply(node, g.log(a)), positive))


def _arctan2(g: _GraphOperations, node: GraphNode, y: Scalar, x: Scalar, dy: Scalar, dx: Scalar) -> Scalar:
    """Return the tangent of `node` = arctan2(y, x), from the tangents dy and dx; 0 at the origin."""
    length = g.add(g.multiply(x, x), g.multiply(y, y))
    cross = g.subtract(g.multiply(x, dy), g.multiply(y, dx))
    return g.where(g.greater(length, 0.0), g.divide(cross, length), 0.0)


_RULES: Mapping[str, Callable[..., Scalar]] = {
    "add": lambda g, node, a, b, da, db: g.add(da, db),
    "subtract": lambda g, node, a, b, da, db: g.subtract(da, db),
    "multiply": lambda g, node, a, b, da, db: g.add(g.multiply(da, b), g.multiply(a, db)),
    "divide": lambda g, node, a, b, da, db: g.divide(g.subtract(da, g.multiply(node, db)), b),
    "negative": lambda g, node, a, da: g.negative(da),
    "absolute": lambda g, node, a, da: g.where(g.less(a, 0.0), g.negative(da), da),
    "sqrt": lambda g, node, a, da: g.scale(da, lambda: g.divide(0.5, node), g.greater(a, 0.0)),
    "exp": lambda g, node, a, da: g.multiply(da, node),
    "expm1": lambda g, node, a, da: g.multiply(da, g.add(node, 1.0)),
    "log": lambda g, node, a, da: g.divide(da, a),
    "sin": lambda g, node, a, da: g.multiply(da, g.cos(a)),
    "cos": lambda g, node, a, da: g.negative(g.multiply(da, g.sin(a))),
    "tan": lambda g, node, a, da: g.multiply(da, g.add(1.0, g.multiply(node, node))),
    "arctan2": _arctan2,
    "power": _power,
    "maximum": lambda g, node, a, b, da, db: g.where(g.greater_equal(a, b), da, db),
    "minimum": lambda g, node, a, b, da, db: g.where(g.less_equal(a, b), da, db),
    "where": lambda g, node, c, a, b, dc, da, db: g.where(c, da, db),
}
"""Functions that return the tangent of a node, by the node's operation.

The arguments are the graph's operations g, the node, its operands a, b and c, and their tangents da, db and dc. The
tangent of an operation without a function is 0.
"""
