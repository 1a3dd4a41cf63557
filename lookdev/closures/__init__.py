"""Approximate each lobe of our models by closures of Cycles, the lobe's stand-ins; backend ``nodes`` renders with them.

For each lobe, a function returns the stand-ins. `STAND_INS` in the model's file has these functions, by the names of
the model and the lobe. The weights of the closures contain exactly the factors of the lobe that depend on the view
alone. The shape of the lobe is fitted. A fitted factor, which depends on the view, restores the lobe's directional
albedo. ``python -m lookdev.closures.fitting`` makes the table of fits.
"""

from __future__ import annotations

from dataclasses import replace

from lookdev.brdf import Array, Lobe
from lookdev.brdf.vectors import scale
from lookdev.closures import disney, pixar
from lookdev.closures.closure import Closure, ClosureKind, StandIn, closure_cosine
from lookdev.errors import CodegenError


def _lambert_closures(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Return Cycles' diffuse closure, which is exactly Lambert's lobe."""
    return (Closure("diffuse", lobe.values["color"], frame=lobe.frame),)


STAND_INS: dict[tuple[str, str], StandIn] = {
    ("lambert", "diffuse"): _lambert_closures,
    **disney.STAND_INS,
    **pixar.STAND_INS,
}
"""The functions that return the closures of a lobe, by the names of the model and of the lobe."""


def lobe_closures(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Return the closures that approximate a lobe for directions `wo`, (..., 3), to the viewer.

    `wo` must be the directions with which the lobe was made. The closures' weights contain the lobe's weight.

    Raises
    ------
    CodegenError
        There is no entry for this lobe in `STAND_INS`, or its function cannot approximate it.
    """
    stand_in = STAND_INS.get((lobe.model, lobe.name))
    if stand_in is None:
        raise CodegenError(
            f"no closures of Cycles stand for lobe '{lobe.name}' of model '{lobe.model}'; backend 'exact' or "
            "'nodes-exact' would be right"
        )
    return tuple(replace(closure, weight=scale(closure.weight, lobe.weight)) for closure in stand_in(lobe, wo))


__all__ = ["STAND_INS", "Closure", "ClosureKind", "closure_cosine", "lobe_closures"]
