"""Chooses the parameters of a model that `lookdev fit` fits, and scales them to numbers in [0, 1] for the search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats
from lookdev.brdf import Model, Parameter
from lookdev.errors import LookdevError, nearest_hint

_LOGARITHMIC_RATIO = 100.0
"""A range from `low` to `high` is searched in its logarithm if high / low is at least this number."""


@dataclass(frozen=True)
class FreeParameter:
    """A fitted parameter, whose numbers are between `low` and `high`.

    The search varies units: numbers in [0, 1], where 0 stands for `low` and 1 for `high`.
    """

    parameter: Parameter
    low: float
    high: float

    @property
    def name(self) -> str:
        """The name of the parameter."""
        return self.parameter.name

    @property
    def width(self) -> int:
        """The number of components of its value: 1, or 3 for a colour."""
        return 3 if self.parameter.kind == "color" else 1

    @property
    def _is_logarithmic(self) -> bool:
        return self.low > 0.0 and self.high / self.low >= _LOGARITHMIC_RATIO

    def value(self, unit: Floats) -> Floats:
        """Return the values, (...), or (..., 3) for a colour, that units (..., width) stand for."""
        if self._is_logarithmic:
            value = self.low * (self.high / self.low) ** unit
        else:
            value = self.low + (self.high - self.low) * unit
        value = np.clip(value, self.low, self.high)
        return np.asarray(value if self.width == 3 else value[..., 0])

    def unit(self, value: ArrayLike) -> Floats:
        """Return the units (width,) of a value."""
        value = np.clip(np.atleast_1d(np.asarray(value, np.float64)), self.low, self.high)
        if self._is_logarithmic:
            return np.asarray(np.log(value / self.low) / np.log(self.high / self.low))
        return np.asarray((value - self.low) / (self.high - self.low))


def free_parameters(model: Model, fixed: Mapping[str, object], names: Sequence[str] = ()) -> tuple[FreeParameter, ...]:
    """Return the parameters to fit: those with the given names, or by default all numbers and colours.

    By default, optional parameters, parameters in `fixed` and presence, which does not change f, are left out. The
    range of a parameter is its soft range, within its hard range. Raises LookdevError for a name that is unknown or in
    `fixed`, or whose parameter is not a number or a colour.
    """
    numbers = {name: parameter for name, parameter in model.parameters.items() if parameter.kind in ("float", "color")}
    for name in names:
        if name not in numbers:
            raise LookdevError(f"{model.name} has no number '{name}' ({nearest_hint(name, list(numbers))})")
        if name in fixed:
            raise LookdevError(f"{model.name}.{name} is both fixed and to be fitted; one of the two would be right")
    selected = [numbers[name] for name in names] or [
        parameter for name, parameter in numbers.items() if not parameter.optional and name not in ("presence", *fixed)
    ]
    return tuple(
        FreeParameter(parameter, max(parameter.soft[0], parameter.hard[0]), min(parameter.soft[1], parameter.hard[1]))
        for parameter in selected
    )
