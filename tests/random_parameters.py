"""Random parameters of every model, from their whole hard ranges, and random directions, for tests of the models."""

from itertools import product
from typing import Any

import numpy as np
import pytest

from lookdev.arrays import Floats
from lookdev.brdf import CONTINUOUS_MODELS, MODELS
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.metal import CONDUCTOR

# Pairs of a model's name and its tokens: all combinations of the tokens that select a form of the model, each without
# and with optional numbers. `random_parameters` draws optional numbers if the tokens have the key "options".
VARIANTS = [
    (name, dict(zip(forms, values, strict=True)) | options)
    for name, model in CONTINUOUS_MODELS.items()
    for forms in [model.forms()]
    for options in ({}, {"options": "drawn"})[: 1 + bool(model.optional_defaults())]
    for values in product(*forms.values())
]
EVERY = pytest.mark.parametrize(("model", "tokens"), VARIANTS, ids=str)
"""Runs a test with each of `VARIANTS`."""


def directions(rng: np.random.Generator, count: int) -> Floats:
    """Draw unit directions (count, 3) above the horizon, with uniform cosines."""
    cos = rng.uniform(1e-3, 1.0, count)
    phi = rng.uniform(0.0, 2.0 * np.pi, count)
    sin = np.sqrt(1.0 - cos * cos)
    return np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=-1)


def near_the_mirror_image(rng: np.random.Generator, wo: Floats) -> Floats:
    """Draw directions above the horizon around the reflection of `wo`, where narrow lobes are not 0."""
    wi = wo * [-1.0, -1.0, 1.0] + rng.normal(0.0, 1.0, wo.shape) * rng.choice([0.01, 0.1, 1.0], (len(wo), 1))
    wi[:, 2] = np.abs(wi[:, 2])
    return wi / np.linalg.norm(wi, axis=-1, keepdims=True)


def random_parameters(
    rng: np.random.Generator, model: str, tokens: dict[str, str], count: int, leaning: float = 0.5
) -> dict[str, Any]:
    """Draw values of all parameters of a model, (count,) or (count, 3), by name.

    Half of the numbers are at an end of their range, where formulas have special cases. A share `leaning` of the
    normals has random directions, the others are (0, 0, 1). Tokens that are not in `tokens` have their defaults, and so
    have the index and absorption of metals if the form of the model does not use them.
    """
    values: dict[str, Any] = {}
    parameters = MODELS[model].parameters
    unused = ("eta", "k") if "fresnel" in parameters and tokens.get("fresnel") != CONDUCTOR else ()
    for name, parameter in parameters.items():
        if (parameter.optional and "options" not in tokens) or name in unused:
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
