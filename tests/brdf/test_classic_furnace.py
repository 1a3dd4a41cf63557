"""White classics in a furnace, at 20 angles: which reflect more than they receive, and which never do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lookdev.brdf import MODELS, complete_parameters
from lookdev.closures.setups import view_at
from lookdev.reference.albedo import integrate_albedo

WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
SHINY = {"diffuse": BLACK, "specular": WHITE}
METAL = {"eta": (0.05,) * 3, "k": (20.0,) * 3}
GEOMETRIES, DISTRIBUTIONS = ("v-groove", "smith"), ("beckmann", "ggx", "blinn", "gaussian")
CONSERVING: list[tuple[str, dict[str, Any]]] = [
    ("lambert", {"reflectance": WHITE}),
    *(("modified-phong", SHINY | {"exponent": e}) for e in (0.0, 1.0, 32.0, 1000.0)),
    *(("ward", SHINY | {"alphaX": x, "alphaY": y}) for x, y in ((0.05, 0.05), (0.15, 0.6), (0.3, 0.3), (1.0, 1.0))),
    *(
        ("ashikhmin-shirley", {"diffuse": WHITE, "specular": (rs,) * 3, "exponentU": u, "exponentV": v})
        for rs in (0.0, 0.3, 1.0)
        for u, v in ((0.0, 0.0), (10.0, 10.0), (10.0, 500.0), (1000.0, 1000.0))
    ),
    *(
        ("torrance-sparrow", METAL | {"geometry": geometry, "distribution": distribution, "roughness": m})
        for geometry in GEOMETRIES
        for distribution in DISTRIBUTIONS
        for m in (0.02, 0.3, 1.0)
    ),
    *(
        ("torrance-sparrow", METAL | {"geometry": geometry, "distribution": "gtr", "gamma": gamma, "roughness": 0.3})
        for geometry in GEOMETRIES
        for gamma in (2.0, 3.0, 4.0)
    ),
]
# Computed, most at 89 degrees but for Phong's line.
EXCEEDING: list[tuple[str, dict[str, Any], float]] = [
    ("oren-nayar", {"reflectance": WHITE, "sigma": 0.28}, 1.043),
    ("oren-nayar", {"reflectance": WHITE, "sigma": 0.2, "interreflection": "none"}, 1.014),
    ("phong", {"diffuse": WHITE, "specular": BLACK}, np.pi),
    ("blinn-phong", {"diffuse": WHITE, "specular": BLACK}, np.pi),
    ("ward", SHINY | {"alphaX": 1.0, "alphaY": 1.0, "variant": "dur"}, 4.625),
    ("torrance-sparrow", METAL | {"geometry": "smith", "distribution": "gtr", "gamma": 0.5, "roughness": 0.1}, 5.575),
    ("torrance-sparrow", METAL | {"normalisation": "pi", "roughness": 0.02}, 4.0 / np.pi),
]


def largest(model: str, given: dict[str, Any]) -> tuple[float, float]:
    """Return the greatest albedo of 20 views, and the error of its quadrature."""
    bsdf = MODELS[model].bsdf(complete_parameters(model, given))
    albedos = (integrate_albedo(bsdf, view_at(angle, 0.0), (96, 64)) for angle in np.linspace(0.0, 89.0, 20))
    return max((float(each.value.sum(axis=0).max()), float(each.error.sum(axis=0).max())) for each in albedos)


@pytest.mark.parametrize(("model", "given"), CONSERVING, ids=str)
def test_no_more_is_reflected_than_received(model: str, given: dict[str, Any]) -> None:
    albedo, error = largest(model, given)
    assert albedo <= 1.0 + error


@pytest.mark.parametrize(("model", "given", "expected"), EXCEEDING, ids=str)
def test_what_exceeds_1_as_published(model: str, given: dict[str, Any], expected: float) -> None:
    assert largest(model, given)[0] == pytest.approx(expected, rel=0.005)
