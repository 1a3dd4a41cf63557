"""Recognize dot products, cross products and normalizations in expression graphs, whose nodes are scalars.

The emitters of nodes and of the shading frame write vector operations of Blender and OSL in place of these scalars.
"""

from __future__ import annotations

from typing import TypeAlias, TypeGuard

from lookdev.codegen.trace.graph import GraphNode, Scalar

Triple: TypeAlias = tuple[Scalar, Scalar, Scalar]
"""The three components of a vector, nodes or constants."""


def match_dot(node: GraphNode) -> tuple[Triple, Triple] | None:
    """Return the two vectors whose dot product a node computes; None if the node does not compute one."""
    factor: Scalar | None = None
    total: Scalar = node
    if node.op == "multiply" and not isinstance(node.args[1], GraphNode):
        # The node may compute (x + y + z) c, such as a mean: the dot product of (x, y, z) and (c, c, c).
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
    """Return the vector v if a triple is v / |v|, else None."""
    # The components are divisions by the root of v . v, or products with its inverse.
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
    """Return the two vectors a and b if a triple is their cross product, else None."""
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
    """Return whether two vectors have the same components."""
    return all(x is y if isinstance(x, GraphNode) else x == y for x, y in zip(a, b, strict=True))


def _summands(value: Scalar) -> Triple | None:
    """Return x, y and z if a value is a sum (x + y) + z, else None."""
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
