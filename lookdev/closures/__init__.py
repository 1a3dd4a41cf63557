"""Stand-ins: which of Cycles' own closures stand for a lobe where no other can be had, by model and lobe.

Adding stand-ins for a lobe is one entry of `STAND_INS`. What depends on the light is fitted: ``python -m
lookdev.closures.fitting`` makes the table of fits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from lookdev.brdf import Array, Lobe
from lookdev.brdf.vectors import scale
from lookdev.closures import disney, pixar
from lookdev.closures.closure import Closure, Kind, closure_cosine
from lookdev.errors import CodegenError

StandIn = Callable[[Lobe, Array], tuple[Closure, ...]]
"""From a lobe and the view it was made for, (..., 3), to closures in the shading frame."""

STAND_INS: dict[tuple[str, str], StandIn] = {
    ("disney", "diffuse"): disney.diffuse,
    ("disney", "specular"): disney.specular,
    ("disney", "clearcoat"): disney.clearcoat,
    ("pixar", "diffuse"): pixar.diffuse,
    ("pixar", "specular"): pixar.highlight,
    ("pixar", "reflection"): pixar.highlight,
    ("pixar", "diffuseTransmission"): pixar.diffuse,
    ("pixar", "specularTransmission"): pixar.highlight,
    ("pixar", "refraction"): pixar.highlight,
}
"""By the names of a model and of a lobe."""


def lobe_closures(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Return what stands for a lobe as seen from `wo`, (..., 3).

    Raises
    ------
    CodegenError
        Nothing stands for it.
    """
    stand_in = STAND_INS.get((lobe.model, lobe.name))
    if stand_in is None:
        raise CodegenError(
            f"no closures of Cycles stand for lobe '{lobe.name}' of model '{lobe.model}'; backend 'exact' or "
            "'nodes-exact' would be right"
        )
    return tuple(replace(closure, weight=scale(closure.weight, lobe.weight)) for closure in stand_in(lobe, wo))


__all__ = ["STAND_INS", "Closure", "Kind", "StandIn", "closure_cosine", "lobe_closures"]
