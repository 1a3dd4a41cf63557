"""Reflectance models in plain NumPy, each written once and traced into every other language.

A model is its inputs (`PARAMETERS`) and a rule that combines layers of it (`lookdev.brdf.stack`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lookdev.brdf.disney_parameters import DISNEY_PARAMETERS
from lookdev.brdf.lobes import Bsdf, Lobe, evaluate, evaluate_cosine, pdf, sample, seen_along
from lookdev.brdf.parameters import MASK, Parameter, Value
from lookdev.brdf.pixar_parameters import PIXAR_PARAMETERS
from lookdev.brdf.stack import StackLayer, stack_bsdf
from lookdev.brdf.vectors import Array
from lookdev.errors import ModelError, nearest_hint

PARAMETERS: dict[str, dict[str, Parameter]] = {"disney": DISNEY_PARAMETERS, "pixar": PIXAR_PARAMETERS}


def _single(model: str) -> Callable[[Mapping[str, Array]], Bsdf]:
    return lambda parameters: stack_bsdf([StackLayer(model, parameters)])


MODELS: dict[str, Callable[[Mapping[str, Array]], Bsdf]] = {model: _single(model) for model in PARAMETERS}
"""Each model as a surface of one layer, from all of its parameters."""


def complete_parameters(model: str, given: Mapping[str, object]) -> dict[str, Array]:
    """Check constant parameters of a model and fill in the defaults.

    Floats become float64 scalars, colours and normals arrays of shape (3,), tokens stay strings.

    Raises
    ------
    ModelError
        The model or a parameter is unknown, of the wrong type, not finite or outside its hard range.
    """
    if model not in PARAMETERS:
        raise ModelError(f"unknown model '{model}' ({nearest_hint(model, list(PARAMETERS))})")
    known = PARAMETERS[model]
    for name in given:
        if name not in known:
            raise ModelError(f"{model}: unknown parameter '{name}' ({nearest_hint(name, list(known))})")
    return {name: _checked(model, known[name], given.get(name, known[name].default)) for name in known}


def _checked(model: str, parameter: Parameter, value: object) -> Array:
    place = f"{model}.{parameter.name}"
    if parameter.kind == "token":
        if value not in parameter.choices:
            raise ModelError(f"{place} is {value!r}; one of {', '.join(parameter.choices)} would be right")
        return value
    shape = () if parameter.kind == "float" else (3,)
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if isinstance(value, (str, bool)) or array.shape != shape:
        wanted = "three numbers" if shape else "a number"
        raise ModelError(f"{place} is {value!r}; {wanted} would be right")
    low, high = parameter.hard
    if not np.all((array >= low) & (array <= high)):
        raise ModelError(f"{place} is {value!r}; its range is {low:g} to {high:g}")
    if parameter.kind == "normal" and not array.any():
        raise ModelError(f"{place} is {value!r}; a vector with a direction would be right")
    return array


__all__ = [
    "MASK",
    "MODELS",
    "PARAMETERS",
    "Bsdf",
    "Lobe",
    "Parameter",
    "StackLayer",
    "Value",
    "complete_parameters",
    "evaluate",
    "evaluate_cosine",
    "pdf",
    "sample",
    "seen_along",
    "stack_bsdf",
]
