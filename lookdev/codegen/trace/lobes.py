"""Trace the lobes of a BSDF at symbolic directions; the emitters of BSDFs use this module.

Lobes that fold to zero are omitted. Conditions that are true wherever the generated code runs are assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lookdev.brdf import Array, Bsdf, Delta, Lobe, Real
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.mixture import LobeTerms, Mixture, estimate_albedo, mean_normal
from lookdev.brdf.vectors import scale
from lookdev.codegen.trace.graph import Graph, GraphNode
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.errors import CodegenError

WO = ("wo_x", "wo_y", "wo_z")
"""Symbols of the direction to the viewer, in the shading frame."""

WI = ("wi_x", "wi_y", "wi_z")
"""Symbols of the direction to the light, in the shading frame."""

INSIDE = "inside"
"""Symbol of a number that is above 0 where the viewer is inside the solid."""


def present_lobes(graph: Graph, bsdf: Bsdf) -> list[Lobe]:
    """Return a BSDF's lobes whose share does not fold to zero, for a view along the symbols `WO`.

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
    """Return a BSDF's terms that scatter along single directions, and do not fold to zero.

    The terms are functions of the symbols `WO` and `INSIDE`.
    """
    deltas = bsdf.deltas(symbols(graph, WO), symbol(graph, INSIDE) > 0.0)
    return [delta for delta in deltas if _can_be_positive(delta.value)]


def continuous_lobes(graph: Graph, bsdf: Bsdf) -> list[Lobe]:
    """Return the lobes of a BSDF as `present_lobes` does, even if the BSDF also scatters along single directions."""
    return [lobe for lobe in bsdf.lobes(symbols(graph, WO)) if _can_be_positive(lobe.share)]


def folded_lobe_count(graph: Graph, bsdf: Bsdf) -> int:
    """Return the number of lobes whose share folds to zero: no code is generated for them."""
    return len(bsdf.lobes(symbols(graph, WO))) - len(continuous_lobes(graph, bsdf))


def lobe_parts(term: LobeTerms) -> dict[str, Array]:
    """Return the parts of a lobe's value (3,) that are recorded in other groups than the lobe's own, by group.

    Parts that fold to zero are left out.
    """
    if term.lobe.transmits:
        return {}
    evaluated = {group: evaluate(term.directions) for group, evaluate in term.lobe.parts.items()}
    parts = {group: replace(term, f=scale(f, term.lobe.weight)).value for group, f in evaluated.items()}
    return {group: part for group, part in parts.items() if _can_be_positive(part)}


def recorded_group(scattering: Lobe | Delta) -> str:
    """Return the group, one of `LOBE_GROUPS`, in which the light of a lobe or of a single direction is recorded.

    `lobe_parts` returns the parts of a lobe's light that are recorded in other groups.
    """
    if scattering.transmits:
        return "transmission"
    return scattering.group if isinstance(scattering, Lobe) else "specular"


def trace_features(mixture: Mixture, deltas: Sequence[Delta]) -> tuple[Array, Array]:
    """Return the albedo (3,), in [0, 1], and the mean normal (3,), which guide a denoiser.

    The albedo includes the light of the single directions. The normal is the mean over the lobes alone.
    """
    albedo: Array = estimate_albedo(mixture) if mixture.lobes else np.zeros(3)
    for delta in deltas:
        albedo = albedo + delta.value
    return np.clip(albedo, 0.0, 1.0), mean_normal(mixture) if mixture.lobes else ZENITH


def _can_be_positive(value: Real) -> bool:
    """Return whether an element of a value is positive, or known only when the generated code runs."""
    return any(isinstance(element, GraphNode) or element > 0.0 for element in elements_of(value))


def trace_mixture(graph: Graph, lobes: Sequence[Lobe]) -> Mixture:
    """Return the mixture of lobes for a view along the symbols `WO`.

    The trace assumes that the viewer is above the horizon and that the sum of the lobes' shares is above 0, wherever
    the code of the mixture runs. It also assumes that a lobe's share is above 0 wherever the code of the lobe runs.
    """
    mixture = Mixture(lobes, symbols(graph, WO))
    assume_positive(graph, mixture.wo[..., 2], mixture.total_share, *(lobe.share for lobe in lobes))
    return mixture


def assume_positive(graph: Graph, *values: Array | float) -> None:
    """Fold the comparison ``value > 0`` of each scalar value to true.

    The caller knows that the values are positive wherever the traced code runs.
    """
    for value in values:
        (condition,) = elements_of(value > 0.0)
        if isinstance(condition, GraphNode):
            graph.assume(condition)
