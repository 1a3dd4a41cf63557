"""Fits of integrals that have no closed form, as small rationals in plain arithmetic, which can be traced.

`lookdev.closures.fitting` defines each one and writes the table ``data/closure_fits.json``: coefficients and residuals.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from lookdev.brdf.vectors import Real

DATA = Path(__file__).parent / "data" / "closure_fits.json"
"""The file of the table."""

Rows = Sequence[Sequence[float]]


@dataclass(frozen=True)
class Rational:
    """A quotient of two polynomials in x and y; a row has the coefficients of one power of x, by powers of y."""

    numerator: Rows
    denominator: Rows

    def __call__(self, x: Real, y: Real = 0.0) -> Real:
        """Evaluate at x and y, (...), within the fitted domain."""
        return polynomial(self.numerator, x, y) / polynomial(self.denominator, x, y)


def polynomial(rows: Rows, x: Real, y: Real) -> Real:
    """Evaluate the sum of ``rows[i][j] x^i y^j`` by Horner's rule."""
    total: Real = 0.0
    for row in reversed(rows):
        inner: Real = 0.0
        for coefficient in reversed(row):
            inner = inner * y + coefficient
        total = total * x + inner
    return total


@cache
def table() -> dict[str, Any]:
    """Return the whole table."""
    loaded: dict[str, Any] = json.loads(DATA.read_text())
    return loaded


@cache
def fit(name: str) -> Rational:
    """Return a fit of the table."""
    entry = table()["fits"][name]
    return Rational(entry["numerator"], entry["denominator"])


def shape(name: str) -> Mapping[str, Any]:
    """Return the parameters of a mix of closures."""
    numbers: Mapping[str, Any] = table()["shapes"][name]
    return numbers
