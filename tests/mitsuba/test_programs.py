"""Programs of every model in float64, outside Mitsuba, against the models themselves."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from random_parameters import EVERY, directions, near_the_mirror_image, random_parameters

from lookdev.brdf import MODELS, StackLayer, complete_parameters, evaluate_cosine, pdf, sample, stack_bsdf
from lookdev.codegen.program.look import generate_program
from lookdev.material import Layer, Look

pytestmark = pytest.mark.mitsuba

COUNT = 400


@pytest.mark.parametrize("cases", [1, pytest.param(6, marks=pytest.mark.proof)])
@EVERY
def test_programs_agree_with_the_models(cases: int, model: str, tokens: dict[str, str], drjit: Any) -> None:
    rng = np.random.default_rng(3)
    compared = [
        pair for inputs in _random_inputs(rng, model, tokens, cases) for pair in _outputs(rng, model, inputs, drjit)
    ]
    drjit.eval([computed for computed, *_ in compared])  # in one kernel
    for computed, expected, rtol, atol in compared:
        values = np.stack([np.broadcast_to(np.array(component), COUNT) for component in computed], axis=-1)
        # Sums are taken in another order: some units in the last place of the largest term.
        np.testing.assert_allclose(values, expected, rtol=rtol, atol=atol * max(1.0, np.abs(expected).max()))


def _random_inputs(
    rng: np.random.Generator, model: str, tokens: dict[str, str], cases: int
) -> Iterator[dict[str, Any]]:
    """Yield inputs of a layer, without optional numbers that have their defaults."""
    values = random_parameters(rng, model, tokens, cases)
    parameters = MODELS[model].parameters
    for case in range(cases):
        inputs = {name: value if isinstance(value, str) else _plain(value[case]) for name, value in values.items()}
        yield {
            name: value
            for name, value in inputs.items()
            if isinstance(value, str)
            or not (parameters[name].optional and np.all(np.asarray(value) == parameters[name].default))
        }


def _outputs(rng: np.random.Generator, model: str, inputs: dict[str, Any], drjit: Any) -> Iterator[tuple[Any, ...]]:
    """Yield value, pdf and sample of a program, those of the model, and the tolerances."""
    from lookdev.mitsuba.programs import Evaluation, Program

    number = drjit.llvm.Float64
    look = Look("look", (Layer("Layer", model, inputs),))
    source = generate_program(look, lambda texture: pytest.fail("no texture is read"))
    tables = [number(np.load(table.path).astype(np.float64)) for table in source.tables]
    constants = [number(constant) for constant in source.constants]
    program = Program(source.operations, source.outputs, number, constants, tables)
    wo = directions(rng, COUNT)
    wi, u = near_the_mirror_image(rng, wo), rng.random((COUNT, 2))
    symbols = {f"wo_{axis}": number(wo[:, i].copy()) for i, axis in enumerate("xyz")} | {"handed": number(1.0)}
    evaluation = Evaluation(program, symbols.__getitem__)
    directions_in = {f"wi_{axis}": number(wi[:, i].copy()) for i, axis in enumerate("xyz")}
    numbers = {f"u{i + 1}": number(u[:, i].copy()) for i in range(2)}
    of_model = {name: value if isinstance(value, str) else np.asarray(value) for name, value in inputs.items()}
    bsdf = stack_bsdf([StackLayer(model, complete_parameters(model, of_model), 1.0, "over")])
    # Tables are float32, whose rounding grows where a distribution is inverted.
    tolerances = (2.0**-23, 2.0**-18) if source.tables else (1e-9, 1e-12)
    yield evaluation.values("value", **directions_in), evaluate_cosine(bsdf, wo, wi), *tolerances
    yield evaluation.values("pdf", **directions_in)[:1], pdf(bsdf, wo, wi)[:, None], *tolerances
    yield evaluation.values("wi", **numbers), sample(bsdf, wo, u), *tolerances


def _plain(value: Any) -> Any:
    return float(value) if np.ndim(value) == 0 else tuple(float(component) for component in value)
