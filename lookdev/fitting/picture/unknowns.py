"""What is searched: constants of a look within bounds, as numbers of about one scale."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookdev.brdf import Parameter
from lookdev.errors import LookdevError
from lookdev.material import Look
from lookdev.material.change import Constant, constant_of

Floats = NDArray[np.float64]

_WIDE = 100.0
"""The end of a slider from which on 1 plus a number is searched by its logarithm: exponents."""

_EXPOSURE = Constant(
    "exposure", -1, ("exposure",), Parameter("exposure", "float", 0.0, (-10.0, 10.0), (-2.0, 2.0)), (0.0,)
)
_RANGED = re.compile(r"([^=]+)=(.+)\.\.(.+)")


@dataclass(frozen=True)
class Unknown:
    """A constant that is searched between `low` and `high`; starts are drawn between the ends of `usual`.

    Its numbers are searched as units: in linear steps of the width of `usual`, or as the logarithm of 1 plus them.
    """

    constant: Constant
    low: float
    high: float
    usual: tuple[float, float]

    @property
    def name(self) -> str:
        """The whole name, of the layer too."""
        return self.constant.name

    @property
    def width(self) -> int:
        """How many numbers it has."""
        return len(self.constant.value)

    @property
    def is_exposure(self) -> bool:
        """Whether it is the picture's exposure, in stops, no parameter of a look."""
        return self.constant.layer < 0

    @property
    def _curved(self) -> bool:
        return self.low >= 0.0 and self.usual[1] >= _WIDE

    @property
    def _scale(self) -> float:
        return float(np.log1p(self.usual[1])) if self._curved else self.usual[1] - self.usual[0]

    def unit(self, value: Floats) -> Floats:
        """Return units of values."""
        given = np.log1p(value) if self._curved else np.asarray(value, np.float64)
        return np.asarray(given / self._scale)

    def value(self, unit: Floats) -> Floats:
        """Return values of units, within the bounds."""
        given = unit * self._scale
        return np.clip(np.expm1(given) if self._curved else given, self.low, self.high)

    def rate(self, unit: Floats) -> Floats:
        """Return the derivatives of values by units."""
        return np.asarray(self._scale * (np.exp(unit * self._scale) if self._curved else np.ones_like(unit)))


def exposure_unknown() -> Unknown:
    """Return the picture's exposure, in stops, as an unknown."""
    return Unknown(_EXPOSURE, *_EXPOSURE.parameter.hard, _EXPOSURE.parameter.soft)


def unknowns_of(look: Look, wanted: Sequence[str]) -> tuple[Unknown, ...]:
    """Return the unknowns of a look by names of its constants: ``roughness``, ``Flakes.mask``, ``sheen=0..0.3``.

    Bounds are those given, else the hard range of the parameter. Raises LookdevError where a name is none or twice, a
    range is none, or an input of an expression, which has no range of its own, is given none.
    """
    found: list[Unknown] = []
    for text in wanted:
        match = _RANGED.fullmatch(text.strip())
        constant = constant_of(look, match[1].strip() if match else text.strip())
        low, high = constant.parameter.hard
        usual = constant.parameter.soft
        if match:
            low, high = usual = _range(text, match[2], match[3], (low, high))
        elif len(constant.path) > 1:
            raise LookdevError(f"{text}: an input of an expression has no range; '{text}=0..1' would be right")
        if any(each.name == constant.name for each in found):
            raise LookdevError(f"{constant.name}: is named twice")
        if not all(low <= each <= high for each in constant.value):
            given = ", ".join(f"{each:g}" for each in constant.value)
            raise LookdevError(f"{text}: the look has {given}, which is not in {low:g}..{high:g}")
        found.append(Unknown(constant, low, high, (max(usual[0], low), min(usual[1], high))))
    if not found:
        raise LookdevError("no parameter is to be found; --parameters roughness,baseColor would be right")
    return tuple(found)


def _range(text: str, low: str, high: str, hard: tuple[float, float]) -> tuple[float, float]:
    try:
        ends = float(low), float(high)
    except ValueError:
        raise LookdevError(f"{text}: a range is two numbers: sheen=0..0.3") from None
    if not hard[0] <= ends[0] < ends[1] <= hard[1]:
        raise LookdevError(f"{text}: ends that rise, within {hard[0]:g}..{hard[1]:g}, would be right")
    return ends
