"""The records of a model's parameters, with type, default, ranges and help, and the check of given values.

`shaders/shaderDefs.usda`, the generated code and every message about a parameter follow these records.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from lookdev.arrays import Floats
from lookdev.errors import ModelError, nearest_hint

ParameterValue = float | tuple[float, float, float] | str
"""A constant value of a parameter: a number, a colour or normal, or a token."""


@dataclass(frozen=True)
class Parameter:
    """One input of a reflectance model.

    Attributes
    ----------
    kind
        A ``"float"`` is a number. A ``"color"`` is linear Rec.709. A ``"normal"`` is a vector in the frame of tangent,
        bitangent and shading normal, of any length but zero. A ``"token"`` is a word that selects a form of the model.
        Code is generated for one form, so a token must be constant.
    default
        The value of a parameter that is not given.
    hard
        The range outside which the model has no meaning. A constant outside it is an error at load time. Ranges of a
        colour hold for each channel.
    soft
        The range of a slider.
    choices
        The values that a token can have.
    help
        The text for users. It is part of the digests of node trees, so a new text renders their frames again.
    unit
        The unit of the number, empty for a ratio.
    follows
        The name of another parameter with the same default. If this parameter is not given, it has the value of the
        other one.
    optional
        Whether the number belongs to a part of the model that is off at the number's default.
    agreement
        How layers that one model combines may differ in a token. ``"alike"``: they must not differ. ``"apart"``: layers
        that differ are blended in the same way as layers of different models. ``"own"``: each layer has its own value.
    expand
        If a token is an abbreviation, and not a form of the model: a function that returns the values of other
        parameters, by name, from all tokens of the layer. After these parameters have been set, the token has its
        default.
    file
        A function that reads a file, given by its path. A token with such a function is the path of a file or one of
        `choices`, and must be given.
    """

    name: str
    kind: Literal["float", "color", "normal", "token"]
    default: ParameterValue
    hard: tuple[float, float] = (0.0, 1.0)
    soft: tuple[float, float] = (0.0, 1.0)
    choices: tuple[str, ...] = ()
    help: str = ""
    unit: str = ""
    follows: str = ""
    optional: bool = False
    agreement: Literal["alike", "apart", "own"] = "alike"
    expand: Callable[[Mapping[str, str]], Mapping[str, ParameterValue]] | None = None
    file: Callable[[str], object] | None = None


def parameters_by_name(*parameters: Parameter) -> dict[str, Parameter]:
    """Return parameters by name."""
    return {parameter.name: parameter for parameter in parameters}


def token_parameter(
    name: str,
    choices: tuple[str, ...],
    help: str,
    agreement: Literal["alike", "apart", "own"] = "alike",
    expand: Callable[[Mapping[str, str]], Mapping[str, ParameterValue]] | None = None,
) -> Parameter:
    """Return a parameter that is a token, by default the first of `choices`."""
    return Parameter(name, "token", choices[0], choices=choices, help=help, agreement=agreement, expand=expand)


def normal_parameter(name: str, help: str, follows: str = "") -> Parameter:
    """Return a parameter that is a normal, by default the shading normal or the normal named `follows`."""
    return Parameter(name, "normal", (0.0, 0.0, 1.0), (-1.0, 1.0), (-1.0, 1.0), help=help, follows=follows)


PRESENCE = Parameter(
    "presence", "float", 1.0, help="How much of the layer is there; what is beneath it, or behind, shows through."
)
"""The presence of a layer of the models that have one."""

MASK = Parameter("mask", "float", 1.0, help="How much of a layer there is.")
"""The mask of a layer of any model."""


_T = TypeVar("_T")


def add_followers(parameters: Mapping[str, Parameter], values: Mapping[str, _T]) -> dict[str, _T]:
    """Return `values`, and add the parameters that are left out and follow a given one (`Parameter.follows`)."""
    following = {name: parameter.follows for name, parameter in parameters.items() if name not in values}
    return dict(values) | {name: values[leader] for name, leader in following.items() if leader in values}


def expand_tokens(
    owner: str, parameters: Mapping[str, Parameter], values: Mapping[str, _T]
) -> dict[str, _T | ParameterValue]:
    """Return `values` with the tokens that are abbreviations replaced by the values that `Parameter.expand` returns.

    `owner`, the model's name, is for messages.

    Raises
    ------
    ModelError
        A token is not one of its choices, or one of `values` contradicts the expansion of an abbreviation.
    """
    shorthands = {name for name in values if name in parameters and parameters[name].expand}
    if not shorthands:
        return dict(values)
    tokens = {name: str(parameter.default) for name, parameter in parameters.items() if parameter.kind == "token"}
    tokens |= {
        name: str(_check_value(f"{owner}.{name}", parameters[name], values[name])) for name in tokens if name in values
    }
    expanded: dict[str, _T | ParameterValue] = {name: value for name, value in values.items() if name not in shorthands}
    for name in shorthands:
        expand = parameters[name].expand
        for target, value in (expand(tokens) if expand else {}).items():
            if target in values and not _equals(values[target], value):
                both = f"{owner}.{target} is {values[target]!r}, but {name} '{tokens[name]}' stands for {value!r}"
                raise ModelError(f"{both}; one of the two would be right")
            expanded[target] = value
    return expanded


def _equals(value: object, expected: ParameterValue) -> bool:
    """Return whether a given value, of any type, is the same as a parameter's value."""
    numbers = as_numbers(value)
    return value == expected if numbers is None or isinstance(expected, str) else np.array_equal(numbers, expected)


def complete(
    owner: str, parameters: Mapping[str, Parameter], constants: Mapping[str, object]
) -> dict[str, Floats | str]:
    """Return the values of all `parameters` by name: `constants`, which are checked, and defaults for the others.

    Floats become float64 arrays of shape (), colours and normals arrays of shape (3,). Tokens stay strings. `owner`,
    the model's name, is for messages.

    Raises
    ------
    ModelError
        A parameter is unknown, of the wrong type, not finite or outside its hard range.
    """
    for name in constants:
        if name not in parameters:
            raise ModelError(f"{owner}: unknown parameter '{name}' ({nearest_hint(name, list(parameters))})")
    values = add_followers(parameters, expand_tokens(owner, parameters, constants))
    return {
        name: _check_value(f"{owner}.{name}", parameter, values.get(name, parameter.default))
        for name, parameter in parameters.items()
    }


def as_numbers(value: object) -> Floats | None:
    """Return a number or a list of numbers as an array, or None for any other value, such as text and booleans."""
    parts = value if isinstance(value, list | tuple) else (value,)
    if any(isinstance(part, str | bytes | bool | np.bool_) for part in parts):
        return None
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None


def _check_value(location: str, parameter: Parameter, value: object) -> Floats | str:
    """Return a parameter's value as an array or a token; raise ModelError, with `location`, if it is not valid."""
    if parameter.kind == "token":
        if parameter.file:
            if not isinstance(value, str) or not value or "\0" in value:
                raise ModelError(f"{location} is {value!r}; the path of a file would be right")
            parameter.file(value)
            return value
        if not isinstance(value, str) or value not in parameter.choices:
            raise ModelError(f"{location} is {value!r}; one of {', '.join(parameter.choices)} would be right")
        return value
    shape = () if parameter.kind == "float" else (3,)
    array = as_numbers(value)
    if array is None or array.shape != shape:
        raise ModelError(f"{location} is {value!r}; {'three numbers' if shape else 'a number'} would be right")
    low, high = parameter.hard
    if not np.all((array >= low) & (array <= high) & np.isfinite(array)):
        raise ModelError(f"{location} is {value!r}; its range is {low:g} to {high:g}")
    if parameter.kind == "normal" and not array.any():
        raise ModelError(f"{location} is {value!r}; a vector with a direction would be right")
    return array
