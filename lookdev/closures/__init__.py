"""Stand-ins: closures of Cycles that approximate a lobe for backends of closures, by model and lobe.

Each lobe has one function and an entry in the `STAND_INS` of its model's file. Factors that depend on the light are
fitted: ``python -m lookdev.closures.fitting`` makes the table of fits.
"""

from __future__ import annotations

from dataclasses import replace

from lookdev.brdf import Array, Lobe
from lookdev.brdf.vectors import scale
from lookdev.closures import disney, pixar
from lookdev.closures.closure import Closure, ClosureKind, StandIn, closure_cosine
from lookdev.errors import CodegenError


def _lambert_closures(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Return Cycles' diffuse closure, which equals Lambert's lobe."""
    return (Closure("diffuse", lobe.values["color"], frame=lobe.frame),)


STAND_INS: dict[tuple[str, str], StandIn] = {
    ("lambert", "diffuse"): _lambert_closures,
    **disney.STAND_INS,
    **pixar.STAND_INS,
}
"""By the names of a model and of a lobe."""


def lobe_closures(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Return the closures that stand for a lobe seen from `wo`, (..., 3).

    Raises
    ------
    CodegenError
        No closures stand for this lobe.
    """
    stand_in = STAND_INS.get((lobe.model, lobe.name))
    if stand_in is None:
        raise CodegenError(
            f"no closures of Cycles stand for lobe '{lobe.name}' of model '{lobe.model}'; backend 'exact' or "
            "'nodes-exact' would be right"
        )
    return tuple(replace(closure, weight=scale(closure.weight, lobe.weight)) for closure in stand_in(lobe, wo))


__all__ = ["STAND_INS", "Closure", "ClosureKind", "closure_cosine", "lobe_closures"]
