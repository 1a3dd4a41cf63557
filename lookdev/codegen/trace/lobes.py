"""A traced BSDF: its lobes, and the conditions that hold wherever their code runs."""

from __future__ import annotations

from collections.abc import Sequence

from lookdev.brdf import Array, Bsdf, Delta, Lobe
from lookdev.brdf.mixture import Mixture
from lookdev.codegen.trace.graph import Graph, Node
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.errors import CodegenError

WO = ("wo_x", "wo_y", "wo_z")
WI = ("wi_x", "wi_y", "wi_z")


INSIDE = "inside"


def present_lobes(graph: Graph, bsdf: Bsdf) -> list[Lobe]:
    """Return the lobes whose share does not fold to zero, seen along the symbols `WO`.

    A BSDF that scatters along single directions, too, raises CodegenError.
    """
    for delta in present_deltas(graph, bsdf):
        raise CodegenError(
            f"'{delta.name}' of model '{delta.model}' is along a single direction; backend 'exact' would be right"
        )
    return continuous_lobes(graph, bsdf)


def present_deltas(graph: Graph, bsdf: Bsdf) -> list[Delta]:
    """Return the terms that scatter along single directions and do not fold to zero, by the symbols `WO`, `INSIDE`."""
    deltas = bsdf.deltas(symbols(graph, WO), symbol(graph, INSIDE) > 0.0)
    return [each for each in deltas if any(isinstance(value, Node) or value > 0.0 for value in elements_of(each.value))]


def continuous_lobes(graph: Graph, bsdf: Bsdf) -> list[Lobe]:
    """Return the lobes as `present_lobes`, of any BSDF."""
    shares = [(lobe, *elements_of(lobe.share)) for lobe in bsdf.lobes(symbols(graph, WO))]
    return [lobe for lobe, share in shares if isinstance(share, Node) or share > 0.0]


def folded_lobes(graph: Graph, bsdf: Bsdf) -> int:
    """Return the number of lobes whose share folds to zero: no code is generated for them."""
    return len(bsdf.lobes(symbols(graph, WO))) - len(continuous_lobes(graph, bsdf))


def trace_mixture(graph: Graph, lobes: Sequence[Lobe]) -> Mixture:
    """Return the mixture of lobes seen along the symbols `WO`, above the horizon, where each lobe has a share."""
    mixture = Mixture(lobes, symbols(graph, WO))
    assume_positive(graph, mixture.wo[..., 2], mixture.total, *(lobe.share for lobe in lobes))
    return mixture


def assume_positive(graph: Graph, *values: Array | float) -> None:
    """Fold the comparison with zero of values () that are positive wherever the traced code runs."""
    for value in values:
        (condition,) = elements_of(value > 0.0)
        if isinstance(condition, Node):
            graph.assume(condition)
