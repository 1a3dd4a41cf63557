"""Rational functions of one or two variables, which are fitted to integrals and functions without a closed form.

They are plain arithmetic, so that code generation can trace them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from lookdev.brdf.vectors import Real

Coefficients = Sequence[Sequence[float]]
"""The coefficients of a polynomial: number j of row i is the factor of ``x^i y^j``."""


@dataclass(frozen=True)
class Rational:
    """A quotient of two polynomials in x and y."""

    numerator: Coefficients
    denominator: Coefficients

    def __call__(self, x: Real, y: Real = 0.0) -> Real:
        """Return the value (...) at x and y (...), which must be within the domain of the fit."""
        return polynomial(self.numerator, x, y) / polynomial(self.denominator, x, y)


@cache
def load_rational(file: Path, name: str) -> Rational:
    """Return the function `name` in a JSON file of fits."""
    entry = json.loads(file.read_text())[name]
    return Rational(entry["numerator"], entry["denominator"])


def polynomial(rows: Coefficients, x: Real, y: Real) -> Real:
    """Return the sum of ``rows[i][j] x^i y^j``, by Horner's rule."""
    total: Real = 0.0
    for row in reversed(rows):
        inner: Real = 0.0
        for coefficient in reversed(row):
            inner = inner * y + coefficient
        total = total * x + inner
    return total
