"""Stacks of layers: Disney's blend parameters, Pixar's combine lobes, different models blend BSDFs."""

from itertools import permutations
from typing import Any

import numpy as np
import pytest
from random_parameters import Floats, directions, random_parameters

from lookdev.brdf import (
    CONTINUOUS_MODELS,
    MODELS,
    StackLayer,
    complete_parameters,
    evaluate,
    evaluate_cosine,
    pdf,
    stack_bsdf,
)
from lookdev.brdf.stack import find_mode_conflict
from lookdev.errors import ModelError

_COUNT = 500


def _directions(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return views above the horizon, and lights on both sides of it."""
    return directions(rng, _COUNT), directions(rng, _COUNT) * rng.choice([-1.0, 1.0], (_COUNT, 1))


def _random(rng: np.random.Generator, model: str, **inputs: Any) -> dict[str, Any]:
    tokens = {name: value for name, value in inputs.items() if isinstance(value, str)}
    return random_parameters(rng, model, tokens, _COUNT) | inputs


def test_a_mask_of_0_or_1_is_exact() -> None:
    rng = np.random.default_rng(6)
    below, above = (_random(rng, "disney", presence=np.ones(_COUNT)) for _ in range(2))
    for mask, parameters in ((0.0, below), (1.0, above)):
        for inputs in (np.asarray(mask), np.full(_COUNT, mask)):
            blended = MODELS["disney"].blend([StackLayer("disney", below), StackLayer("disney", above, inputs)])
            assert blended["variant"] == "2014"
            for name in ("roughness", "baseColor"):
                np.testing.assert_array_equal(blended[name], parameters[name])


def test_disney_layers_with_other_metals_are_blended_as_evaluated() -> None:
    rng = np.random.default_rng(48)
    plain, exact = _random(rng, "disney", presence=1.0), _random(rng, "disney", presence=1.0, fresnel="conductor")
    mask = rng.random(_COUNT)
    wo, wi = _directions(rng)
    for below, above in ((plain, exact), (exact, plain)):
        stack = stack_bsdf([StackLayer("disney", below), StackLayer("disney", above, mask)])
        parts = (evaluate(MODELS["disney"].bsdf(parameters), wo, wi) for parameters in (below, above))
        expected = (1.0 - mask)[:, None] * next(parts) + mask[:, None] * next(parts)
        np.testing.assert_allclose(evaluate(stack, wo, wi), expected, rtol=1e-12, atol=1e-15)
    # Metals of one kind are blended as parameters.
    alike = [StackLayer("disney", exact), StackLayer("disney", exact | {"eta": 0.5 * exact["k"] + 1.0}, mask)]
    blended = MODELS["disney"].bsdf(MODELS["disney"].blend(alike))
    np.testing.assert_array_equal(evaluate(stack_bsdf(alike), wo, wi), evaluate(blended, wo, wi))


def test_presence_of_a_disney_layer_is_coverage_as_its_mask_is() -> None:
    rng = np.random.default_rng(46)
    wo, wi = _directions(rng)
    below, above = _random(rng, "disney", presence=1.0), _random(rng, "disney", presence=1.0)
    mask, presence = rng.random(_COUNT), rng.random(_COUNT)
    masked = stack_bsdf([StackLayer("disney", below), StackLayer("disney", above, mask * presence)])
    present = stack_bsdf([StackLayer("disney", below), StackLayer("disney", above | {"presence": presence}, mask)])
    np.testing.assert_array_equal(evaluate(present, wo, wi), evaluate(masked, wo, wi))
    assert (present.presence == 1.0).all()  # type: ignore[union-attr]
    # Over a hole, only the layer is visible: its coverage and its parameters remain.
    hole = StackLayer("disney", below | {"presence": np.zeros(_COUNT)})
    over = stack_bsdf([hole, StackLayer("disney", above | {"presence": presence}, mask)])
    expected = (mask * presence)[:, None] * evaluate(MODELS["disney"].bsdf(above), wo, wi)
    np.testing.assert_allclose(evaluate(over, wo, wi), expected, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(over.presence, mask * presence, rtol=1e-12)
    # Both are partly present: the weight of each is its visible share.
    half = stack_bsdf([_layer("disney", roughness=0.2, presence=0.5), _layer("disney", roughness=0.6, presence=0.5)])
    third = MODELS["disney"].bsdf(complete_parameters("disney", {"roughness": 0.2 / 3.0 + 0.6 * 2.0 / 3.0}))
    assert half.presence == 0.75
    np.testing.assert_allclose(evaluate(half, wo, wi), 0.75 * evaluate(third, wo, wi), rtol=1e-9)


@pytest.mark.parametrize(("base", "top"), [*permutations(CONTINUOUS_MODELS, 2)])
def test_two_models_are_blended_as_they_are_evaluated(base: str, top: str) -> None:
    rng = np.random.default_rng(42)
    below, above = _random(rng, base), _random(rng, top)
    mask = rng.random(_COUNT)
    wo, wi = _directions(rng)
    stack = stack_bsdf([StackLayer(base, below), StackLayer(top, above, mask)])
    # f is already multiplied by the presence of its surface.
    parts = {model: MODELS[model].bsdf(parameters) for model, parameters in ((base, below), (top, above))}
    covered = mask * parts[top].presence
    for function in (evaluate, evaluate_cosine):
        expected = mask[:, None] * function(parts[top], wo, wi) + (1.0 - covered)[:, None] * function(
            parts[base], wo, wi
        )
        np.testing.assert_allclose(function(stack, wo, wi), expected, rtol=1e-12, atol=1e-15)
    presence = covered + (1.0 - covered) * parts[base].presence
    np.testing.assert_allclose(stack.presence, presence, rtol=1e-12, atol=1e-15)
    assert stack.two_sided == (MODELS[base].two_sided or MODELS[top].two_sided)
    if stack.two_sided:
        np.testing.assert_array_equal(evaluate(stack, -wo, -wi), evaluate(stack, wo, wi))
        assert evaluate(stack, wo, wi)[wi[:, 2] < 0.0].any()


def test_from_the_first_other_model_on_layers_are_blended_one_by_one() -> None:
    rng = np.random.default_rng(43)
    models = ("pixar", "pixar", "disney", "disney", "pixar")
    layers = [StackLayer(model, _random(rng, model, presence=1.0), rng.random(_COUNT)) for model in models]
    wo, wi = _directions(rng)
    expected = evaluate(stack_bsdf(layers[:2]), wo, wi)
    for layer in layers[2:]:
        f = evaluate(MODELS[layer.model].bsdf(layer.parameters), wo, wi)
        expected = layer.mask[:, None] * f + (1.0 - layer.mask)[:, None] * expected
    np.testing.assert_allclose(evaluate(stack_bsdf(layers), wo, wi), expected, rtol=1e-12, atol=1e-15)


def test_a_mixed_stack_is_sampled_where_it_sends_light() -> None:
    rng = np.random.default_rng(44)
    layers = [StackLayer(model, _random(rng, model, presence=0.5), 0.5) for model in ("disney", "pixar")]
    wo, wi = _directions(rng)
    stack = stack_bsdf(layers)
    is_positive = evaluate_cosine(stack, wo, wi).max(axis=-1) > 1e-12
    assert np.count_nonzero(is_positive) > 300
    assert (pdf(stack, wo, wi)[is_positive] > 0.0).all()


@pytest.mark.parametrize("model", CONTINUOUS_MODELS)
def test_the_mask_of_the_base_has_no_meaning(model: str) -> None:
    rng = np.random.default_rng(45)
    parameters = _random(rng, model)
    wo, wi = _directions(rng)
    alone, masked = (stack_bsdf([StackLayer(model, parameters, mask)]) for mask in (1.0, 0.25))
    np.testing.assert_array_equal(evaluate(alone, wo, wi), evaluate(masked, wo, wi))


def _layer(model: str, mode: Any = "over", **inputs: Any) -> StackLayer:
    return StackLayer(model, complete_parameters(model, inputs), 1.0, mode)


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        ([], "a stack has no layers; a base would be right"),
        ([_layer("pixar"), _layer("disney"), _layer("pixar", "transmit")], "layer 2: mode 'transmit' needs"),
        ([_layer("pixar"), _layer("pixar", energy="conserving")], "layers disagree on 'energy'"),
        ([_layer("disney"), _layer("disney", variant="2012")], "layers disagree on 'variant'"),
    ],
)
def test_layers_that_do_not_fit_are_errors(layers: list[StackLayer], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        stack_bsdf(layers)


def test_a_mode_is_ruled_out_by_the_first_model_that_does_not_have_it() -> None:
    assert find_mode_conflict("over", ["disney", "pixar"]) is None
    assert find_mode_conflict("transmit", ["pixar", "pixar"]) is None
    assert find_mode_conflict("transmit", ["pixar", "disney", "lambert", "pixar"]) == 1
    assert find_mode_conflict("coat", ["disney", "pixar"]) == 1


def test_layers_of_a_model_without_presence_are_blended_by_the_mask_alone() -> None:
    below, above = (
        complete_parameters("lambert", {"reflectance": color}) for color in ((0.8, 0.1, 0.2), (0.0, 0.5, 0.4))
    )
    blended = MODELS["lambert"].blend([StackLayer("lambert", below), StackLayer("lambert", above, 0.25)])
    np.testing.assert_allclose(blended["reflectance"], (0.6, 0.2, 0.25))
