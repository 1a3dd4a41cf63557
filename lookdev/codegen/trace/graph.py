"""The expression graph that a traced model builds, and from which all emitters write code.

A node is a scalar operation on earlier nodes and constants. Equal expressions are the same object (hash consing). An
operation on constants folds to a constant, and a trivial operation, such as ``x + 0``, is never a node. Vectors are
traced component by component (`trace.symbolic`), so components are also shared and folded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from lookdev.brdf.table import NumberTable
from lookdev.errors import CodegenError

Scalar: TypeAlias = "GraphNode | float | bool"
"""A traced number or boolean: a node of the graph, or a constant."""


class Uniform(float):
    """A constant that is computed from the constants of a look.

    It folds like other constants, but generated code refers to it by a name. Looks that differ only in such numbers
    have the same code.
    """


@dataclass(frozen=True, eq=False)
class GraphNode:
    """One operation on earlier nodes and constants.

    `op` is a name in `OPERATIONS`, ``"symbol"`` or ``"look_up"``. `args` are the operands.
    """

    op: str
    args: tuple[Scalar, ...]
    graph: Graph

    def operands(self) -> tuple[GraphNode, ...]:
        """Return the operands that are nodes."""
        return tuple(arg for arg in self.args if isinstance(arg, GraphNode))


@dataclass(frozen=True, eq=False)
class Symbol(GraphNode):
    """A named value that is known only when the generated code runs."""

    name: str


@dataclass(frozen=True, eq=False)
class TableCell(GraphNode):
    """A number that is looked up in a table; `args` are the row and the column.

    If the cells of the table are colours, the number is channel 0, 1 or 2; else `channel` is None.
    """

    table: NumberTable
    channel: int | None


# The ufuncs and functions that a model may use, by NumPy's names. Emitters look up their code by these names.
OPERATIONS = frozenset({
    "add", "subtract", "multiply", "divide", "negative", "positive", "absolute", "square", "sqrt", "exp", "expm1",
    "log", "sin", "cos", "tan", "arctan2", "floor", "power", "maximum", "minimum", "greater", "greater_equal", "less",
    "less_equal", "equal", "logical_and", "logical_or", "logical_not", "where",
})  # fmt: skip

# These values simplify code, so they never become uniforms.
_SIMPLIFYING_VALUES = frozenset({0.0, 1.0, -1.0, 2.0})

# `&`, `|` and `~` on boolean arrays are NumPy's bitwise ufuncs.
_ALIASES = {"bitwise_and": "logical_and", "bitwise_or": "logical_or", "invert": "logical_not"}


class Graph:
    """The graph of one generated shader. It creates equal nodes only once."""

    def __init__(self) -> None:
        # The nodes, by the operation and the keys of its arguments; and the values of the conditions that are assumed.
        self._nodes: dict[tuple[object, ...], GraphNode] = {}
        self._facts: dict[Scalar, bool] = {}

    def assume(self, condition: Scalar, value: bool = True) -> None:
        """Replace a condition by the constant `value` from now on.

        The caller knows that the condition has this value wherever the traced code runs.
        """
        self._facts[condition] = value

    def symbol(self, name: str) -> Symbol:
        """Return the node of a named value that is known only when the generated code runs."""
        node = self._intern(Symbol("symbol", (), self, name), name)
        assert isinstance(node, Symbol), "only conditions are assumed"
        return node

    def apply(self, op: str, *args: Scalar) -> Scalar:
        """Return the result of an operation: a node, or a constant if the operation folds.

        Raises
        ------
        CodegenError
            `op` is not in `OPERATIONS`.
        """
        op = _ALIASES.get(op, op)
        if op not in OPERATIONS:
            supported = ", ".join(sorted(OPERATIONS))
            raise CodegenError(f"a model uses numpy.{op}, which has no generated counterpart; known: {supported}")
        if op == "where" and not isinstance(args[0], GraphNode):
            return args[1] if args[0] else args[2]
        if not any(isinstance(arg, GraphNode) for arg in args):
            function: Callable[..., np.float64 | np.bool_] = getattr(np, op)
            value = function(*args).item()
            has_uniform = isinstance(value, float) and any(isinstance(arg, Uniform) for arg in args)
            return uniform(value) if has_uniform else value
        simplified = _simplify(op, args)
        return self._intern(GraphNode(op, args, self)) if simplified is None else simplified

    def look_up(self, table: NumberTable, channel: int | None, row: Scalar, column: Scalar) -> Scalar:
        """Return the number in a cell of a table, or one channel of the colour there."""
        if isinstance(row, GraphNode) or isinstance(column, GraphNode):
            return self._intern(TableCell("look_up", (row, column), self, table, channel), table, channel)
        cell = table.values[int(row), int(column)]
        return float(cell if channel is None else cell[channel])

    def _intern(self, node: GraphNode, *names: object) -> GraphNode | bool:
        """Return the graph's own node that equals `node`; if there is none, add `node`.

        `names` are properties that distinguish the node, besides its operation and its operands. If the node is a
        condition that `assume` replaces, return the condition's value instead.
        """
        node = self._nodes.setdefault((node.op, *map(_argument_key, (*names, *node.args))), node)
        return self._facts.get(node, node)


def uniform(value: float) -> float:
    """Return a number as a `Uniform`, unless its value simplifies code, as 0 and 1 do."""
    return value if value in _SIMPLIFYING_VALUES else Uniform(value)


def _argument_key(value: object) -> object:
    """Return a dictionary key for an argument; two keys are equal only if the arguments give the same code."""
    # The key contains the type, as True == 1.0 in Python, and the sign, as 0.0 == -0.0.
    return value if isinstance(value, GraphNode) else (type(value), str(value))


def _equals(value: Scalar, constant: float) -> bool:
    """Return whether a value is a certain constant."""
    return not isinstance(value, GraphNode) and bool(value == constant)


def _simplify(op: str, args: tuple[Scalar, ...]) -> Scalar | None:
    """Return a simpler scalar that equals the result of an operation, or None if there is none.

    ``x * 0`` is simplified to 0, which is valid because x is finite in every model.
    """
    graph: Graph = next(arg.graph for arg in args if isinstance(arg, GraphNode))
    match op, args:
        case "add", (a, b):
            return b if _equals(a, 0.0) else a if _equals(b, 0.0) else None
        case "subtract", (a, b):
            if a is b:
                return 0.0
            return a if _equals(b, 0.0) else graph.apply("negative", b) if _equals(a, 0.0) else None
        case "multiply", (a, b):
            if _equals(a, 0.0) or _equals(b, 0.0):
                return 0.0
            if _equals(a, 1.0) or _equals(b, 1.0):
                return b if _equals(a, 1.0) else a
        case "divide", (a, b):
            if _equals(b, 1.0):
                return a
            if a is b:
                return 1.0
            if _equals(a, 0.0):
                return 0.0
            if not isinstance(b, GraphNode):
                return graph.apply("multiply", a, graph.apply("divide", 1.0, b))
        case "positive", (a,):
            return a
        case "negative", (GraphNode(op="negative") as a,):
            return a.args[0]
        case "square", (a,):
            return graph.apply("multiply", a, a)
        case "power", (a, b) if _equals(b, 1.0):
            return a
        case "power", (a, b) if _equals(b, 2.0):
            return graph.apply("multiply", a, a)
        case (("maximum" | "minimum"), (a, b)) if a is b:
            return a
        case "where", (_, a, b):
            if _argument_key(a) == _argument_key(b):
                return a
        case (("logical_and" | "logical_or"), (a, b)):
            deciding = op == "logical_or"  # the boolean operand that alone decides the result
            for truth, other in ((a, b), (b, a)):
                if not isinstance(truth, GraphNode):
                    return deciding if bool(truth) == deciding else other
    return None


def post_order(roots: Iterable[Scalar], stop: Callable[[GraphNode], bool] = lambda node: False) -> Iterator[GraphNode]:
    """Yield `roots` and all nodes that they depend on, each once and after its operands.

    Nodes for which `stop` returns true are left out. Nodes on which only left-out nodes depend are left out, too. The
    function does not recurse, because graphs are thousands of operations deep.
    """
    visited: set[GraphNode] = set()
    stack = [(root, False) for root in reversed(list(roots)) if isinstance(root, GraphNode)]
    while stack:
        node, has_yielded_operands = stack.pop()
        if has_yielded_operands:
            yield node
        elif node not in visited and not stop(node):
            visited.add(node)
            stack.append((node, True))
            stack += [(operand, False) for operand in reversed(node.operands())]


def dependent_nodes(roots: Iterable[Scalar], names: frozenset[str]) -> set[GraphNode]:
    """Return the nodes that depend on one of the named symbols.

    They are selected from `roots` and all nodes that `roots` depend on.
    """
    dependent: set[GraphNode] = set()
    for node in post_order(roots):
        if (isinstance(node, Symbol) and node.name in names) or any(
            operand in dependent for operand in node.operands()
        ):
            dependent.add(node)
    return dependent


def reachable_nodes(roots: Iterable[Scalar], stop: Iterable[GraphNode] = ()) -> dict[GraphNode, None]:
    """Return `roots` and all nodes that they depend on, in a reproducible order, as the keys of a dictionary.

    The operands of nodes in `stop` are left out, unless another node depends on them.
    """
    stops = set(stop)
    visited: dict[GraphNode, None] = {}
    stack = [root for root in roots if isinstance(root, GraphNode)]
    while stack:
        node = stack.pop()
        if node in visited:
            continue
        visited[node] = None
        if node not in stops:
            stack.extend(node.operands())
    return visited
