"""The unknowns of a fit to a picture: constants of a look that are searched within bounds, scaled to similar ranges."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import Parameter
from lookdev.errors import LookdevError
from lookdev.material import Look
from lookdev.material.change import Constant, constant_named

_LOGARITHMIC_END = 100.0
"""If the range of starts ends at this number or above, as for exponents, the search uses log(1 + number)."""

_EXPOSURE = Parameter("exposure", "float", 0.0, (-10.0, 10.0), (-2.0, 2.0))
_NAME_WITH_RANGE = re.compile(r"([^=]+)=(.+)\.\.(.+)")  # like sheen=0..0.3


@dataclass(frozen=True)
class Unknown:
    """A constant that is searched between `low` and `high`; starts are drawn within `start_range`.

    The search works with scaled numbers, called units. A unit is the number divided by the width of `start_range`. For
    a wide range, a unit is log(1 + number), divided by log(1 + the upper end of `start_range`).
    """

    constant: Constant
    low: float
    high: float
    start_range: tuple[float, float]

    @property
    def name(self) -> str:
        """The full name of the constant, with the name of the layer."""
        return self.constant.name

    @property
    def width(self) -> int:
        """The number of components of the constant."""
        return len(self.constant.value)

    @property
    def is_exposure(self) -> bool:
        """Whether this is the exposure of the picture, in stops, and not a parameter of a look."""
        return self.constant.layer < 0

    @property
    def _is_logarithmic(self) -> bool:
        return self.low >= 0.0 and self.start_range[1] >= _LOGARITHMIC_END

    @property
    def _scale(self) -> float:
        low, high = self.start_range
        return float(np.log1p(high)) if self._is_logarithmic else high - low

    def unit(self, value: Floats) -> Floats:
        """Return values, (..., width), scaled to units."""
        scaled = np.log1p(value) if self._is_logarithmic else np.asarray(value, np.float64)
        return np.asarray(scaled / self._scale)

    def units(self, number: float) -> Floats:
        """Return a number scaled to units and repeated for each component, (width,)."""
        return np.repeat(self.unit(np.array(number)), self.width)

    def value(self, unit: Floats) -> Floats:
        """Return units, (..., width), scaled back to values and clipped to the bounds."""
        scaled = unit * self._scale
        return np.clip(np.expm1(scaled) if self._is_logarithmic else scaled, self.low, self.high)

    def rate(self, unit: Floats) -> Floats:
        """Return the derivatives (..., width) of values with respect to units (..., width)."""
        return np.asarray(self._scale * (np.exp(unit * self._scale) if self._is_logarithmic else np.ones_like(unit)))


EXPOSURE = Unknown(Constant("exposure", -1, ("exposure",), _EXPOSURE, (0.0,)), *_EXPOSURE.hard, _EXPOSURE.soft)
"""The exposure of the picture, in stops, as an unknown."""


def parse_unknowns(look: Look, names: Sequence[str]) -> tuple[Unknown, ...]:
    """Return the unknowns of a look by names of its constants: ``roughness``, ``Flakes.mask``, ``sheen=0..0.3``.

    A range after the name sets the bounds; without a range, the bounds are the hard range of the parameter. An input of
    an expression has no hard range, so its bounds must be given. Raises LookdevError if they are not given, if a name
    is unknown or repeated, or if a range is invalid.
    """
    unknowns: list[Unknown] = []
    for text in names:
        match = _NAME_WITH_RANGE.fullmatch(text.strip())
        constant = constant_named(look, match[1].strip() if match else text.strip())
        low, high = constant.parameter.hard
        start_range = constant.parameter.soft
        if match:
            low, high = start_range = _parse_range(text, match[2], match[3], (low, high))
        elif len(constant.path) > 1:
            raise LookdevError(f"{text}: an input of an expression has no range; '{text}=0..1' would be right")
        if any(unknown.name == constant.name for unknown in unknowns):
            raise LookdevError(f"{constant.name}: is named twice")
        if not all(low <= number <= high for number in constant.value):
            value = ", ".join(f"{number:g}" for number in constant.value)
            raise LookdevError(f"{text}: the look has {value}, which is not in {low:g}..{high:g}")
        unknowns.append(Unknown(constant, low, high, (max(start_range[0], low), min(start_range[1], high))))
    if not unknowns:  # `names` is empty: there is nothing to fit
        raise LookdevError("no parameter is to be found; --parameters roughness,baseColor would be right")
    return tuple(unknowns)


def _parse_range(text: str, low: str, high: str, hard: tuple[float, float]) -> tuple[float, float]:
    """Return the bounds in `text`; raises LookdevError unless they rise and are within the hard range."""
    try:
        ends = float(low), float(high)
    except ValueError:
        raise LookdevError(f"{text}: a range is two numbers: sheen=0..0.3") from None
    if not hard[0] <= ends[0] < ends[1] <= hard[1]:
        raise LookdevError(f"{text}: ends that rise, within {hard[0]:g}..{hard[1]:g}, would be right")
    return ends
