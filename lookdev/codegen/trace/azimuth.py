"""Whether traced lobes change when the frame rotates about its normal: only then does a shader need a tangent.

Expressions are polynomials in the x and y of the directions to viewer and light. A sum of terms
``c (a_x b_x + a_y b_y)`` and ``c (a_x b_y - a_y b_x)`` is invariant under rotation and counts as a constant in the
expressions that contain it. All other expressions, such as the root of an x, or the product of an x with that of a
normal map, are assumed to change.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from lookdev.brdf import Lobe
from lookdev.codegen.trace.graph import Graph, GraphNode, Scalar, Symbol, post_order
from lookdev.codegen.trace.lobes import WI, WO, trace_mixture
from lookdev.codegen.trace.symbolic import elements_of, symbols

Form: TypeAlias = dict[tuple[str, ...], Scalar]
"""A polynomial: its coefficients, which are invariant under rotation, by the sorted names of the factors."""

_ROTATED = (*WO[:2], *WI[:2])
_ACROSS = {name: name[:-1] + {"x": "y", "y": "x"}[name[-1]] for name in _ROTATED}


def depends_on_tangent(graph: Graph, lobes: Sequence[Lobe]) -> bool:
    """Return whether f of lobes, traced in `graph`, depends on the direction of the frame's tangent."""
    terms = trace_mixture(graph, lobes).terms(symbols(graph, WI)) if lobes else ()
    roots = [value for term in terms for value in elements_of(term.value) if isinstance(value, GraphNode)]
    forms: dict[GraphNode, Form | None] = {}
    for node in post_order(roots):
        forms[node] = _form(graph, node, forms)
    return not all(_is_constant(forms[root]) for root in roots)


def _form(graph: Graph, node: GraphNode, forms: Mapping[GraphNode, Form | None]) -> Form | None:
    """Return a node as a polynomial, from those of its operands; None if the node is not a polynomial."""
    if isinstance(node, Symbol):
        return {(node.name,): 1.0} if node.name in _ROTATED else {(): node}
    operand_forms: list[Form | None] = [forms[arg] if isinstance(arg, GraphNode) else {(): arg} for arg in node.args]
    if all(map(_is_constant, operand_forms)):
        return {(): node}
    polynomials = [form for form in operand_forms if form is not None]
    if len(polynomials) < len(operand_forms):
        return None
    form = _combine(graph, node, polynomials)
    if form is None:
        return None
    form = {factors: value for factors, value in form.items() if isinstance(value, GraphNode) or value != 0.0}
    return {(): node} if _is_invariant(graph, form) else form


def _combine(graph: Graph, node: GraphNode, operands: Sequence[Form]) -> Form | None:
    def termwise(function: Callable[..., Scalar], *forms: Form) -> Form:
        factors = dict.fromkeys(factor for form in forms for factor in form)
        return {key: function(*(form.get(key, 0.0) for form in forms)) for key in factors}

    match node.op, operands:
        case (("negative" | "add" | "subtract"), _):
            return termwise(lambda *values: graph.apply(node.op, *values), *operands)
        case "multiply", (a, b):
            product: Form = {}
            for a_factors, x in a.items():
                for b_factors, y in b.items():
                    term: Form = {tuple(sorted((*a_factors, *b_factors))): graph.apply("multiply", x, y)}
                    product = termwise(lambda *values: graph.apply("add", *values), product, term)
            return product
        case "divide", (a, b) if _is_constant(b):
            return termwise(lambda value: graph.apply("divide", value, node.args[1]), a)
        case "where", (condition, a, b) if _is_constant(condition):
            return termwise(lambda *values: graph.apply("where", node.args[0], *values), a, b)
    return None


def _is_constant(form: Form | None) -> bool:
    return form is not None and form.keys() <= {()}


def _is_invariant(graph: Graph, form: Form) -> bool:
    """Return whether a polynomial is a sum of ``c (a_x b_x + a_y b_y)`` and ``c (a_x b_y - a_y b_x)``."""
    for factors, value in form.items():
        if factors and len(factors) != 2:
            return False
        across = form.get(tuple(sorted(_ACROSS[name] for name in factors)))
        if across is not None and len({name[-1] for name in factors}) > 1:
            across = graph.apply("negative", across)
        if across is not value and (isinstance(value, GraphNode) or isinstance(across, GraphNode) or across != value):
            return False
    return True
