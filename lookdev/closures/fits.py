"""Fits of integrals without a closed form: small rationals in plain arithmetic, which can be traced.

`lookdev.closures.fitting` defines them and writes the table ``data/closure_fits.json``: coefficients and residuals.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from lookdev.brdf.rational import Rational

DATA = Path(__file__).parent / "data" / "closure_fits.json"
"""The file of the table."""


@cache
def table() -> dict[str, Any]:
    """Return the whole table."""
    loaded: dict[str, Any] = json.loads(DATA.read_text())
    return loaded


@cache
def fit(name: str) -> Rational:
    """Return the fit of a name in the table."""
    entry = table()["fits"][name]
    return Rational(entry["numerator"], entry["denominator"])


def shape(name: str) -> Mapping[str, Any]:
    """Return the parameters of the mix of closures of a name in the table."""
    numbers: Mapping[str, Any] = table()["shapes"][name]
    return numbers
