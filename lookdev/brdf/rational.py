"""Rational functions in plain arithmetic, which can be traced, for integrals without a closed form."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from lookdev.brdf.vectors import Real

Coefficients = Sequence[Sequence[float]]


@dataclass(frozen=True)
class Rational:
    """A quotient of two polynomials in x and y; each row has the coefficients of one power of x, by power of y."""

    numerator: Coefficients
    denominator: Coefficients

    def __call__(self, x: Real, y: Real = 0.0) -> Real:
        """Evaluate at x and y, (...), within the fitted domain."""
        return polynomial(self.numerator, x, y) / polynomial(self.denominator, x, y)


@cache
def load_rational(file: Path, name: str) -> Rational:
    """Return the function `name` of a JSON file of fits."""
    entry = json.loads(file.read_text())[name]
    return Rational(entry["numerator"], entry["denominator"])


def polynomial(rows: Coefficients, x: Real, y: Real) -> Real:
    """Evaluate the sum of ``rows[i][j] x^i y^j`` by Horner's rule."""
    total: Real = 0.0
    for row in reversed(rows):
        inner: Real = 0.0
        for coefficient in reversed(row):
            inner = inner * y + coefficient
        total = total * x + inner
    return total
