"""Derivatives of traced graphs: forward mode, written as nodes of the same graph, folded and shared as all of them.

- Griewank, A. and Walther, A. 2008. Evaluating Derivatives, second edition, chapter 3: the tangents of operations.

Conditions, whole numbers and cells of tables have derivative 0: so it is that of the branch that is taken. Where a root
or a power has an infinite derivative, at 0, it is 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from lookdev.codegen.trace.graph import Graph, Node, Scalar, in_order


def slopes(graph: Graph, roots: Sequence[Scalar], name: str) -> list[Scalar]:
    """Return the derivatives of nodes and constants by a named symbol."""
    found: dict[Node, Scalar] = {}

    def of(value: Scalar) -> Scalar:
        return found[value] if isinstance(value, Node) else 0.0

    for node in in_order(roots):
        if node.op == "symbol":
            found[node] = 1.0 if node.args[0] == name else 0.0
        else:
            given = [of(each) if node.op != "look_up" else 0.0 for each in node.args]
            moves = any(isinstance(each, Node) or each != 0.0 for each in given)
            found[node] = _tangent(graph, node, given) if moves else 0.0
    return [of(each) for each in roots]


def _tangent(graph: Graph, node: Node, given: Sequence[Scalar]) -> Scalar:
    """Return the derivative of an operation by those of its operands."""
    rule = _RULES.get(node.op)
    return 0.0 if rule is None else rule(_Calculus(graph), node, *node.args, *given)


class _Calculus:
    """Operations of a graph by short names."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph

    def __getattr__(self, op: str) -> Callable[..., Any]:
        return lambda *args: self._graph.apply(op, *args)

    def scaled(self, tangent: Scalar, by: Callable[[], Scalar], allowed: Scalar) -> Scalar:
        """Return a tangent times a factor, 0 where the factor is not allowed, of which nothing is written for 0."""
        if not isinstance(tangent, Node) and tangent == 0.0:
            return 0.0
        return self.where(allowed, self.multiply(tangent, by()), 0.0)  # type: ignore[no-any-return]


def _power(of: _Calculus, node: Node, a: Scalar, b: Scalar, da: Scalar, db: Scalar) -> Scalar:
    positive = of.greater(a, 0.0)
    base = of.scaled(da, lambda: of.multiply(b, of.power(a, of.subtract(b, 1.0))), positive)
    return of.add(base, of.scaled(db, lambda: of.multiply(node, of.log(a)), positive))  # type: ignore[no-any-return]


def _arctan2(of: _Calculus, node: Node, y: Scalar, x: Scalar, dy: Scalar, dx: Scalar) -> Scalar:
    length = of.add(of.multiply(x, x), of.multiply(y, y))
    turned = of.subtract(of.multiply(x, dy), of.multiply(y, dx))
    return of.where(of.greater(length, 0.0), of.divide(turned, length), 0.0)  # type: ignore[no-any-return]


_RULES: Mapping[str, Callable[..., Scalar]] = {
    "add": lambda of, node, a, b, da, db: of.add(da, db),
    "subtract": lambda of, node, a, b, da, db: of.subtract(da, db),
    "multiply": lambda of, node, a, b, da, db: of.add(of.multiply(da, b), of.multiply(a, db)),
    "divide": lambda of, node, a, b, da, db: of.divide(of.subtract(da, of.multiply(node, db)), b),
    "negative": lambda of, node, a, da: of.negative(da),
    "absolute": lambda of, node, a, da: of.where(of.less(a, 0.0), of.negative(da), da),
    "sqrt": lambda of, node, a, da: of.scaled(da, lambda: of.divide(0.5, node), of.greater(a, 0.0)),
    "exp": lambda of, node, a, da: of.multiply(da, node),
    "expm1": lambda of, node, a, da: of.multiply(da, of.add(node, 1.0)),
    "log": lambda of, node, a, da: of.divide(da, a),
    "sin": lambda of, node, a, da: of.multiply(da, of.cos(a)),
    "cos": lambda of, node, a, da: of.negative(of.multiply(da, of.sin(a))),
    "tan": lambda of, node, a, da: of.multiply(da, of.add(1.0, of.multiply(node, node))),
    "arctan2": _arctan2,
    "power": _power,
    "maximum": lambda of, node, a, b, da, db: of.where(of.greater_equal(a, b), da, db),
    "minimum": lambda of, node, a, b, da, db: of.where(of.less_equal(a, b), da, db),
    "where": lambda of, node, c, a, b, dc, da, db: of.where(c, da, db),
}
"""From an operation's node, operands and their tangents to its own; without a rule it is 0."""
