"""Mirror and glass: the laws of their directions and values."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from film_reference import complex_fresnel

from lookdev.brdf import MODELS, Delta, StackLayer, complete_parameters, evaluate, pdf, sample, stack_bsdf

DELTA = [name for name, model in MODELS.items() if model.delta]
OUTSIDE, INSIDE = np.asarray(False), np.asarray(True)


def deltas(model: str, wo: Any, inside: Any = OUTSIDE, **inputs: Any) -> tuple[Delta, ...]:
    return MODELS[model].bsdf(complete_parameters(model, inputs)).deltas(np.asarray(wo, np.float64), inside)


def view(cosine: Any, azimuth: float = 0.7) -> Any:
    cosine = np.asarray(cosine, np.float64)
    sine = np.sqrt(1.0 - cosine * cosine)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)


def test_a_mirror_follows_fresnel_for_each_channel() -> None:
    """The expected value is the complex formula of Born and Wolf, 14.2."""
    cosine, eta, k = np.linspace(1e-3, 1.0, 50)[:, None], np.array([0.2, 1.4, 3.0]), np.array([3.9, 0.1, 0.0])
    (only,) = deltas("mirror", view(cosine[:, 0]), eta=tuple(eta), k=tuple(k), tint=(0.5, 1.0, 0.25))
    expected = complex_fresnel(cosine, eta + 1j * k) * (0.5, 1.0, 0.25)
    np.testing.assert_allclose(only.value, expected, rtol=1e-12)
    np.testing.assert_array_equal(only.direction, view(cosine[:, 0]) * (-1.0, -1.0, 1.0))


@pytest.mark.parametrize(("eta", "outer"), [(1.5, 1.0), (1.5, 1.33), (1.2, 2.0), (0.8, 1.0)])
@pytest.mark.parametrize("inside", [OUTSIDE, INSIDE], ids=["outside", "inside"])
def test_glass_refracts_by_snell_and_keeps_power(eta: float, outer: float, inside: Any) -> None:
    eta_i, eta_t = (eta, outer) if inside else (outer, eta)
    wo = view(np.linspace(0.02, 1.0, 60))
    reflected, refracted = deltas("glass", wo, inside, eta=eta, externalIor=outer)
    total = eta_i * np.sqrt(1.0 - wo[:, 2] ** 2) >= eta_t
    assert (refracted.direction[:, 2] < 0.0).tolist() == (~total).tolist()
    np.testing.assert_allclose(eta_i * wo[~total, :2], -eta_t * refracted.direction[~total, :2], rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(refracted.direction[~total], axis=-1), 1.0, rtol=1e-12)
    np.testing.assert_array_equal(reflected.direction, wo * (-1.0, -1.0, 1.0))
    # Power is radiance times solid angle; refraction scales the solid angle by the square of the ratio of indices.
    np.testing.assert_allclose(reflected.value + refracted.value * (eta_t / eta_i) ** 2, 1.0, rtol=1e-12)
    np.testing.assert_array_equal(reflected.value[total], 1.0)
    # Helmholtz reciprocity: the same share passes in the reverse direction.
    back = -np.asarray(refracted.direction[~total])
    _, returned = deltas("glass", back, ~np.asarray(inside), eta=eta, externalIor=outer)
    scaled = returned.value * (eta_i / eta_t) ** 2
    np.testing.assert_allclose(scaled, refracted.value[~total] * (eta_t / eta_i) ** 2, rtol=1e-9)


def test_glass_agrees_with_the_oracle_of_dielectrics() -> None:
    text = (Path(__file__).parents[1] / "oracles" / "fresnel.jsonl").read_text(encoding="utf-8")
    lines = [json.loads(line) for line in text.splitlines()]
    cases = [line for line in lines if line["params"]["k"] == 0.0 and line["params"]["polarisation"] == 0.5]
    assert len(cases) > 5
    for line in cases:
        inputs = {"eta": line["params"]["eta"], "externalIor": line["params"]["externalIor"]}
        reflected, _ = deltas("glass", view(line["cosTheta"]), **inputs)
        np.testing.assert_allclose(reflected.value, line["F"], rtol=1e-9)


@pytest.mark.parametrize("model", DELTA)
def test_f_is_zero_and_nothing_is_drawn(model: str) -> None:
    bsdf = MODELS[model].bsdf(complete_parameters(model, {}))
    wo, wi = view([0.3, 0.9]), view([0.5, 0.2], 2.0)
    assert not evaluate(bsdf, wo, wi).any()
    assert not pdf(bsdf, wo, wi).any()
    assert not sample(bsdf, wo, np.full((2, 2), 0.5))[:, 2].any()


@pytest.mark.parametrize("model", DELTA)
@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_extremes_are_finite_and_bounded(model: str, precision: Any) -> None:
    rng, count = np.random.default_rng(5), 100_000
    inputs: dict[str, Any] = {}
    for name, parameter in MODELS[model].parameters.items():
        shape = (count,) if parameter.kind == "float" else (count, 3)
        low, high = parameter.hard
        edge = rng.choice([low, high, max(low, 1.0), np.nextafter(max(low, 1.0), 2.0)], shape)
        inputs[name] = np.where(rng.random(shape) < 0.3, edge, rng.uniform(low, high, shape)).astype(precision)
    inputs["normal"] = (inputs["normal"] + (0.0, 0.0, 1e-3)).astype(precision)
    wo = view(np.where(rng.random(count) < 0.2, rng.choice([1e-7, 1.0], count), rng.uniform(1e-6, 1.0, count)))
    for delta in MODELS[model].bsdf(inputs).deltas(wo.astype(precision), rng.random(count) < 0.5):
        value, direction = np.asarray(delta.value), np.asarray(delta.direction)
        assert np.isfinite(value).all()
        assert np.isfinite(direction).all()
        assert (value >= 0.0).all()
        exists = direction[:, 2] != 0.0
        np.testing.assert_allclose(np.linalg.norm(direction[exists], axis=-1), 1.0, atol=1e-5)
        assert ((direction[exists, 2] < 0.0) == delta.transmits).all()


def test_in_a_blend_terms_have_their_weights() -> None:
    masks = {"disney": 1.0, "glass": 0.25, "mirror": 0.5}
    stack = stack_bsdf([StackLayer(model, complete_parameters(model, {}), mask) for model, mask in masks.items()])
    wo = view(0.6)
    terms = stack.deltas(wo, OUTSIDE)
    assert [term.name for term in terms] == ["reflection", "refraction", "reflection"]
    alone = (*deltas("glass", wo), *deltas("mirror", wo))
    for term, layer_term, weight in zip(terms, alone, (0.125, 0.125, 0.5), strict=True):
        np.testing.assert_allclose(term.value, weight * np.asarray(layer_term.value), rtol=1e-12)
