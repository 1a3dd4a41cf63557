"""Random parameters of every model from their whole hard ranges, and random directions."""

from itertools import product
from typing import Any

import numpy as np
import pytest

from lookdev.arrays import Floats
from lookdev.brdf import CONTINUOUS_MODELS, MODELS
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.metal import CONDUCTOR

# Every token of a model, in every combination; with and without optional numbers, which `random_parameters` draws where
# the tokens have the key "options".
VARIANTS = [
    (name, dict(zip(forms, values, strict=True)) | options)
    for name, model in CONTINUOUS_MODELS.items()
    for forms in [model.forms()]
    for options in ({}, {"options": "drawn"})[: 1 + bool(model.optional_defaults())]
    for values in product(*forms.values())
]
EVERY = pytest.mark.parametrize(("model", "tokens"), VARIANTS, ids=str)


def directions(rng: np.random.Generator, count: int) -> Floats:
    """Draw unit directions (count, 3) above the horizon, their cosines uniform."""
    cos = rng.uniform(1e-3, 1.0, count)
    phi = rng.uniform(0.0, 2.0 * np.pi, count)
    sin = np.sqrt(1.0 - cos * cos)
    return np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=-1)


def near_the_mirror_image(rng: np.random.Generator, wo: Floats) -> Floats:
    """Draw directions above the horizon around the reflection of `wo`, where tight lobes are not 0."""
    wi = wo * [-1.0, -1.0, 1.0] + rng.normal(0.0, 1.0, wo.shape) * rng.choice([0.01, 0.1, 1.0], (len(wo), 1))
    wi[:, 2] = np.abs(wi[:, 2])
    return wi / np.linalg.norm(wi, axis=-1, keepdims=True)


def random_parameters(
    rng: np.random.Generator, model: str, tokens: dict[str, str], count: int, leaning: float = 0.5
) -> dict[str, Any]:
    """Draw parameters: half of the numbers at an end of their range, where formulas have special cases.

    Of the normals, the fraction `leaning` leans anywhere, the rest are upright. Tokens not given have their defaults,
    and so has the index of metals that have none.
    """
    values: dict[str, Any] = {}
    parameters = MODELS[model].parameters
    without = ("eta", "k") if "fresnel" in parameters and tokens.get("fresnel") != CONDUCTOR else ()
    for name, parameter in parameters.items():
        if (parameter.optional and "options" not in tokens) or name in without:
            values[name] = np.repeat(np.expand_dims(np.asarray(parameter.default), 0), count, axis=0)
            continue
        if parameter.kind == "token":
            values[name] = tokens.get(name, parameter.choices[0] if parameter.file else parameter.default)
            continue
        shape = (count,) if parameter.kind == "float" else (count, 3)
        low, high = parameter.hard
        values[name] = low + (high - low) * np.clip(rng.uniform(-0.5, 1.5, shape), 0.0, 1.0)
        if parameter.kind == "normal":
            values[name] = np.where(rng.random((count, 1)) < leaning, values[name], ZENITH)
    return values
