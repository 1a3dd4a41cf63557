"""Recognize vector operations in expression graphs, whose nodes are scalars: dot, cross product and normalization."""

from __future__ import annotations

from typing import TypeAlias, TypeGuard

from lookdev.codegen.trace.graph import GraphNode, Scalar

Triple: TypeAlias = tuple[Scalar, Scalar, Scalar]
"""The components of a vector: nodes and numbers."""


def match_dot(node: GraphNode) -> tuple[Triple, Triple] | None:
    """Return the two vectors whose dot product a node is; None if it is not a dot product."""
    factor: Scalar | None = None
    total: Scalar = node
    if node.op == "multiply" and not isinstance(node.args[1], GraphNode):
        # The mean of three numbers is their dot product with a constant vector.
        total, factor = node.args
    summands = _summands(total)
    if summands is None:
        return None
    if factor is not None:
        return summands, (factor, factor, factor)
    pairs = [product.args for product in summands if isinstance(product, GraphNode) and product.op == "multiply"]
    if len(pairs) < 3:
        return None
    (a0, b0), (a1, b1), (a2, b2) = pairs
    return (a0, a1, a2), (b0, b1, b2)


def match_normalize(triple: Triple) -> Triple | None:
    """Return the vector that a triple normalizes; None if it does not normalize any."""
    root: Scalar | None
    match triple:
        case (
            GraphNode(op="divide", args=(x, a)),
            GraphNode(op="divide", args=(y, b)),
            GraphNode(op="divide", args=(z, c)),
        ):
            root = a
        case (
            GraphNode(op="multiply", args=(x, a)),
            GraphNode(op="multiply", args=(y, b)),
            GraphNode(op="multiply", args=(z, c)),
        ):
            root = a.args[1] if is_inverse_root(a) else None
        case _:
            return None
    match root:
        case GraphNode(op="sqrt", args=(GraphNode() as square,)) if a is b and a is c:
            factors = match_dot(square)
            return (x, y, z) if factors and all(_is_same((x, y, z), factor) for factor in factors) else None
    return None


def match_cross(triple: Triple) -> tuple[Triple, Triple] | None:
    """Return the two vectors whose cross product a triple is; None if it is not a cross product."""
    products: list[Scalar] = []
    for component in triple:
        if not isinstance(component, GraphNode) or component.op != "subtract":
            return None
        products += component.args
    factors = [product.args for product in products if isinstance(product, GraphNode) and product.op == "multiply"]
    if len(factors) < 6:
        return None
    (a_y, b_z), (a_z, b_y), (a_z2, b_x), (a_x, b_z2), (a_x2, b_y2), (a_y2, b_x2) = factors
    if not _is_same((a_x, a_y, a_z), (a_x2, a_y2, a_z2)) or not _is_same((b_x, b_y, b_z), (b_x2, b_y2, b_z2)):
        return None
    return (a_x, a_y, a_z), (b_x, b_y, b_z)


def _is_same(a: Triple, b: Triple) -> bool:
    return all(x is y if isinstance(x, GraphNode) else x == y for x, y in zip(a, b, strict=True))


def _summands(value: Scalar) -> Triple | None:
    match value:
        case GraphNode(op="add", args=(GraphNode(op="add", args=(x, y)), z)):
            return x, y, z
    return None


def is_inverse_root(value: Scalar) -> TypeGuard[GraphNode]:
    """Return whether a value is ``1 / sqrt(x)``."""
    match value:
        case GraphNode(op="divide", args=(1.0, GraphNode(op="sqrt"))):
            return True
    return False
