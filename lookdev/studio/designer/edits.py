"""Edits of constants: as a page sends them, and whether a layer can have them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lookdev.brdf import MODELS, complete_parameters
from lookdev.errors import ModelError, nearest_hint
from lookdev.material import Formula, Look, Texture
from lookdev.material.change import Value
from lookdev.material.look import Bump, Layer, Primvar


@dataclass(frozen=True)
class Edit:
    """Another constant of a parameter of a layer of a look; the layer is numbered from the base, without those muted.

    ``"mask"`` is the layer's mask, ``"mask.dirt"`` an input of its expression, ``"roughness.dirt"`` one of a
    parameter's. Edits of one `gesture` are one step.
    """

    look: int
    layer: int
    parameter: str
    value: Value
    gesture: str = ""


def shape_of(look: Look) -> Any:
    """Return what the shaders of a look depend on: all but its name, and the constants that are uniforms."""

    def of(value: Any) -> Any:
        return ("#", len(value)) if isinstance(value, tuple) else "#" if isinstance(value, float) else value

    return [
        (each.model, each.mode, of(each.mask), {name: of(value) for name, value in each.inputs.items()})
        for each in look.layers
    ]


def checked(layer: Layer, edit: Edit) -> Value:
    """Return the value of an edit as its parameter can have it; raises ModelError where it cannot."""
    name, value = edit.parameter, edit.value
    if name == "mask":
        if edit.layer == 0 or not isinstance(layer.mask, float):
            raise ModelError("the base has no mask" if edit.layer == 0 else "the mask has a texture or an expression")
        if not isinstance(value, float) or not 0.0 <= value <= 1.0:
            raise ModelError(f"a mask is a number from 0 to 1, not {value!r}")
        return value
    if "." in name:
        of, _, inner = name.partition(".")
        formula = layer.mask if of == "mask" else layer.inputs.get(of)
        inputs = formula.inputs if isinstance(formula, Formula) else {}
        if not isinstance(inputs.get(inner), float) or not isinstance(value, float):
            raise ModelError(f"{layer.name}.{name} is no number of an expression, or {value!r} is none")
        return value
    if layer.model not in MODELS:
        raise ModelError(f"layer '{layer.name}' is of {layer.model}, which is translated: it has no sliders")
    known = MODELS[layer.model].parameters
    if name not in known:
        raise ModelError(f"{layer.model} has no parameter '{name}' ({nearest_hint(name, list(known))})")
    if isinstance(layer.inputs.get(name), Texture | Primvar | Bump | Formula):
        raise ModelError(f"{layer.name}.{name} has a texture or an expression, not a constant")
    complete = complete_parameters(layer.model, {name: value})[name]
    plain = complete if isinstance(complete, str) else np.asarray(complete).tolist()
    return tuple(plain) if isinstance(plain, list) else plain


def parsed(body: Mapping[str, Any]) -> Edit:
    """Return an edit of a page's request; raises ModelError where it is none."""
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
