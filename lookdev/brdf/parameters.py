"""Parameters of a model: type, default, ranges and help.

`shaders/shaderDefs.usda`, the generated OSL and every message about a parameter follow these records.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from lookdev.errors import ModelError, nearest_hint

Value = float | tuple[float, float, float] | str


@dataclass(frozen=True)
class Parameter:
    """One input of a reflectance model.

    `hard` is the range outside which the model has no meaning: a constant outside it is an error at load time. `soft`
    is the range of a slider, `unit` that of the number, empty where it is a ratio. Colours are linear Rec.709 and their
    ranges hold per channel. A ``"token"`` is one of `choices`, forms of the model between which code generation
    chooses: it must be constant. A ``"normal"`` is a vector in the frame of tangent, bitangent and shading normal, of
    any length but zero. Where it is not given, it has the value of the parameter that it `follows`, whose default is
    the same. `optional` numbers belong to parts of the model that their defaults leave out. A token with `file` may be
    the path of a file, too, which that function reads, and must be given.

    `among` layers that one model combines, a token must be ``"alike"``; layers that differ in it are blended
    ``"apart"``, as those of two models are; or it is each layer's ``"own"``. A token that `stands` for values of other
    parameters, by all tokens of the layer, is no form of the model: once they have their values, it has its default.
    """

    name: str
    kind: Literal["float", "color", "normal", "token"]
    default: Value
    hard: tuple[float, float] = (0.0, 1.0)
    soft: tuple[float, float] = (0.0, 1.0)
    choices: tuple[str, ...] = ()
    help: str = ""
    unit: str = ""
    follows: str = ""
    optional: bool = False
    among: Literal["alike", "apart", "own"] = "alike"
    stands: Callable[[Mapping[str, str]], Mapping[str, Value]] | None = None
    file: Callable[[str], object] | None = None


def normal_parameter(name: str, help: str, follows: str = "") -> Parameter:
    """Return a normal, by default the shading normal or the one that it follows."""
    return Parameter(name, "normal", (0.0, 0.0, 1.0), (-1.0, 1.0), (-1.0, 1.0), help=help, follows=follows)


MASK = Parameter("mask", "float", 1.0, help="How much of a layer there is.")
"""The mask of a layer, of whatever model."""


_T = TypeVar("_T")


def with_followers(parameters: Mapping[str, Parameter], given: Mapping[str, _T]) -> dict[str, _T]:
    """Return given values, and those of parameters that follow them and are not given."""
    following = {name: parameter.follows for name, parameter in parameters.items() if name not in given}
    return dict(given) | {name: given[followed] for name, followed in following.items() if followed in given}


def spelled_out(owner: str, parameters: Mapping[str, Parameter], given: Mapping[str, _T]) -> dict[str, _T | Value]:
    """Replace tokens among given values by the values that they stand for.

    Raises ModelError where a token is none of its choices, or another value is given for what it stands for.
    """
    short = {name for name in given if name in parameters and parameters[name].stands}
    if not short:
        return dict(given)
    tokens = {name: str(each.default) for name, each in parameters.items() if each.kind == "token"}
    tokens |= {name: _checked(f"{owner}.{name}", parameters[name], given[name]) for name in tokens if name in given}
    spelled: dict[str, _T | Value] = {name: value for name, value in given.items() if name not in short}
    for name in short:
        stands = parameters[name].stands
        for meant, value in (stands(tokens) if stands else {}).items():
            if meant in given and not _is(given[meant], value):
                both = f"{owner}.{meant} is {given[meant]!r}, but {name} '{tokens[name]}' stands for {value!r}"
                raise ModelError(f"{both}; one of the two would be right")
            spelled[meant] = value
    return spelled


def _is(value: object, wanted: Value) -> bool:
    numbers = as_numbers(value)
    return value == wanted if numbers is None or isinstance(wanted, str) else np.array_equal(numbers, wanted)


def complete(owner: str, parameters: Mapping[str, Parameter], given: Mapping[str, object]) -> dict[str, Any]:
    """Check constant values of `parameters` and fill in the defaults; `owner` names them in messages.

    Floats become float64 scalars, colours and normals arrays of shape (3,), tokens stay strings.

    Raises
    ------
    ModelError
        A parameter is unknown, of the wrong type, not finite or outside its hard range.
    """
    for name in given:
        if name not in parameters:
            raise ModelError(f"{owner}: unknown parameter '{name}' ({nearest_hint(name, list(parameters))})")
    values = with_followers(parameters, spelled_out(owner, parameters, given))
    return {
        name: _checked(f"{owner}.{name}", parameter, values.get(name, parameter.default))
        for name, parameter in parameters.items()
    }


def as_numbers(value: object) -> NDArray[np.float64] | None:
    """Return a number, or an array of them; None for what is none, as text and truth values are."""
    parts = value if isinstance(value, list | tuple) else (value,)
    if any(isinstance(each, str | bytes | bool | np.bool_) for each in parts):
        return None
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None


def _checked(place: str, parameter: Parameter, value: object) -> Any:
    if parameter.kind == "token":
        if parameter.file:
            if not isinstance(value, str) or not value or "\0" in value:
                raise ModelError(f"{place} is {value!r}; the path of a file would be right")
            parameter.file(value)
            return value
        if value not in parameter.choices:
            raise ModelError(f"{place} is {value!r}; one of {', '.join(parameter.choices)} would be right")
        return value
    shape = () if parameter.kind == "float" else (3,)
    array = as_numbers(value)
    if array is None or array.shape != shape:
        raise ModelError(f"{place} is {value!r}; {'three numbers' if shape else 'a number'} would be right")
    low, high = parameter.hard
    if not np.all((array >= low) & (array <= high) & np.isfinite(array)):
        raise ModelError(f"{place} is {value!r}; its range is {low:g} to {high:g}")
    if parameter.kind == "normal" and not array.any():
        raise ModelError(f"{place} is {value!r}; a vector with a direction would be right")
    return array
