"""Parameters of every model drawn from the whole of their hard ranges, and directions to go with them."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lookdev.brdf import MODELS
from lookdev.brdf.frames import ZENITH

Floats = NDArray[np.float64]

# Every token of a model, in every combination.
_VARIANTS = [
    (model, dict(zip(tokens, values, strict=True)))
    for model, parameters in ((name, each.parameters) for name, each in MODELS.items())
    for tokens in [[p.name for p in parameters.values() if p.kind == "token"]]
    for values in product(*(parameters[name].choices for name in tokens))
]
EVERY = pytest.mark.parametrize(("model", "tokens"), _VARIANTS, ids=str)


def directions(rng: np.random.Generator, count: int) -> Floats:
    """Draw unit directions (count, 3) above the horizon, their cosines uniform."""
    cos = rng.uniform(1e-3, 1.0, count)
    phi = rng.uniform(0.0, 2.0 * np.pi, count)
    sin = np.sqrt(1.0 - cos * cos)
    return np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=-1)


def random_parameters(
    rng: np.random.Generator, model: str, tokens: dict[str, str], count: int, leaning: float = 0.5
) -> dict[str, Any]:
    """Draw parameters: half of the numbers at an end of their range, where formulas meet their special cases.

    Normals are straight but for a fraction of them, which lean anywhere.
    """
    values: dict[str, Any] = dict(tokens)
    for name, parameter in MODELS[model].parameters.items():
        if parameter.kind == "token":
            continue
        shape = (count,) if parameter.kind == "float" else (count, 3)
        low, high = parameter.hard
        values[name] = low + (high - low) * np.clip(rng.uniform(-0.5, 1.5, shape), 0.0, 1.0)
        if parameter.kind == "normal":
            values[name] = np.where(rng.random((count, 1)) < leaning, values[name], ZENITH)
    return values
