"""Groups of lobes, the diffuse part, colours without noise, and previews of models."""

from typing import Any

import numpy as np
import pytest

from lookdev.brdf import (
    CONTINUOUS_MODELS,
    MODELS,
    StackLayer,
    complete_parameters,
    evaluate,
    evaluate_cosine,
    stack_bsdf,
)
from lookdev.brdf.mixture import Mixture, bsdf_for_views, estimate_albedo, evaluate_diffuse, mean_normal

WO, WI = np.array([0.6, 0.0, 0.8]), np.array([-0.36, 0.48, 0.8])

# The nearly constant lobes of a model, if they are not just the diffuse lobe; all other lobes are highlights.
BROAD = {"pixar": ["diffuse", "diffuseTransmission"], "oren-nayar": ["diffuse", "retroreflection"], "measured": []}


def lambert(grey: float, mask: float = 1.0, **inputs: Any) -> StackLayer:
    return StackLayer("lambert", complete_parameters("lambert", {"reflectance": (grey,) * 3} | inputs), mask)


@pytest.mark.parametrize("model", CONTINUOUS_MODELS)
def test_lobes_are_of_their_groups(model: str) -> None:
    lobes = MODELS[model].bsdf(MODELS[model].complete(MODELS[model].probe)).lobes(WO)
    assert {lobe.model for lobe in lobes} == {model}
    broad = BROAD.get(model, ["diffuse"])
    assert [lobe.name for lobe in lobes if lobe.broad] == broad
    groups = dict.fromkeys(broad, "diffuse") | {"clearcoat": "clearcoat"}
    assert [lobe.group for lobe in lobes] == [groups.get(lobe.name, "specular") for lobe in lobes]
    through = ["diffuseTransmission", "specularTransmission", "refraction"] if model == "pixar" else []
    assert [lobe.name for lobe in lobes if lobe.transmits] == through
    assert [lobe.has_own_horizon for lobe in lobes] == [model == "pixar"] * len(lobes)


def test_the_diffuse_part_and_the_rest_are_all() -> None:
    inputs = {"clearcoat": 1.0, "sheen": 0.5, "roughness": 0.3}
    bsdf = MODELS["disney"].bsdf(complete_parameters("disney", inputs))
    body = MODELS["disney"].bsdf(complete_parameters("disney", inputs | {"metallic": 0.0})).lobes(WO)[0]
    (term,) = Mixture([body], WO).terms(WI)
    np.testing.assert_allclose(evaluate_diffuse(bsdf, WO, WI), term.value, rtol=1e-12)
    np.testing.assert_allclose(evaluate_cosine(bsdf, WO, WI), 0.8 * evaluate(bsdf, WO, WI), rtol=1e-12)
    assert (evaluate_diffuse(bsdf, WO, WI) < evaluate_cosine(bsdf, WO, WI)).all()
    np.testing.assert_array_equal(evaluate(bsdf_for_views(bsdf, WO), WO, WI), evaluate(bsdf, WO, WI))


def test_a_blend_of_diffusers_has_the_mean_of_albedos_and_normals() -> None:
    normal = (0.6, 0.0, 0.8)
    ward = StackLayer("ward", complete_parameters("ward", {"diffuse": (0.5,) * 3, "specular": (0.0,) * 3}))
    blend = stack_bsdf([ward, lambert(0.8, 0.25, normal=normal)])
    mixture = Mixture([lobe for lobe in blend.lobes(WO) if lobe.name == "diffuse"], WO)
    np.testing.assert_allclose(estimate_albedo(mixture), 0.75 * 0.5 + 0.25 * 0.8, rtol=1e-12)
    expected = 0.375 * np.array([0.0, 0.0, 1.0]) + 0.2 * np.array(normal)
    np.testing.assert_allclose(mean_normal(mixture), expected / np.linalg.norm(expected), rtol=1e-12)


KD, KS = (0.2, 0.1, 0.4), (0.1, 0.4, 0.7)
TWO = {"diffuse": KD, "specular": KS}
INDEX: dict[str, Any] = {"eta": (0.2, 0.4, 1.5), "k": (3.0, 2.0, 1.8)}
GOLD = {"fresnel": "conductor", "metallic": 0.25, **INDEX}
BRIGHT = np.array([((e - 1.0) ** 2 + k * k) / ((e + 1.0) ** 2 + k * k) for e, k in zip(*INDEX.values(), strict=True)])
COATED = {"clearcoat": 0.6, "clearcoatGloss": 0.5, "specular": 0.7}
ROUGH = TWO | {"eta": (2.0,) * 3, "externalIor": 1.0, "roughness": 0.09}
GLASS = {"tint": KS, "eta": 2.0, "externalIor": 1.25}
PREVIEWS: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
    ("disney", COATED, {"clearcoat": 0.15, "clearcoatRoughness": np.sqrt(0.0505), "f0": 0.056}),
    ("disney", GOLD | {"baseColor": KD}, {"diffuseColor": 0.75 * np.array(KD) + 0.25 * BRIGHT, "f0": 0.04}),
    ("pixar", {"normalScale": 2.0, "clear": 0.5, "metallic": 0.2}, {"f0": 0.1, "opacity": 0.6}),
    ("pixar", GOLD | {"surfaceColor": KD}, {"diffuseColor": 0.75 * np.array(KD) + 0.25 * BRIGHT}),
    ("lambert", {}, {"roughness": 1.0, "f0": 0.0}),
    ("oren-nayar", {}, {"roughness": 1.0, "f0": 0.0}),
    *(
        (name, TWO | {"exponent": 30.0}, {"diffuseColor": np.minimum(white * np.array(KD), 1.0), "roughness": 0.5})
        for name, white in (("phong", np.pi), ("blinn-phong", np.pi), ("modified-phong", 1.0))
    ),
    ("ward", TWO | {"alphaX": 0.2, "alphaY": 0.05}, {"roughness": 0.01**0.25, "f0": 0.4}),
    ("lafortune", {"exponent1": 30.0}, {"roughness": 0.5}),
    (
        "ashikhmin-shirley",
        TWO | {"exponentU": 24.0, "exponentV": 35.0},
        {"diffuseColor": np.multiply(KD, np.subtract(1.0, KS)), "roughness": (2.0 / 31.0) ** 0.25, "f0": 0.4},
    ),
    ("torrance-sparrow", ROUGH, {"diffuseColor": KD, "metallic": 0.0, "roughness": 0.3, "f0": 0.4 / 9.0}),
    ("torrance-sparrow", TWO | INDEX, {"diffuseColor": KS * BRIGHT, "metallic": 1.0, "f0": (KS * BRIGHT).mean()}),
    ("mirror", {"tint": KS, **INDEX}, {"diffuseColor": KS * BRIGHT, "metallic": 1.0, "roughness": 0.0}),
    ("glass", GLASS, {"diffuseColor": KS, "roughness": 0.0, "opacity": 0.0, "f0": (0.75 / 3.25) ** 2}),
]


@pytest.mark.parametrize(("model", "inputs", "expected"), PREVIEWS)
def test_previews_are_as_by_hand(model: str, inputs: dict[str, Any], expected: dict[str, Any]) -> None:
    preview = MODELS[model].preview.derived(complete_parameters(model, inputs))
    for name, value in expected.items():
        np.testing.assert_allclose(preview[name], value, rtol=1e-12, err_msg=name)
    assert {model for model, *_ in PREVIEWS} == {*MODELS} - {"measured"}


def test_a_measurement_is_previewed_by_its_albedo() -> None:
    inputs = complete_parameters("measured", {"file": "builtin:plastic", "scale": 0.5})
    preview = MODELS["measured"].preview.derived(inputs)
    # The base colour of the measured model, and its highlight, which adds the same to all channels.
    extra = 2.0 * preview["diffuseColor"] - (0.5, 0.2, 0.1)
    np.testing.assert_allclose(extra, extra.mean(), atol=0.02)
    assert 0.03 < extra.mean() < 0.1
    assert preview["f0"] == 0.0


def test_f_is_converted_to_another_space() -> None:
    matrix = np.array([[0.6, 0.3, 0.1], [0.1, 0.8, 0.1], [0.0, 0.2, 0.8]])
    inputs = {"baseColor": (0.9, 0.4, 0.1), "sheen": 1.0}
    disney = MODELS["disney"].bsdf(complete_parameters("disney", inputs))
    expected = matrix @ evaluate(disney, WO, WI)
    np.testing.assert_allclose(evaluate(disney.convert(matrix), WO, WI), expected, rtol=1e-12)
    plain, converted = (bsdf.lobes(WO)[0] for bsdf in (disney, disney.convert(matrix)))
    directions = next(Mixture([plain], WO).terms(WI)).directions
    np.testing.assert_allclose(
        converted.parts["sheen"](directions), matrix @ plain.parts["sheen"](directions), rtol=1e-12
    )
    mirror = MODELS["mirror"].bsdf(complete_parameters("mirror", {"metal": "gold"}))
    (gold,), (blue,) = (bsdf.deltas(WO, np.array(False)) for bsdf in (mirror, mirror.convert(matrix)))
    np.testing.assert_allclose(blue.value, matrix @ gold.value, rtol=1e-12)
