"""Fits of integrals without a closed form: small rationals in plain arithmetic, which can be traced.

`lookdev.closures.fitting` defines them and writes the table ``data/closure_fits.json``: coefficients and residuals.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NotRequired, TypedDict

from lookdev.brdf.rational import Rational

FITS_FILE = Path(__file__).parent / "data" / "closure_fits.json"
"""The file of the table."""


class RetroShape(TypedDict):
    """The `strength` of the rough diffuse closure in `lookdev.closures.disney`.

    It is the closure's roughness at grazing views for a lobe of roughness 1. `distance`, here and in other shapes, has
    the largest and the mean of half the L1 distance between a mix and its lobe, both normalised.
    """

    strength: float
    distance: dict[str, float]


class CoatShape(TypedDict):
    """The parameters of `lookdev.closures.disney.coat_mix`."""

    powers: list[float]
    shares: list[float]
    distance: NotRequired[dict[str, float]]


class HighlightShape(TypedDict):
    """The parameters of `lookdev.closures.pixar.highlight_mix`."""

    start: float
    slope: float
    width: float
    distance: NotRequired[dict[str, float]]


class AnisotropicShape(TypedDict):
    """The parameters of `lookdev.closures.disney.apparent_alphas`, and the errors of albedos."""

    azimuth: float
    skew: float
    skew_rise: float
    residual: NotRequired[dict[str, float]]


class MixShapes(TypedDict):
    """The shapes of mixes that fits depend on."""

    clearcoat: CoatShape
    highlight: HighlightShape


class ClosureShapes(MixShapes):
    """All shapes."""

    retro: RetroShape
    anisotropic: AnisotropicShape


class ClosureFit(TypedDict):
    """The coefficients of a `Rational`, and its errors."""

    numerator: Sequence[Sequence[float]]
    denominator: Sequence[Sequence[float]]
    residual: dict[str, float]


class ClosureTable(TypedDict):
    """The shapes of mixes of closures, and the fits of their factors."""

    shapes: ClosureShapes
    fits: dict[str, ClosureFit]


@cache
def closure_table() -> ClosureTable:
    """Return the whole table."""
    loaded: ClosureTable = json.loads(FITS_FILE.read_text())
    return loaded


@cache
def closure_fit(name: str) -> Rational:
    """Return the fit `name` of the table."""
    entry = closure_table()["fits"][name]
    return Rational(entry["numerator"], entry["denominator"])
