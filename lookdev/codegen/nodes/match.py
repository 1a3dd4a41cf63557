"""Choose the operation of a Math node of Blender for an operation of an expression graph (`builder` adds the node).

One Math node can replace several operations, such as a product and a sum. The arithmetic of Math nodes differs from
NumPy's only outside the domain of the models: a division by 0 gives 0, as do the square root and the logarithm of a
negative number.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import TypeAlias, TypeGuard

from lookdev.codegen.trace.graph import GraphNode, Scalar, post_order
from lookdev.codegen.trace.vectors import is_inverse_root
from lookdev.errors import CodegenError

Match: TypeAlias = tuple[str, *tuple[Scalar, ...]]
"""The name of an operation of Blender, then its operands. ``"MIX", a, b, t`` is a (1 - t) + b t, by a Mix node."""

# Blender's names of operations, by NumPy's names. Other operations have NumPy's name in capitals. Booleans are 0 and 1.
_NAMES = {
    "exp": "EXPONENT",
    "sin": "SINE",
    "cos": "COSINE",
    "tan": "TANGENT",
    "greater": "GREATER_THAN",
    "less": "LESS_THAN",
    "logical_and": "MULTIPLY",
    "logical_or": "MAXIMUM",
}

_E = 2.718281828459045


def match_operation(node: GraphNode, computed: Container[object] = ()) -> Match:
    """Return the operation of Blender that computes a node of a graph, and its operands.

    A sum with a product becomes one multiply-add, unless the product is in `computed`. These are the values that
    existing nodes compute.
    """
    apply = node.graph.apply
    match node.op, node.args:
        case "look_up", _:
            raise CodegenError("nodes cannot look up measured data; backend 'exact' would be right")
        case "add", (a, b):
            return _match_mix(a, b) or _match_mix(b, a) or _match_multiply_add(a, b, computed) or ("ADD", a, b)
        case "subtract", (a, b) if _is_product(a, computed) and not isinstance(b, GraphNode):
            x, y = a.args
            return "MULTIPLY_ADD", x, y, -b
        case "subtract", (a, GraphNode(args=(x, y)) as b) if _is_product(b, computed) and not isinstance(y, GraphNode):
            return "MULTIPLY_ADD", x, -y, a
        case "subtract", (a, GraphNode(args=(x, y)) as b) if _is_product(b, computed) and not isinstance(x, GraphNode):
            return "MULTIPLY_ADD", y, -x, a
        case "divide", (_, GraphNode() as b) if is_inverse_root(node):
            return "INVERSE_SQRT", b.args[0]
        case "negative", (a,):
            return "MULTIPLY", a, -1.0
        case "log", (a,):
            return "LOGARITHM", a, _E
        case "expm1", (a,):
            # exp(x) - 1 = tanh(x / 2) (exp(x) + 1), which does not lose digits near 0 by cancellation.
            half = GraphNode("tanh", (apply("multiply", a, 0.5),), node.graph)
            return "MULTIPLY_ADD", half, apply("exp", a), half
        case "greater_equal", (a, b):
            return "SUBTRACT", 1.0, apply("less", a, b)
        case "less_equal", (a, b):
            return "SUBTRACT", 1.0, apply("greater", a, b)
        case "equal", (a, b):
            return "SUBTRACT", 1.0, apply("add", apply("less", a, b), apply("greater", a, b))
        case "logical_not", (a,):
            return "SUBTRACT", 1.0, a
        case "where", (GraphNode() as condition, a, b):
            return _match_where(condition, a, b)
        case _:
            return (_NAMES.get(node.op, node.op.upper()), *node.args)


def add_depths(value: Scalar, depths: dict[GraphNode, int]) -> None:
    """Add the depths of a node and of all nodes that it depends on to `depths`.

    The depth of a node is the number of nodes in the longest chain of operations that ends with this node.
    """
    for node in post_order([value], stop=lambda operand: operand in depths):
        depths[node] = 1 + max((depths[operand] for operand in node.operands()), default=0)


def _is_product(value: Scalar, computed: Container[object]) -> TypeGuard[GraphNode]:
    """Return whether a value is a product that can become part of a multiply-add.

    A product cannot if it is in `computed`: a node already computes it. A product with an inverse square root cannot
    either: it is a component of a normalized vector, for which Blender has a node.
    """
    return (
        isinstance(value, GraphNode)
        and value.op == "multiply"
        and value not in computed
        and not any(is_inverse_root(factor) for factor in value.args)
    )


def _match_multiply_add(a: Scalar, b: Scalar, computed: Container[object]) -> Match | None:
    """Return a + b as a ``"MULTIPLY_ADD"`` if a or b is a product, else None."""
    for product, rest in ((a, b), (b, a)):
        if _is_product(product, computed):
            x, y = product.args
            return "MULTIPLY_ADD", x, y, rest
    return None


def _factors(value: Scalar) -> Iterator[tuple[Scalar, Scalar]]:
    """Yield the ways to write a value as a product of two factors."""
    if isinstance(value, GraphNode) and value.op == "multiply":
        x, y = value.args
        yield x, y
        yield y, x
    yield value, 1.0


def _match_mix(p: Scalar, q: Scalar) -> Match | None:
    """Return p + q as a ``"MIX"`` if p = a (1 - t) and q = b t, else None."""
    for rest, a in _factors(p):
        match rest:
            case GraphNode(op="subtract", args=(1.0, t)):
                for factor, b in _factors(q):
                    if factor is t:
                        return "MIX", a, b, t
    return None


def _match_where(condition: Scalar, a: Scalar, b: Scalar) -> Match:
    """Return the operation whose result is `a` where the condition is 1, and `b` where the condition is 0.

    Math nodes only compare by ``<`` and ``>``. The conditions ``>=``, ``<=`` and ``not`` are replaced by their
    opposites, and `a` and `b` are exchanged.
    """
    match condition:
        case GraphNode(op="logical_not", args=(inner,)):
            condition, a, b = inner, b, a
        case GraphNode(op="greater_equal", args=(x, y), graph=graph):
            condition, a, b = graph.apply("less", x, y), b, a
        case GraphNode(op="less_equal", args=(x, y), graph=graph):
            condition, a, b = graph.apply("greater", x, y), b, a
    if not isinstance(b, GraphNode) and b == 0.0:
        return "MULTIPLY", a, condition
    return "MIX", b, a, condition
