"""Traced programs on NumPy arrays against the models that they were traced from."""

from typing import Any

import numpy as np
import pytest

from lookdev.brdf import CONTINUOUS_MODELS, Model, StackLayer, evaluate, stack_bsdf
from lookdev.codegen.program.arrays import PART_SIZE, compile_layers
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import symbol, symbols


def directions(count: int, seed: int) -> Any:
    """Return views and lights of all sides, some on the horizon."""
    w = np.random.default_rng(seed).normal(size=(2, count, 3))
    w /= np.linalg.norm(w, axis=-1, keepdims=True)
    w[0, :5], w[1, 5:9] = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    return w


@pytest.mark.parametrize("model", CONTINUOUS_MODELS.values(), ids=CONTINUOUS_MODELS)
@pytest.mark.parametrize("count", [7, PART_SIZE + 3])
def test_a_program_has_the_values_of_its_model(model: Model, count: int) -> None:
    """One parameter is a symbol, which gets two values; results are equal to rounding."""
    numbers = (
        parameter
        for parameter in model.parameters.values()
        if parameter.kind in ("float", "color") and not parameter.optional
    )
    parameters, name = model.complete(model.probe), next(numbers).name
    symbol_names = [f"{name}_{i}" for i in range(3)]

    def make_layers(graph: Graph) -> list[StackLayer]:
        traced = symbols(graph, symbol_names) if model.parameters[name].kind == "color" else symbol(graph, name)
        return [StackLayer(model.name, {**parameters, name: traced})]

    program = compile_layers(make_layers)
    wo, wi = directions(count, seed=4)
    for factor in (1.0, 0.25):
        value = parameters[name] * factor
        numbers = dict(zip(symbol_names, value.tolist(), strict=True)) if value.ndim else {name: float(value)}
        expected = evaluate(model.bsdf({**parameters, name: value}), wo, wi)
        assert np.abs(program.f(wo, wi, numbers) - expected).max() <= 1e-12 * max(1.0, np.abs(expected).max())


def test_a_stack_of_constants_is_a_program_too() -> None:
    model = CONTINUOUS_MODELS["disney"]
    layers = [
        StackLayer("disney", model.complete({"roughness": roughness}), mask, "over")
        for roughness, mask in ((0.2, 1.0), (0.7, 0.4))
    ]
    wo, wi = directions(50, seed=5)
    expected = evaluate(stack_bsdf(layers), wo, wi)
    assert np.allclose(compile_layers(lambda graph: layers).f(wo, wi, {}), expected, rtol=1e-12, atol=1e-14)
