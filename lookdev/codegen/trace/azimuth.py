"""Whether traced lobes change as the frame is turned about its normal: only then does a shader need a tangent.

Expressions are polynomials in the x and y of the directions to viewer and light. One that no turn changes, a sum of
terms ``c (a_x b_x + a_y b_y)`` and ``c (a_x b_y - a_y b_x)``, counts as a constant of what is computed from it. All
other expressions, such as the root of an x or its product with the x of a normal map, are taken to change.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

from lookdev.brdf import Lobe
from lookdev.codegen.trace.graph import Graph, Node, Scalar, in_order
from lookdev.codegen.trace.lobes import WI, WO, trace_mixture
from lookdev.codegen.trace.symbolic import elements_of, symbols

Form: TypeAlias = dict[tuple[str, ...], Scalar]
"""A polynomial: its coefficients, which no turn changes, by the sorted names of the factors."""

_TURNED = (*WO[:2], *WI[:2])
_ACROSS = {name: name[:-1] + {"x": "y", "y": "x"}[name[-1]] for name in _TURNED}


def reads_tangent(graph: Graph, lobes: Sequence[Lobe]) -> bool:
    """Return whether f of lobes, traced in `graph`, depends on the direction of the frame's tangent."""
    terms = trace_mixture(graph, lobes).terms(symbols(graph, WI)) if lobes else ()
    roots = [each for term in terms for each in elements_of(term.value) if isinstance(each, Node)]
    forms: dict[Node, Form | None] = {}
    for node in in_order(roots):
        forms[node] = _form(graph, node, forms)
    return not all(_is_constant(forms[root]) for root in roots)


def _form(graph: Graph, node: Node, forms: Mapping[Node, Form | None]) -> Form | None:
    """Return the polynomial that a node is, by those of its operands; None where it is none."""
    if node.op == "symbol":
        name = str(node.args[0])
        return {(name,): 1.0} if name in _TURNED else {(): node}
    given: list[Form | None] = [forms[arg] if isinstance(arg, Node) else {(): arg} for arg in node.args]
    if all(map(_is_constant, given)):
        return {(): node}
    known = [each for each in given if each is not None]
    if len(known) < len(given):
        return None
    found = _combined(graph, node, known)
    if found is None:
        return None
    found = {factors: value for factors, value in found.items() if isinstance(value, Node) or value != 0.0}
    return {(): node} if _is_unturned(graph, found) else found


def _combined(graph: Graph, node: Node, operands: Sequence[Form]) -> Form | None:
    def termwise(function: Callable[..., Scalar], *forms: Form) -> Form:
        factors = dict.fromkeys(factor for form in forms for factor in form)
        return {each: function(*(form.get(each, 0.0) for form in forms)) for each in factors}

    match node.op, operands:
        case (("negative" | "add" | "subtract"), _):
            return termwise(lambda *values: graph.apply(node.op, *values), *operands)
        case "multiply", (a, b):
            product: Form = {}
            for left, x in a.items():
                for right, y in b.items():
                    term: Form = {tuple(sorted((*left, *right))): graph.apply("multiply", x, y)}
                    product = termwise(lambda *values: graph.apply("add", *values), product, term)
            return product
        case "divide", (a, b) if _is_constant(b):
            return termwise(lambda value: graph.apply("divide", value, node.args[1]), a)
        case "where", (condition, a, b) if _is_constant(condition):
            return termwise(lambda *values: graph.apply("where", node.args[0], *values), a, b)
    return None


def _is_constant(form: Form | None) -> bool:
    return form is not None and form.keys() <= {()}


def _is_unturned(graph: Graph, form: Form) -> bool:
    """Return whether a polynomial is a sum of ``c (a_x b_x + a_y b_y)`` and ``c (a_x b_y - a_y b_x)``."""
    for factors, value in form.items():
        if factors and len(factors) != 2:
            return False
        across: Any = form.get(tuple(sorted(_ACROSS[name] for name in factors)))
        if across is not None and len({name[-1] for name in factors}) > 1:
            across = graph.apply("negative", across)
        if across is not value and (isinstance(value, Node) or isinstance(across, Node) or across != value):
            return False
    return True
