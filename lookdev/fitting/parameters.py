"""Which parameters of a model are fitted, and the numbers in [0, 1] by which the search moves them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lookdev.brdf import Model, Parameter
from lookdev.errors import LookdevError, nearest_hint
from lookdev.plotting.angles import Floats

_WIDE = 100.0
"""The quotient of the ends of a range from which on its logarithm is even."""


@dataclass(frozen=True)
class Free:
    """A parameter that is fitted, of `width` numbers, 1 or 3, between `low` and `high`."""

    parameter: Parameter
    low: float
    high: float

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.parameter.name

    @property
    def width(self) -> int:
        """How many numbers it has."""
        return 3 if self.parameter.kind == "color" else 1

    @property
    def _logarithmic(self) -> bool:
        return self.low > 0.0 and self.high / self.low >= _WIDE

    def value(self, unit: Floats) -> Floats:
        """Return values from numbers (..., width) in [0, 1]: (...), or (..., 3) of a colour."""
        if self._logarithmic:
            made = self.low * (self.high / self.low) ** unit
        else:
            made = self.low + (self.high - self.low) * unit
        made = np.clip(made, self.low, self.high)
        return np.asarray(made if self.width == 3 else made[..., 0])

    def unit(self, value: Any) -> Floats:
        """Return numbers (width,) in [0, 1] of a value."""
        value = np.clip(np.atleast_1d(np.asarray(value, np.float64)), self.low, self.high)
        if self._logarithmic:
            return np.asarray(np.log(value / self.low) / np.log(self.high / self.low))
        return np.asarray((value - self.low) / (self.high - self.low))


def free_parameters(model: Model, fixed: Mapping[str, Any], wanted: Sequence[str] = ()) -> tuple[Free, ...]:
    """Return the parameters to fit: the wanted ones, else all numbers and colours that no optional part has.

    Presence, of which f is no function, and what is fixed are not fitted. A range is that of the slider, within the
    hard one. Raises LookdevError for a name that is none, or is fixed or no number.
    """
    numbers = {name: each for name, each in model.parameters.items() if each.kind in ("float", "color")}
    for name in wanted:
        if name not in numbers:
            raise LookdevError(f"{model.name} has no number '{name}' ({nearest_hint(name, list(numbers))})")
        if name in fixed:
            raise LookdevError(f"{model.name}.{name} is given and wanted; one of the two would be right")
    usual = [name for name, each in numbers.items() if not each.optional and name != "presence" and name not in fixed]
    chosen = [numbers[name] for name in (wanted or usual)]
    return tuple(Free(each, max(each.soft[0], each.hard[0]), min(each.soft[1], each.hard[1])) for each in chosen)
