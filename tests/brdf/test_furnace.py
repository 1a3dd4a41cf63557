"""White surfaces in a furnace: those that reflect more light than they receive, and those that never do."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import pytest
from looks import quick_among

from lookdev.arrays import Floats
from lookdev.brdf import MODELS, complete_parameters
from lookdev.closures.setups import view_at
from lookdev.reference.albedo import integrate_albedo

ANGLES = (0.0, 30.0, 60.0, 80.0, 89.0)
WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
SHINY = {"diffuse": BLACK, "specular": WHITE}
METAL = {"eta": (0.05,) * 3, "k": (20.0,) * 3}
SMITH = {"geometry": "smith"}
MIRROR = {"metallic": 1.0, "baseColor": WHITE}
CONSERVING: list[tuple[str, dict[str, Any]]] = [
    ("lambert", {"reflectance": WHITE}),
    *(("modified-phong", SHINY | {"exponent": e}) for e in (0.0, 1.0, 32.0, 1000.0)),
    *(("ward", SHINY | {"alphaX": x, "alphaY": y}) for x, y in ((0.05, 0.05), (0.15, 0.6), (1.0, 1.0))),
    *(
        ("ashikhmin-shirley", {"diffuse": WHITE, "specular": (rs,) * 3, "exponentU": u, "exponentV": v})
        for rs, (u, v) in product((0.0, 0.3, 1.0), ((0.0, 0.0), (10.0, 500.0), (1000.0, 1000.0)))
    ),
    *(
        ("torrance-sparrow", METAL | {"geometry": g, "distribution": d, "roughness": m})
        for g, d, m in product(("v-groove", "smith"), ("beckmann", "ggx", "blinn", "gaussian"), (0.3, 0.02, 1.0))
    ),
    *(
        ("torrance-sparrow", METAL | {"geometry": g, "distribution": "gtr", "gamma": gamma, "roughness": 0.3})
        for g, gamma in product(("v-groove", "smith"), (2.0, 4.0))
    ),
    *(
        ("disney", MIRROR | {"gamma": gamma, "roughness": roughness, "anisotropic": anisotropic})
        for gamma, roughness, anisotropic in product((2.0, 4.0), (0.2, 1.0), (0.0, 1.0))
    ),
]
# Computed, at the angle of the largest albedo, in degrees.
EXCEEDING: list[tuple[str, dict[str, Any], float, float]] = [
    ("oren-nayar", {"reflectance": WHITE, "sigma": 0.28}, 89.0, 1.043),
    ("oren-nayar", {"reflectance": WHITE, "sigma": 0.2, "interreflection": "none"}, 89.0, 1.014),
    ("phong", {"diffuse": WHITE, "specular": BLACK}, 30.0, np.pi),
    ("blinn-phong", {"diffuse": WHITE, "specular": BLACK}, 30.0, np.pi),
    ("ward", SHINY | {"alphaX": 1.0, "alphaY": 1.0, "variant": "dur"}, 89.0, 4.625),
    ("torrance-sparrow", METAL | {"distribution": "gtr", "gamma": 0.5, "roughness": 0.1, **SMITH}, 89.0, 5.575),
    ("torrance-sparrow", METAL | {"normalisation": "pi", "roughness": 0.02}, 0.0, 4.0 / np.pi),
    # The distribution has a longer tail, as in docs/models.md.
    *(
        ("disney", MIRROR | {"roughness": 0.1, "gamma": gamma, "anisotropic": anisotropic}, angle, expected)
        for anisotropic, angle, values in ((0.0, 85.0, (1.05, 1.85, 3.93)), (1.0, 89.0, (2.15, 12.3, 35.7)))
        for gamma, expected in zip((1.5, 1.0, 0.5), values, strict=True)
    ),
]


def albedos(
    model: str, inputs: dict[str, Any], angles: Sequence[float], cells: tuple[int, int]
) -> tuple[Floats, Floats]:
    """Return the reflected share of light at each angle of view in degrees, (n, 3), and its error."""
    bsdf = MODELS[model].bsdf(complete_parameters(model, inputs))
    results = [integrate_albedo(bsdf, view_at(angle, 17.0), cells) for angle in angles]
    return [np.array([getattr(result, part).sum(axis=0) for result in results]) for part in ("value", "error")]


@pytest.mark.parametrize(("model", "inputs"), CONSERVING, ids=str)
def test_no_more_is_reflected_than_received(model: str, inputs: dict[str, Any]) -> None:
    value, error = albedos(model, inputs, ANGLES, (64, 48))
    assert (value <= 1.0 + error + 1e-9).all()
    assert value.max() > 0.2


@pytest.mark.parametrize(("model", "inputs", "angle", "expected"), EXCEEDING, ids=str)
def test_what_exceeds_1_as_published(model: str, inputs: dict[str, Any], angle: float, expected: float) -> None:
    value, _ = albedos(model, inputs, [angle], (128, 96))
    assert value.max() == pytest.approx(expected, rel=0.02 if model == "disney" else 0.005)


_FILMS = list(product((0.2, 1.0), ((430.0, 1.6), (2500.0, 3.0))))


@pytest.mark.parametrize(("roughness", "film"), quick_among(_FILMS, _FILMS[:1]))
def test_a_film_reflects_no_more_than_arrives(roughness: float, film: tuple[float, float]) -> None:
    inputs = {"roughness": roughness, "filmThickness": film[0], "filmIor": film[1]}
    value, error = albedos("disney", {"metallic": 1.0, "baseColor": (0.9, 0.6, 0.3)} | inputs, ANGLES[::2], (48, 36))
    assert (value <= 1.0 + error + 1e-9).all()
    # A film over a surface that reflects all light changes nothing: the light that enters it comes back.
    white = (MIRROR | inputs | {"filmThickness": thickness} for thickness in (0.0, film[0]))
    bare, coated = (albedos("disney", parameters, (0.0, 60.0, 87.0), (48, 36))[0] for parameters in white)
    np.testing.assert_allclose(coated, bare, atol=2e-3)


_ROUGHNESSES = {"silver": 0.0, "gold": 0.2, "brass": 0.5, "tungsten": 1.0}
_METALS = [(*form, metal) for form in (("disney", 0.0), ("disney", 400.0), ("pixar", 0.0)) for metal in _ROUGHNESSES]
_QUICK = [("disney", 0.0, "gold"), ("pixar", 0.0, "brass"), ("disney", 400.0, "silver")]


@pytest.mark.parametrize(("model", "film", "metal"), quick_among(_METALS, _QUICK))
def test_no_metal_reflects_more_than_a_white_one(model: str, film: float, metal: str) -> None:
    inputs = {"metallic": 1.0, "roughness": _ROUGHNESSES[metal]}
    exact = {"metal": metal} | ({"filmThickness": film} if film else {})
    color = {"baseColor" if model == "disney" else "surfaceColor": WHITE}
    (value, error), (most, more) = (albedos(model, inputs | other, ANGLES, (48, 36)) for other in (exact, color))
    assert (value.sum(axis=-1) > 0.3).all()
    assert (value <= np.minimum(most, 1.0) + error + more).all()
