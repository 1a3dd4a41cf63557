"""Copies of a look with other values of single inputs.

A wedge (a series of looks that differ in one input) and a fit (a search for the best values of several inputs) use such
copies.

An input is named by its layer and parameter, as ``base.roughness`` or ``dust.mask``. An input of an expression has a
third part, its name in the expression, as ``dust.mask.amount``. The *path* of an input is this name without the layer:
``("roughness",)`` or ``("mask", "amount")``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import cast

from lookdev.arrays import Floats
from lookdev.brdf import MASK
from lookdev.brdf.parameters import Parameter, ParameterValue, complete
from lookdev.errors import ModelError, nearest_hint
from lookdev.material import VIEW, Formula, Input, InputSource, Layer, Look, Mask, Primvar, ViewCosine
from lookdev.material.expression import ExpressionError, parse
from lookdev.material.translate import layer_parameters
from lookdev.space import Color

_LIVE = "lookdev:live:"  # the reserved beginning of the names of live inputs: see `look_with_live_inputs`


def look_with_value(look: Look, parameter: str, value: ParameterValue) -> Look:
    """Return a look with another value of one of its `variable_inputs`.

    A mask, and any input of a layer that is a number or a colour, also takes the text of an expression. `parameter` is
    the full name of the input. It may lack the layer where only one layer has such an input.

    Raises
    ------
    ModelError
        There is no such parameter, several layers have it, or it cannot have this value.
    """
    inputs, name = _find_input(look, parameter)
    layer, path = inputs[name]
    changed = _change_layer(layer, path, value, name, alone=len(look.layers) == 1)
    return replace(look, layers=tuple(changed if other is layer else other for other in look.layers))


def _find_input(look: Look, parameter: str) -> tuple[dict[str, tuple[Layer, tuple[str, ...]]], str]:
    """Find the input that `parameter` names, with or without its layer; ModelError where none or several match.

    Returns `variable_inputs` as a dict (full name to layer and path), and the full name of the input.
    """
    names = dict(variable_inputs(look))
    matches = [full_name for full_name in names if full_name == parameter] or [
        full_name for full_name, (layer, _) in names.items() if full_name.removeprefix(f"{layer.name}.") == parameter
    ]
    if not matches:
        short_names = [full_name.removeprefix(f"{layer.name}.") for full_name, (layer, _) in names.items()]
        hint = nearest_hint(parameter, list(dict.fromkeys([*names, *short_names])))
        raise ModelError(f"look '{look.name}' has no '{parameter}' ({hint})")
    if len(matches) > 1:
        hint = f"one of {', '.join(matches)} would be right"
        raise ModelError(f"several layers of look '{look.name}' have '{parameter}': {hint}")
    return names, matches[0]


@dataclass(frozen=True)
class Constant:
    """An input of a look that is a constant number or colour.

    `name` is its full name and `layer` the index of its layer in the look. `path` has the name of a parameter, or
    ``"mask"``. If the constant is an input of an expression there, the name of this input follows. `parameter` is the
    record with the kind and the ranges of the constant. `value` is one number, or the three channels of a colour.
    """

    name: str
    layer: int
    path: tuple[str, ...]
    parameter: Parameter
    value: tuple[float, ...]


def constant_named(look: Look, parameter: str) -> Constant:
    """Return a constant by its name, which may lack the layer as in `look_with_value`.

    Raises ModelError where no input or several have this name, or the input is not a constant number or colour.
    """
    inputs_by_name, full_name = _find_input(look, parameter)
    layer, path = inputs_by_name[full_name]
    record = MASK if path[0] == "mask" else layer_parameters(layer.model)[path[0]]
    source: Input | InputSource | None = _input_of(layer, path[0])
    if len(path) > 1:
        formula = _formula_of(layer, path[0])
        # An input of an expression has no default and, in effect, no bounds.
        record, source = Parameter(path[1], formula.kinds[path[1]], 0.0, (-1e18, 1e18)), formula.inputs[path[1]]
    elif source is None:
        # An unset input has the value of the parameter that it follows, or its default.
        source = layer.inputs.get(record.follows, record.default)
    if record.kind not in ("float", "color"):
        raise ModelError(f"{full_name} is a {record.kind}; a number or a colour would be right")
    if not isinstance(source, float | int | tuple):
        found_kind = "an expression" if isinstance(source, Formula) else "a texture or primvar"
        inputs = [name for name in inputs_by_name if name.startswith(f"{layer.name}.{path[0]}.")]
        hint = f": its inputs are {', '.join(inputs)}" if inputs else ""
        raise ModelError(f"{full_name} is {found_kind}, not a constant{hint}")
    value = tuple(map(float, source)) if isinstance(source, tuple) else (float(source),)
    value = value * 3 if record.kind == "color" and len(value) == 1 else value
    return Constant(full_name, look.layers.index(layer), path, record, value)


def look_with_live_inputs(look: Look, constants: Mapping[str, Constant]) -> Look:
    """Return a look with live inputs in place of `constants`. The caller chooses its keys, which name the live inputs.

    A live input is a primvar that no mesh has, with the reserved name ``live_primvar(key)``. Its fallback is the value
    of the constant. The compiled program of the look therefore has a variable for the live input, and can compute
    derivatives with respect to this variable.
    """
    sources = [(constant, Primvar(live_primvar(key), _constant_value(constant))) for key, constant in constants.items()]
    return _replace_sources(look, sources)


def replace_constants(look: Look, constants: Iterable[Constant]) -> Look:
    """Return a look in which each of `constants` has its `Constant.value`."""
    return _replace_sources(look, [(constant, _constant_value(constant)) for constant in constants])


def _constant_value(constant: Constant) -> float | Color:
    """Return the value of a constant as a source: a float, or a colour of three channels."""
    red, *others = constant.value
    return (red, *others) if others else red  # type: ignore[return-value]


def _replace_sources(look: Look, sources: Iterable[tuple[Constant, float | Color | Primvar]]) -> Look:
    """Return a look in which the constant of each pair is replaced by the source of the pair."""
    layers = list(look.layers)
    for constant, source in sources:
        layer, (name, *inside) = layers[constant.layer], constant.path
        new: Input = source if not inside else _replace_operand(_formula_of(layer, name), inside[0], source)
        layers[constant.layer] = _replace_input(layer, name, new)
    return replace(look, layers=tuple(layers))


def _input_of(layer: Layer, name: str) -> Input | None:
    """Return an input of a layer, or its mask; None where it is unset."""
    return layer.mask if name == "mask" else layer.inputs.get(name)


def _formula_of(layer: Layer, name: str) -> Formula:
    """Return an input of a layer, or its mask, which must be a formula."""
    formula = _input_of(layer, name)
    assert isinstance(formula, Formula), "only an expression has inputs"
    return formula


def _replace_operand(formula: Formula, name: str, source: InputSource) -> Formula:
    """Return a formula with another source of its input `name`."""
    return replace(formula, inputs={**formula.inputs, name: source})


def _replace_input(layer: Layer, name: str, source: Input) -> Layer:
    """Return a layer with another value of an input, or of its mask where `name` is ``"mask"``."""
    if name == "mask":
        return replace(layer, mask=cast(Mask, source))
    return replace(layer, inputs={**layer.inputs, name: source})


def live_primvar(key: str) -> str:
    """Return the name of the primvar that is the live input with this key."""
    return f"{_LIVE}{key}"


def is_live(primvar: str) -> bool:
    """Return whether a primvar of this name is a live input; see `look_with_live_inputs`."""
    return primvar.startswith(_LIVE)


def variable_inputs(look: Look) -> Iterator[tuple[str, tuple[Layer, tuple[str, ...]]]]:
    """Yield pairs (full name, (layer, path)) of all inputs of a look, set or unset.

    These are the parameters of every layer, the masks of all layers but the base, and the inputs of expressions.
    """
    for layer in look.layers:
        # The value 0 of an unset input has no meaning: any value that is not a formula would do.
        inputs: dict[str, Input] = dict.fromkeys(layer_parameters(layer.model), 0.0) | layer.inputs
        if layer is not look.layers[0]:
            inputs["mask"] = layer.mask
        for name, source in inputs.items():
            yield f"{layer.name}.{name}", (layer, (name,))
            if isinstance(source, Formula):
                for operand in source.inputs:
                    yield f"{layer.name}.{name}.{operand}", (layer, (name, operand))


def _change_layer(layer: Layer, path: tuple[str, ...], value: ParameterValue, full_name: str, *, alone: bool) -> Layer:
    """Return a layer with another value of the input at `path`; `alone` states that the look has no other layer.

    Raises ModelError, with `full_name`, where the input cannot have the value or cannot vary.
    """
    name, *inside = path
    parameter = MASK if name == "mask" else layer_parameters(layer.model)[name]
    new: Input
    if inside:
        formula = _formula_of(layer, name)
        number = _check_constant(full_name, Parameter(inside[0], formula.kinds[inside[0]], 0.0, (-1e18, 1e18)), value)
        new = _replace_operand(formula, inside[0], cast(float | Color, number))
    elif isinstance(value, str) and parameter.kind in ("float", "color"):
        new = _parse_formula(full_name, parameter, value, _input_of(layer, name))
    elif parameter.file or (parameter.kind == "token" and not alone):
        kind = "file" if parameter.file else "choice that layers share"
        raise ModelError(f"{full_name} is a {kind}, which cannot vary")
    else:
        new = _check_constant(full_name, parameter, value)
    return _replace_input(layer, name, new)


def _check_constant(
    full_name: str, parameter: Parameter, value: ParameterValue
) -> float | tuple[float, float, float] | str:
    """Return a value as a constant of a parameter: a float, a colour or text; for a colour, one number is a grey.

    Raises ModelError where the value has the wrong type or is outside the parameter's hard range.
    """
    grey = parameter.kind == "color" and isinstance(value, float | int)
    prefix, _, name = full_name.rpartition(".")
    # `complete` gets this parameter alone. The record must therefore not set other parameters (expand) or follow one.
    record = replace(parameter, name=name, expand=None, follows="")
    checked: str | Floats = complete(prefix, {name: record}, {name: (value,) * 3 if grey else value})[name]
    return checked if isinstance(checked, str) else checked.tolist() if checked.ndim == 0 else tuple(checked.tolist())


def _parse_formula(full_name: str, parameter: Parameter, text: str, source: Input | None) -> Formula:
    """Parse an expression into a formula that replaces `source`, the present value of the input.

    The expression may use the inputs of `source`, if that is a formula, and the view.
    """
    inputs = dict(source.inputs) if isinstance(source, Formula) else {}
    kinds = dict(source.kinds) if isinstance(source, Formula) else {}
    inputs.setdefault(VIEW, ViewCosine())
    kinds.setdefault(VIEW, "float")
    try:
        expression = parse(text)
        result = expression.check(kinds)
    except ExpressionError as error:
        raise ModelError(f"{full_name}: {error}") from error
    if parameter.kind == "float" and result == "color":
        raise ModelError(f"{full_name} is a color; a float would be right: luminance(...)")
    names = expression.names
    return Formula(expression, {name: inputs[name] for name in names}, {name: kinds[name] for name in names})
