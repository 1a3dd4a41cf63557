"""Vectors in expression graphs, which trace components one by one: products and lengths of three of them."""

from __future__ import annotations

from typing import Any, TypeAlias

from lookdev.codegen.trace.graph import Node

Triple: TypeAlias = tuple[Any, Any, Any]
"""The components of a vector: nodes and numbers."""


def match_dot(node: Node) -> tuple[Triple, Triple] | None:
    """Return the two vectors whose dot product a node is, if it is one."""
    factor: Any = None
    if node.op == "multiply" and not isinstance(node.args[1], Node):
        # A mean of three.
        node, factor = node.args
    summands = _summands(node)
    if summands is None:
        return None
    if factor is not None:
        return summands, (factor, factor, factor)
    pairs = [each.args for each in summands if isinstance(each, Node) and each.op == "multiply"]
    if len(pairs) < 3:
        return None
    (a0, b0), (a1, b1), (a2, b2) = pairs
    return (a0, a1, a2), (b0, b1, b2)


def match_normalize(triple: Triple) -> Triple | None:
    """Return the vector that a triple is, divided by its length; None if it is none."""
    if not all(isinstance(each, Node) for each in triple) or len({each.op for each in triple}) > 1:
        return None
    if triple[0].op not in ("multiply", "divide"):
        return None
    (x, length), (y, second), (z, third) = (each.args for each in triple)
    if triple[0].op == "multiply":
        if not is_inverse_root(length):
            return None
        root = length.args[1]
    else:
        root = length
    if length is not second or length is not third or not isinstance(root, Node) or root.op != "sqrt":
        return None
    vector, (square,) = (x, y, z), root.args
    dot = match_dot(square)
    return vector if dot is not None and all(_alike(vector, each) for each in dot) else None


def match_cross(triple: Triple) -> tuple[Triple, Triple] | None:
    """Return the two vectors whose cross product a triple is, if it is one."""
    products: list[Any] = []
    for each in triple:
        if not isinstance(each, Node) or each.op != "subtract":
            return None
        products += each.args
    if not all(isinstance(each, Node) and each.op == "multiply" for each in products):
        return None
    (ay, bz), (az, by), (az_, bx), (ax, bz_), (ax_, by_), (ay_, bx_) = (each.args for each in products)
    if not _alike((ax, ay, az), (ax_, ay_, az_)) or not _alike((bx, by, bz), (bx_, by_, bz_)):
        return None
    return (ax, ay, az), (bx, by, bz)


def _alike(a: Triple, b: Triple) -> bool:
    return all(x is y if isinstance(x, Node) else x == y for x, y in zip(a, b, strict=True))


def _summands(node: Node) -> Triple | None:
    if node.op != "add" or not isinstance(node.args[0], Node) or node.args[0].op != "add":
        return None
    return (*node.args[0].args, node.args[1])


def is_inverse_root(value: Any) -> bool:
    if not isinstance(value, Node) or value.op != "divide":
        return False
    one, root = value.args
    return not isinstance(one, Node) and one == 1.0 and root.op == "sqrt"
