"""Scalar expression graphs: hash-consed nodes, folded as they are built.

Vectors are traced component by component (`symbolic.py`), so that equal components share one computation and a
constant component folds. Equal expressions are the same object; a trivial operation is never a node.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from lookdev.brdf.table import Table
from lookdev.errors import CodegenError

Scalar: TypeAlias = "Node | float | bool"


class Uniform(float):
    """A number that depends on constants of a look alone.

    It folds as every constant does, but is written by a name: looks whose code differs in such numbers alone share it.
    """


@dataclass(frozen=True, eq=False)
class Node:
    """One operation on earlier nodes and constants, or a named symbol (``op == "symbol"``).

    The arguments of ``"look_up"`` are a table, the channel of its colours or None, row and column.
    """

    op: str
    args: tuple[Any, ...]
    graph: Graph

    def operands(self) -> tuple[Node, ...]:
        return tuple(arg for arg in self.args if isinstance(arg, Node))


# Every ufunc a model may use, by NumPy's own name; the same names choose the code in each emitter.
OPERATIONS = frozenset({
    "add", "subtract", "multiply", "divide", "negative", "positive", "absolute", "square", "sqrt", "exp", "expm1",
    "log", "sin", "cos", "tan", "arctan2", "floor", "power", "maximum", "minimum", "greater", "greater_equal", "less",
    "less_equal", "equal", "logical_and", "logical_or", "logical_not", "where",
})  # fmt: skip

# No uniform has one of these values: they simplify code.
_SIMPLE = frozenset({0.0, 1.0, -1.0, 2.0})

# `&`, `|` and `~` on boolean arrays are NumPy's bitwise ufuncs.
_ALIASES = {"bitwise_and": "logical_and", "bitwise_or": "logical_or", "invert": "logical_not"}


class Graph:
    """Builds nodes; one graph per generated shader."""

    def __init__(self) -> None:
        self._nodes: dict[tuple[Any, ...], Node] = {}
        self._facts: dict[Node, bool] = {}

    def assume(self, condition: Node, value: bool = True) -> None:
        """Fold a condition to a constant from now on: it has that value wherever the traced code runs."""
        self._facts[condition] = value

    def symbol(self, name: str) -> Node:
        """Return the node of a named value that is known only at run time."""
        node = self._intern("symbol", (name,))
        assert isinstance(node, Node), "only conditions are assumed"
        return node

    def apply(self, op: str, *args: Any) -> Any:
        """Return the node, or the constant, that is `op` of `args`.

        Raises
        ------
        CodegenError
            `op` is not in `OPERATIONS`.
        """
        op = _ALIASES.get(op, op)
        if op not in OPERATIONS:
            known = ", ".join(sorted(OPERATIONS))
            raise CodegenError(f"a model uses numpy.{op}, which has no generated counterpart; known: {known}")
        if op == "where" and not isinstance(args[0], Node):
            return args[1] if args[0] else args[2]
        if not any(isinstance(arg, Node) for arg in args):
            function: Any = getattr(np, op)
            value = function(*args).item()
            of_look = isinstance(value, float) and any(isinstance(arg, Uniform) for arg in args)
            return uniform(value) if of_look else value
        simple = _simplify(op, args)
        return self._intern(op, args) if simple is None else simple

    def look_up(self, table: Table, channel: int | None, row: Scalar, column: Scalar) -> Scalar:
        """Return the number, or the channel of the colour, in a cell of a table."""
        if isinstance(row, Node) or isinstance(column, Node):
            return self._intern("look_up", (table, channel, row, column))
        found = table.values[int(row), int(column)]
        return float(found if channel is None else found[channel])

    def _intern(self, op: str, args: tuple[Any, ...]) -> Node | bool:
        key = (op, *map(_known, args))
        node = self._nodes.get(key)
        if node is None:
            node = self._nodes[key] = Node(op, args, self)
        return self._facts.get(node, node)


def uniform(value: float) -> float:
    """Return a number as a uniform, unless it is one that simplifies code."""
    return value if value in _SIMPLE else Uniform(value)


def _known(value: Any) -> Any:
    """Return a key of an argument."""
    # The type is part of it because True == 1.0 in Python; the sign because 0.0 == -0.0.
    return value if isinstance(value, Node) else (type(value), str(value))


def _is(value: Any, constant: float) -> bool:
    return not isinstance(value, Node) and bool(value == constant)


def _simplify(op: str, args: tuple[Any, ...]) -> Any:
    """Return what `op` of `args` reduces to, or None. ``x * 0`` is 0, as x is finite in every model."""
    graph: Graph = next(arg.graph for arg in args if isinstance(arg, Node))
    match op, args:
        case "add", (a, b):
            return b if _is(a, 0.0) else a if _is(b, 0.0) else None
        case "subtract", (a, b):
            if a is b:
                return 0.0
            return a if _is(b, 0.0) else graph.apply("negative", b) if _is(a, 0.0) else None
        case "multiply", (a, b):
            if _is(a, 0.0) or _is(b, 0.0):
                return 0.0
            if _is(a, 1.0) or _is(b, 1.0):
                return b if _is(a, 1.0) else a
        case "divide", (a, b):
            if _is(b, 1.0):
                return a
            if a is b:
                return 1.0
            if _is(a, 0.0):
                return 0.0
            if not isinstance(b, Node):
                return graph.apply("multiply", a, graph.apply("divide", 1.0, b))
        case "positive", (a,):
            return a
        case "negative", (a,) if a.op == "negative":
            return a.args[0]
        case "square", (a,):
            return graph.apply("multiply", a, a)
        case "power", (a, b) if _is(b, 1.0):
            return a
        case "power", (a, b) if _is(b, 2.0):
            return graph.apply("multiply", a, a)
        case (("maximum" | "minimum"), (a, b)) if a is b:
            return a
        case "where", (_, a, b):
            if _known(a) == _known(b):
                return a
        case "logical_and", (a, b):
            if not isinstance(a, Node):
                return b if a else False
            if not isinstance(b, Node):
                return a if b else False
        case "logical_or", (a, b):
            if not isinstance(a, Node):
                return True if a else b
            if not isinstance(b, Node):
                return True if b else a
    return None


def in_order(roots: Iterable[Any], stop: Callable[[Node], bool] = lambda node: False) -> Iterator[Node]:
    """Yield each node under `roots` once, after its operands; where `stop` holds, neither the node nor its operands.

    Without recursion: nested expressions make graphs thousands of operations deep.
    """
    seen: set[Node] = set()
    stack = [(root, False) for root in reversed(list(roots)) if isinstance(root, Node)]
    while stack:
        node, operands_done = stack.pop()
        if operands_done:
            yield node
        elif node not in seen and not stop(node):
            seen.add(node)
            stack.append((node, True))
            stack += [(operand, False) for operand in reversed(node.operands())]


def depends_on(roots: Iterable[Any], names: frozenset[str]) -> set[Node]:
    """Return all nodes under `roots` that depend on one of the named symbols."""
    found: set[Node] = set()
    for node in in_order(roots):
        if (node.op == "symbol" and node.args[0] in names) or any(operand in found for operand in node.operands()):
            found.add(node)
    return found


def reachable(roots: Iterable[Any], stop: Iterable[Node] = ()) -> dict[Node, None]:
    """Return all nodes under `roots`, but none that only nodes in `stop` need, in a reproducible order."""
    stops = set(stop)
    seen: dict[Node, None] = {}
    stack = [root for root in roots if isinstance(root, Node)]
    while stack:
        node = stack.pop()
        if node in seen:
            continue
        seen[node] = None
        if node not in stops:
            stack.extend(node.operands())
    return seen
