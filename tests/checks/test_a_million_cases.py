"""Every model at a million random and extreme inputs: finite, not negative, in float64, float32 and inside Cycles."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from lookdev.brdf import CONTINUOUS_MODELS, sample
from lookdev.checks.evaluate import Batch, evaluate_cycles, evaluate_numpy
from lookdev.checks.extremes import extreme_cases
from lookdev.codegen.points import PointLayer

pytestmark = pytest.mark.proof

COUNT = 1_000_000
_PART = 50_000


def parts(model: str) -> list[Batch]:
    """Draw cases of all forms of a model, with its options."""
    record = CONTINUOUS_MODELS[model]
    choices = record.forms()
    forms = [dict(zip(choices, values, strict=True)) for values in product(*choices.values())]
    files = {parameter.name: "builtin:plastic" for parameter in record.parameters.values() if parameter.file}
    rng = np.random.default_rng(2026)
    layers = [PointLayer(model, record.tokens(form | files)) for form in forms]
    number = -(-COUNT // _PART)
    return [extreme_cases([layers[part % len(layers)]], _PART, rng).batch for part in range(number)]


def round_to_float32(batch: Batch) -> Batch:
    numbers = tuple({name: value.astype(np.float32) for name, value in layer.items()} for layer in batch.numbers)
    return replace(batch, wo=batch.wo.astype(np.float32), wi=batch.wi.astype(np.float32), numbers=numbers)


def is_sound(values: np.ndarray) -> bool:
    return bool(np.isfinite(values).all() and (values >= 0.0).all())


@pytest.mark.parametrize("model", sorted(CONTINUOUS_MODELS))
def test_numpy_is_finite(model: str) -> None:
    rng = np.random.default_rng(1)
    for batch in parts(model):
        for cases in (batch, round_to_float32(batch)):
            with np.errstate(all="ignore"):
                f, density = evaluate_numpy(cases)
                u = rng.random((_PART, 2)).astype(cases.wo.dtype)
                drawn = sample(cases.bsdf(), cases.wo, u)
            assert is_sound(f)
            assert is_sound(density)
            assert np.isfinite(drawn).all()


@pytest.mark.cycles
@pytest.mark.usefixtures("warm_points")
@pytest.mark.parametrize("model", sorted(CONTINUOUS_MODELS))
def test_cycles_is_finite(model: str) -> None:
    for batch in parts(model):
        assert all(map(is_sound, evaluate_cycles(batch)))
