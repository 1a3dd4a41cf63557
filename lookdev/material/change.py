"""A look with another value of one input: what a wedge varies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from lookdev.brdf import MASK
from lookdev.brdf.parameters import Parameter, complete
from lookdev.errors import ModelError, nearest_hint
from lookdev.material.expression import ExpressionError, parse
from lookdev.material.look import VIEW, Formula, Input, Layer, Look, View
from lookdev.material.translate import layer_parameters

Value = float | tuple[float, float, float] | str


def changed_look(look: Look, parameter: str, value: Value) -> Look:
    """Return a look with another value of one of its `varied_names`.

    ``mask`` and the inputs of expressions may be an expression or a value of their kind. An input without its layer is
    meant where one layer alone has it.

    Raises
    ------
    ModelError
        There is no such parameter, several layers have it, or the value is not one that it can have.
    """
    names = dict(varied_names(look))
    found = [name for name in names if name == parameter] or [
        name for name, (layer, _) in names.items() if name.removeprefix(f"{layer.name}.") == parameter
    ]
    if not found:
        known = [*names, *(name.removeprefix(f"{layer.name}.") for name, (layer, _) in names.items())]
        raise ModelError(
            f"look '{look.name}' has no '{parameter}' ({nearest_hint(parameter, list(dict.fromkeys(known)))})"
        )
    if len(found) > 1:
        raise ModelError(
            f"several layers of look '{look.name}' have '{parameter}': one of {', '.join(found)} would be right"
        )
    layer, path = names[found[0]]
    changed = _changed(layer, path, value, found[0], alone=len(look.layers) == 1)
    return replace(look, layers=tuple(changed if each is layer else each for each in look.layers))


def varied_names(look: Look) -> Iterator[tuple[str, tuple[Layer, tuple[str, ...]]]]:
    """Yield the name of each input that can be varied, its layer, and the names on the way to it."""
    for layer in look.layers:
        inputs: dict[str, Input] = dict.fromkeys(layer_parameters(layer.model), 0.0) | layer.inputs
        if layer is not look.layers[0]:
            inputs["mask"] = layer.mask
        for name, source in inputs.items():
            yield f"{layer.name}.{name}", (layer, (name,))
            if isinstance(source, Formula):
                for each in source.inputs:
                    yield f"{layer.name}.{name}.{each}", (layer, (name, each))


def _changed(layer: Layer, path: tuple[str, ...], value: Value, place: str, *, alone: bool) -> Layer:
    name, *inside = path
    parameter = MASK if name == "mask" else layer_parameters(layer.model)[name]
    source: Any = layer.mask if name == "mask" else layer.inputs.get(name)
    new: Any
    if inside:
        kind = source.kinds[inside[0]]
        number = _constant(place, Parameter(inside[0], kind, 0.0, (-1e18, 1e18)), value)
        new = replace(source, inputs={**source.inputs, inside[0]: number})
    elif isinstance(value, str) and parameter.kind in ("float", "color"):
        new = _formula(place, parameter, value, source)
    elif parameter.file or (parameter.kind == "token" and not alone):
        raise ModelError(f"{place} is a {'file' if parameter.file else 'choice that layers share'}, which cannot vary")
    else:
        new = _constant(place, parameter, value)
    return replace(layer, mask=new) if name == "mask" else replace(layer, inputs={**layer.inputs, name: new})


def _constant(place: str, parameter: Parameter, value: Value) -> float | tuple[float, float, float] | str:
    """Return a checked constant as plain Python; one number is a grey where a colour is needed."""
    grey = parameter.kind == "color" and isinstance(value, float | int)
    owner, _, name = place.rpartition(".")
    named = replace(parameter, name=name, stands=None, follows="")
    checked: Any = complete(owner, {name: named}, {name: (value,) * 3 if grey else value})[name]
    return checked if isinstance(checked, str) else checked.tolist() if checked.ndim == 0 else tuple(checked.tolist())


def _formula(place: str, parameter: Parameter, text: str, source: Any) -> Formula:
    """Return an expression over the inputs of the one that is there."""
    inputs = dict(source.inputs) if isinstance(source, Formula) else {}
    kinds = dict(source.kinds) if isinstance(source, Formula) else {}
    inputs.setdefault(VIEW, View())
    kinds.setdefault(VIEW, "float")
    try:
        expression = parse(text)
        result = expression.check(kinds)
    except ExpressionError as error:
        raise ModelError(f"{place}: {error}") from error
    if parameter.kind == "float" and result == "color":
        raise ModelError(f"{place} is a color; a float would be right: luminance(...)")
    names = expression.names
    return Formula(expression, {name: inputs[name] for name in names}, {name: kinds[name] for name in names})
