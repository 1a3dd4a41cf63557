"""From a look to one BSDF."""

from __future__ import annotations

from typing import Any

from lookdev.brdf import MASK, PARAMETERS, Bsdf, StackLayer, complete_parameters, stack_bsdf
from lookdev.codegen.inputs import Inputs
from lookdev.material import Layer, Look, Varying


def look_bsdf(look: Look, inputs: Inputs) -> Bsdf:
    """Combine the layers of a look.

    Raises
    ------
    ModelError
        A constant is outside its hard range, or the layers do not fit together.
    """
    return stack_bsdf(look_stack(look, inputs))


def look_stack(look: Look, inputs: Inputs) -> list[StackLayer]:
    """Return the layers of a look with all of their parameters.

    Raises
    ------
    ModelError
        A constant is outside its hard range.
    """
    return [
        StackLayer(layer.model, _layer_parameters(layer, inputs), inputs.value(layer.mask, MASK), layer.mode)
        for layer in look.layers
    ]


def _layer_parameters(layer: Layer, inputs: Inputs) -> dict[str, Any]:
    varying = {name: value for name, value in layer.inputs.items() if isinstance(value, Varying)}
    constant = {name: value for name, value in layer.inputs.items() if name not in varying}
    parameters = complete_parameters(layer.model, constant)
    known = PARAMETERS[layer.model]
    for name, value in layer.inputs.items():
        if known[name].kind != "token":
            source = value if name in varying else parameters[name]
            parameters[name] = inputs.value(source, known[name])
    return parameters
