"""Looks for tests: they use all lobes of the Disney and Pixar models, two layer modes, and a stack of both models."""

from collections.abc import Sequence
from typing import Any

import pytest

from lookdev.material import Layer


def quick_among(cases: Sequence[Any], quick: Sequence[Any]) -> list[Any]:
    """Return cases as parameters of a test; all but the `quick` ones are marked `proof`, the slow tier of tests."""
    return [pytest.param(*case, marks=() if case in quick else pytest.mark.proof) for case in cases]


def _single(model: str, **inputs: Any) -> tuple[Layer, ...]:
    return (Layer("Layer", model, inputs),)


LOOKS: dict[str, tuple[Layer, ...]] = {
    "diffuse": _single("disney", baseColor=(0.5, 0.4, 0.3), roughness=1.0),
    "cloth": _single("disney", baseColor=(0.3, 0.1, 0.4), roughness=0.8, sheen=1.0, subsurface=0.7, variant="2012"),
    "coated": _single("disney", baseColor=(0.1, 0.2, 0.5), roughness=0.4, clearcoat=1.0, clearcoatGloss=0.5),
    "brushed": _single("disney", baseColor=(0.9, 0.7, 0.4), metallic=1.0, roughness=0.4, anisotropic=0.8),
    "polished": _single("disney", baseColor=(0.9, 0.7, 0.4), metallic=1.0, roughness=0.15),
    "painted": _single("pixar", surfaceColor=(0.7, 0.5, 0.1), roughness=0.3),
    "chrome": _single("pixar", surfaceColor=(0.9, 0.9, 0.8), metallic=1.0, roughness=0.0),
    "leaf": _single("pixar", surfaceColor=(0.3, 0.6, 0.1), roughness=0.7, back=0.5, clear=0.2),
    "frosted": _single("pixar", surfaceColor=(0.8, 0.9, 1.0), roughness=0.35, clear=0.8, back=0.2, ior=1.3),
    "glassy": _single("pixar", surfaceColor=(0.8, 0.9, 1.0), roughness=0.0, clear=1.0, energy="conserving"),
    "net": _single("pixar", surfaceColor=(0.6, 0.6, 0.6), roughness=0.5, clear=0.3, presence=0.4),
    "tilted": _single(
        "pixar",
        surfaceColor=(0.7, 0.7, 0.7),
        roughness=0.4,
        clear=0.5,
        back=0.3,
        diffuseNormal=(0.3, -0.2, 0.9),
        highlightNormal=(-0.4, 0.3, 0.8),
    ),
    "lacquered": (
        Layer("Wood", "pixar", {"surfaceColor": (0.5, 0.3, 0.1), "roughness": 0.7, "back": 0.3}),
        Layer("Lacquer", "pixar", {"surfaceColor": (0.9, 0.5, 0.2), "roughness": 0.15, "clear": 0.9}, 0.8, "transmit"),
    ),
    "mixed": (
        Layer("Leaf", "pixar", {"surfaceColor": (0.3, 0.6, 0.1), "roughness": 0.4, "back": 0.5}),
        Layer("Coat", "disney", {"baseColor": (0.1, 0.2, 0.5), "roughness": 0.4, "clearcoat": 1.0}, 0.4),
    ),
}
