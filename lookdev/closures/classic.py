"""Closures of Cycles that stand for lobes of the classic models (`lookdev.brdf.classic`): Lambert's alone."""

from __future__ import annotations

from lookdev.brdf.lobes import Lobe
from lookdev.brdf.vectors import Array
from lookdev.closures.closure import Closure, StandIn


def lambert_closures(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Return Cycles' diffuse closure, which equals the lobe."""
    return (Closure("diffuse", lobe.values["color"], frame=lobe.frame),)


STAND_INS: dict[tuple[str, str], StandIn] = {
    ("lambert", "diffuse"): lambert_closures,
}
"""By the names of the model and of a lobe."""
