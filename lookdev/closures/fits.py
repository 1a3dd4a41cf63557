"""Read the table of fitted numbers from which the weights and shapes of closures are computed.

The fits replace integrals without a closed form. They are rational functions in plain arithmetic, so that code
generation can trace them into shaders. `lookdev.closures.fitting` computes the table and writes it to
``data/closure_fits.json``.

A *mix* is the sum of closures that approximates a lobe. The *shape* of a mix is the set of numbers that determine the
roughness and the share of each closure.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NotRequired, TypedDict

from lookdev.brdf.rational import Rational

FITS_FILE = Path(__file__).parent / "data" / "closure_fits.json"
"""The file of the table, a `ClosureTable` as JSON."""


class RetroShape(TypedDict):
    """The shape of the rough diffuse closure in `lookdev.closures.disney`.

    `strength` is the closure's roughness at grazing views for a lobe of roughness 1. `distance`, here and in other
    shapes, is half the L1 distance between a mix and its lobe, both normalised. The entries ``"largest"`` and
    ``"mean"`` are over the views that were compared.
    """

    strength: float
    distance: dict[str, float]


class CoatShape(TypedDict):
    """The shape of the clearcoat's mix; `lookdev.closures.disney.coat_mix` explains the numbers."""

    powers: list[float]
    shares: list[float]
    distance: NotRequired[dict[str, float]]


class HighlightShape(TypedDict):
    """The shape of the mix for a highlight; `lookdev.closures.pixar.highlight_mix` explains the numbers."""

    start: float
    slope: float
    width: float
    distance: NotRequired[dict[str, float]]


class AnisotropicShape(TypedDict):
    """The numbers that describe how anisotropic lobes differ from isotropic ones.

    `lookdev.closures.disney.apparent_alphas` explains them. `residual` is as in `ClosureFit`.
    """

    azimuth: float
    skew: float
    skew_rise: float
    residual: NotRequired[dict[str, float]]


class MixShapes(TypedDict):
    """The shapes of mixes that must be known before the fits: some fits correct the albedos of these mixes."""

    clearcoat: CoatShape
    highlight: HighlightShape


class ClosureShapes(MixShapes):
    """All shapes of the table."""

    retro: RetroShape
    anisotropic: AnisotropicShape


class ClosureFit(TypedDict):
    """The coefficients of a `Rational`, and its errors.

    The fit causes errors of directional albedo. `residual` has the largest error, ``"largest"``, and the root mean
    square of the errors, ``"rms"``.
    """

    numerator: Sequence[Sequence[float]]
    denominator: Sequence[Sequence[float]]
    residual: dict[str, float]


class ClosureTable(TypedDict):
    """The shapes of mixes of closures by name, and the fits by name."""

    shapes: ClosureShapes
    fits: dict[str, ClosureFit]


@cache
def closure_table() -> ClosureTable:
    """Return the table of `FITS_FILE`, read once."""
    loaded: ClosureTable = json.loads(FITS_FILE.read_text())
    return loaded


@cache
def closure_fit(name: str) -> Rational:
    """Return the rational function `name` of the table.

    `lookdev.closures.fitting.make_fits` defines the functions and their variables.
    """
    entry = closure_table()["fits"][name]
    return Rational(entry["numerator"], entry["denominator"])
