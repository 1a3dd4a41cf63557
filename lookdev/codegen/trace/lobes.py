"""A traced BSDF: its lobes, and the conditions that are true wherever their code runs."""

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
    """Return the lobes whose share does not fold to zero, for a view along the symbols `WO`.

    Raises
    ------
    CodegenError
        The BSDF also scatters along single directions.
    """
    for delta in present_deltas(graph, bsdf):
        raise CodegenError(
            f"'{delta.name}' of model '{delta.model}' is along a single direction; backend 'exact' would be right"
        )
    return continuous_lobes(graph, bsdf)


def present_deltas(graph: Graph, bsdf: Bsdf) -> list[Delta]:
    """Return the terms along single directions that do not fold to zero, as functions of the symbols `WO`, `INSIDE`."""
    deltas = bsdf.deltas(symbols(graph, WO), symbol(graph, INSIDE) > 0.0)
    return [
        delta for delta in deltas if any(isinstance(value, Node) or value > 0.0 for value in elements_of(delta.value))
    ]


def continuous_lobes(graph: Graph, bsdf: Bsdf) -> list[Lobe]:
    """Return the lobes as `present_lobes` does, also of a BSDF that scatters along single directions."""
    shares = [(lobe, elements_of(lobe.share)[0]) for lobe in bsdf.lobes(symbols(graph, WO))]
    return [lobe for lobe, share in shares if isinstance(share, Node) or share > 0.0]


def folded_lobes(graph: Graph, bsdf: Bsdf) -> int:
    """Return the number of lobes whose share folds to zero: no code is generated for them."""
    return len(bsdf.lobes(symbols(graph, WO))) - len(continuous_lobes(graph, bsdf))


def trace_mixture(graph: Graph, lobes: Sequence[Lobe]) -> Mixture:
    """Return the mixture of lobes for a view along the symbols `WO`.

    Its code runs only above the horizon, where each lobe has a share above 0.
    """
    mixture = Mixture(lobes, symbols(graph, WO))
    assume_positive(graph, mixture.wo[..., 2], mixture.total, *(lobe.share for lobe in lobes))
    return mixture


def assume_positive(graph: Graph, *values: Array | float) -> None:
    """Fold the comparisons with zero of scalar values that are positive wherever the traced code runs."""
    for value in values:
        (condition,) = elements_of(value > 0.0)
        if isinstance(condition, Node):
            graph.assume(condition)
