"""Programs of every model in float64, outside Mitsuba, against the models themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from random_parameters import EVERY, directions, near_the_mirror_image, random_parameters

from lookdev.brdf import MODELS, StackLayer, complete_parameters, evaluate_cosine, pdf, sample, stack_bsdf
from lookdev.codegen.program.look import generate_program
from lookdev.material import Layer, Look

pytestmark = pytest.mark.mitsuba

COUNT = 400


@EVERY
def test_programs_agree_with_the_models(model: str, tokens: dict[str, str], drjit: Any) -> None:
    from lookdev.mitsuba.programs import Place, Program

    number = drjit.llvm.Float64
    rng = np.random.default_rng(3)
    values = random_parameters(rng, model, tokens, 6)
    for case in range(6):
        inputs = {name: each if isinstance(each, str) else _plain(each[case]) for name, each in values.items()}
        inputs = {name: each for name, each in inputs.items() if not _left_out(model, name, each)}
        look = Look("look", (Layer("Layer", model, inputs),))
        source = generate_program(look, lambda texture: pytest.fail("no texture is read"))
        tables = [number(np.load(each.path).astype(np.float64)) for each in source.tables]
        constants = [number(each) for each in source.constants]
        program = Program(source.operations, source.outputs, number, constants, tables)
        wo = directions(rng, COUNT)
        wi, u = near_the_mirror_image(rng, wo), rng.random((COUNT, 2))
        symbols = {f"wo_{axis}": number(wo[:, i].copy()) for i, axis in enumerate("xyz")} | {"handed": number(1.0)}
        place = Place(program, symbols.__getitem__)
        given = {f"wi_{axis}": number(wi[:, i].copy()) for i, axis in enumerate("xyz")}
        of_model = {name: each if isinstance(each, str) else np.asarray(each) for name, each in inputs.items()}
        bsdf = stack_bsdf([StackLayer(model, complete_parameters(model, of_model), 1.0, "over")])
        for found, expected in (
            (_rows(place.values("value", **given)), evaluate_cosine(bsdf, wo, wi)),
            (_rows(place.values("pdf", **given))[:, 0], pdf(bsdf, wo, wi)),
            (_rows(place.values("wi", u1=number(u[:, 0].copy()), u2=number(u[:, 1].copy()))), sample(bsdf, wo, u)),
        ):
            # Sums are taken in another order: some units in the last place of the largest term. Tables are
            # float32, whose rounding grows where a distribution is inverted.
            rtol, atol = (2.0**-23, 2.0**-18) if source.tables else (1e-9, 1e-12)
            np.testing.assert_allclose(found, expected, rtol=rtol, atol=atol * max(1.0, np.abs(expected).max()))


def _rows(values: Any) -> Any:
    return np.stack([np.broadcast_to(np.array(each), COUNT) for each in values], axis=-1)


def _plain(value: Any) -> Any:
    return float(value) if np.ndim(value) == 0 else tuple(float(each) for each in value)


def _left_out(model: str, name: str, value: Any) -> bool:
    """Return whether an optional number is not given."""
    parameter = MODELS[model].parameters[name]
    return parameter.optional and not isinstance(value, str) and bool(np.all(np.asarray(value) == parameter.default))
