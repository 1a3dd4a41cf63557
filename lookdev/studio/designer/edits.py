"""Edits of constants, such as the position of a slider: they are parsed from a page's request, and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lookdev.brdf import MODELS, complete_parameters
from lookdev.brdf.parameters import ParameterValue
from lookdev.errors import ModelError, nearest_hint
from lookdev.material import Bump, Formula, Layer, Look, Primvar, Texture


@dataclass(frozen=True)
class Edit:
    """A new constant for a parameter of a layer of a look.

    `look` is the number of the look (see `Document`). `layer` is the number of the layer, from the base; muted layers
    are not counted. The parameter ``"mask"`` is the mask of the layer, ``"mask.dirt"`` an input of the mask's
    expression, and ``"roughness.dirt"`` an input of a parameter's expression. Edits of one `gesture`, such as the drag
    of a slider, are one step of the history.
    """

    look: int
    layer: int
    parameter: str
    value: ParameterValue
    gesture: str = ""


def shader_shape(look: Look) -> Any:
    """Return the parts of a look on which its shaders depend: all except its name and the values of uniforms.

    If these are equal for two looks, the looks have the same shaders.
    """

    def shape(value: Any) -> Any:
        # The value of a number or of a tuple of numbers is a uniform: only its type is part of the shaders.
        return ("#", len(value)) if isinstance(value, tuple) else "#" if isinstance(value, float) else value

    return [
        (layer.model, layer.mode, shape(layer.mask), {name: shape(value) for name, value in layer.inputs.items()})
        for layer in look.layers
    ]


def check_value(layer: Layer, edit: Edit) -> ParameterValue:
    """Return the value of an edit in the type of its parameter; raise ModelError if the parameter cannot have it."""
    name, value = edit.parameter, edit.value
    if name == "mask":
        if edit.layer == 0 or not isinstance(layer.mask, float):
            raise ModelError("the base has no mask" if edit.layer == 0 else "the mask has a texture or an expression")
        if not isinstance(value, float) or not 0.0 <= value <= 1.0:
            raise ModelError(f"a mask is a number from 0 to 1, not {value!r}")
        return value
    if "." in name:
        owner, _, inner = name.partition(".")
        formula = layer.mask if owner == "mask" else layer.inputs.get(owner)
        inputs = formula.inputs if isinstance(formula, Formula) else {}
        if not isinstance(inputs.get(inner), float) or not isinstance(value, float):
            raise ModelError(f"{layer.name}.{name} is not a number of an expression, or {value!r} is not a number")
        return value
    if layer.model not in MODELS:
        raise ModelError(f"layer '{layer.name}' is of {layer.model}, which is translated: it has no sliders")
    parameters = MODELS[layer.model].parameters
    if name not in parameters:
        raise ModelError(f"{layer.model} has no parameter '{name}' ({nearest_hint(name, list(parameters))})")
    if isinstance(layer.inputs.get(name), Texture | Primvar | Bump | Formula):
        raise ModelError(f"{layer.name}.{name} has a texture or an expression, not a constant")
    complete = complete_parameters(layer.model, {name: value})[name]
    plain = complete if isinstance(complete, str) else np.asarray(complete).tolist()
    return tuple(plain) if isinstance(plain, list) else plain


def parse_edit(body: Mapping[str, Any]) -> Edit:
    """Return the edit in a request of a page; raise ModelError if the request is not an edit."""
    match body:
        case {"look": int(look), "layer": int(layer), "parameter": str(parameter), "value": value}:
            gesture = str(body.get("gesture", ""))[:40]
            if isinstance(value, list) and len(value) == 3 and all(isinstance(x, int | float) for x in value):
                return Edit(look, layer, parameter, tuple(float(x) for x in value), gesture)  # type: ignore[arg-type]
            if isinstance(value, str):
                return Edit(look, layer, parameter, value, gesture)
            if isinstance(value, int | float) and not isinstance(value, bool):
                return Edit(look, layer, parameter, float(value), gesture)
    raise ModelError("an edit has a look, a layer, a parameter, and a number, three numbers or a word as its value")
