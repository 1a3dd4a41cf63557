"""Find out whether traced lobes depend on the frame's tangent: only then must a shader read tangents of the mesh.

Lobes do not depend on the tangent if their values stay the same when the frame rotates about its normal. To show this,
each expression of the traced graph is written as a polynomial in the x and y of the directions a and b to viewer and
light. A sum of terms ``c (a_x b_x + a_y b_y)`` and ``c (a_x b_y - a_y b_x)`` is invariant under the rotation, and
counts as a constant in the expressions that contain it. All other expressions are assumed to change, such as the root
of an x, or the product of an x with the x of a normal map.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from lookdev.brdf import Lobe
from lookdev.codegen.trace.graph import Graph, GraphNode, Scalar, Symbol, post_order
from lookdev.codegen.trace.lobes import WI, WO, trace_mixture
from lookdev.codegen.trace.symbolic import elements_of, symbols

Polynomial: TypeAlias = dict[tuple[str, ...], Scalar]
"""A polynomial: the coefficient of each product of symbols, by the sorted names of these symbols.

Coefficients are invariant under rotation. The constant term has the key ``()``.
"""

# The symbols that change with the rotation, and for each the symbol of the same direction's other component: "wo_y" for
# "wo_x".
_ROTATED = (*WO[:2], *WI[:2])
_OTHER_AXIS = {name: name[:-1] + {"x": "y", "y": "x"}[name[-1]] for name in _ROTATED}


def depends_on_tangent(graph: Graph, lobes: Sequence[Lobe]) -> bool:
    """Return whether the f of lobes, traced in `graph`, depends on the direction of the frame's tangent."""
    terms = trace_mixture(graph, lobes).terms(symbols(graph, WI)) if lobes else ()
    roots = [value for term in terms for value in elements_of(term.value) if isinstance(value, GraphNode)]
    polynomials: dict[GraphNode, Polynomial | None] = {}
    for node in post_order(roots):
        polynomials[node] = _node_polynomial(graph, node, polynomials)
    return not all(_is_constant(polynomials[root]) for root in roots)


def _node_polynomial(
    graph: Graph, node: GraphNode, earlier: Mapping[GraphNode, Polynomial | None]
) -> Polynomial | None:
    """Return the polynomial of a node, or None if the node is not a polynomial.

    `earlier` has the results of this function for the node's operands.
    """
    if isinstance(node, Symbol):
        return {(node.name,): 1.0} if node.name in _ROTATED else {(): node}
    operands: list[Polynomial | None] = [earlier[arg] if isinstance(arg, GraphNode) else {(): arg} for arg in node.args]
    if all(map(_is_constant, operands)):
        return {(): node}
    polynomials = [operand for operand in operands if operand is not None]
    combined = _combine_polynomials(graph, node, polynomials) if len(polynomials) == len(operands) else None
    if combined is None:
        return None
    nonzero = {factors: value for factors, value in combined.items() if isinstance(value, GraphNode) or value != 0.0}
    return {(): node} if _is_invariant(graph, nonzero) else nonzero


def _combine_polynomials(graph: Graph, node: GraphNode, operands: Sequence[Polynomial]) -> Polynomial | None:
    """Return the polynomial of a node, or None if the node's operation does not give a polynomial.

    `operands` are the polynomials of the node's operands.
    """

    def termwise(function: Callable[..., Scalar], *polynomials: Polynomial) -> Polynomial:
        """Compute a polynomial term by term: `function` takes the coefficients of one product in all `polynomials`."""
        factors = dict.fromkeys(factor for polynomial in polynomials for factor in polynomial)
        return {key: function(*(polynomial.get(key, 0.0) for polynomial in polynomials)) for key in factors}

    match node.op, operands:
        case (("negative" | "add" | "subtract"), _):
            return termwise(lambda *values: graph.apply(node.op, *values), *operands)
        case "multiply", (a, b):
            product: Polynomial = {}
            for a_factors, x in a.items():
                for b_factors, y in b.items():
                    term: Polynomial = {tuple(sorted((*a_factors, *b_factors))): graph.apply("multiply", x, y)}
                    product = termwise(lambda *values: graph.apply("add", *values), product, term)
            return product
        case "divide", (a, b) if _is_constant(b):
            return termwise(lambda value: graph.apply("divide", value, node.args[1]), a)
        case "where", (condition, a, b) if _is_constant(condition):
            return termwise(lambda *values: graph.apply("where", node.args[0], *values), a, b)
    return None


def _is_constant(polynomial: Polynomial | None) -> bool:
    """Return whether a polynomial has no terms besides the constant one."""
    return polynomial is not None and polynomial.keys() <= {()}


def _is_invariant(graph: Graph, polynomial: Polynomial) -> bool:
    """Return whether a polynomial is a sum of ``c (a_x b_x + a_y b_y)``, ``c (a_x b_y - a_y b_x)`` and a constant."""
    # The partner of a term has the other axis of both factors. Its coefficient is the same for a_x b_x and a_y b_y, and
    # opposite for a_x b_y and a_y b_x.
    for factors, value in polynomial.items():
        if factors and len(factors) != 2:
            return False
        partner = polynomial.get(tuple(sorted(_OTHER_AXIS[name] for name in factors)))
        if partner is not None and len({name[-1] for name in factors}) > 1:
            partner = graph.apply("negative", partner)
        is_node = isinstance(value, GraphNode) or isinstance(partner, GraphNode)
        if partner is not value and (is_node or partner != value):
            return False
    return True
