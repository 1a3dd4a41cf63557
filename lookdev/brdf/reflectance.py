"""The directional albedo of a GGX lobe with Schlick's Fresnel term, by fits, for layers with mode ``"coat"``.

The albedo is the share of the light that a coat reflects, and that the layers beneath do not receive. ``python -m
lookdev.closures.reflectance`` makes the fits, and writes ``data/reflectance.json`` with their coefficients and
residuals.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lookdev.brdf.fresnel import schlick_weight
from lookdev.brdf.rational import load_rational
from lookdev.brdf.vectors import Array, Real, mix

FITS_FILE = Path(__file__).parent / "data" / "reflectance.json"
"""The file of the fits."""


def ggx_reflectance(cos_theta: Array, alpha: Array, f0: Array) -> Real:
    """Return the directional albedo (...) of a GGX lobe with Smith's separable shadowing.

    `cos_theta` is the cosine of the view to the normal, `alpha` the roughness. The Fresnel term rises from `f0`, the
    mean of the channels, to 1. All are (...).
    """
    unweighted, typical_cosine = ggx_albedo(cos_theta, alpha)
    return unweighted * mix(f0, 1.0, schlick_weight(typical_cosine))


def ggx_albedo(cos_theta: Array, alpha: Array) -> tuple[Array, Array]:
    """Return the directional albedo (...) of a GGX lobe whose Fresnel term is 1, and a typical cosine (...).

    At the typical cosine, Schlick's weight is equal to its mean over the lobe. `cos_theta` is the cosine of the view to
    the normal, `alpha` the roughness.
    """
    unweighted = np.clip(load_rational(FITS_FILE, "whole")(relative_cosine(cos_theta, alpha), alpha), 0.0, 1.0)
    return unweighted, np.clip(load_rational(FITS_FILE, "cosine")(cos_theta, alpha), 0.0, 1.0)


def relative_cosine(cos_theta: Array, alpha: Array) -> Array:
    """Return the cosine (...) of the view relative to the lobe's width, in [0, 1], as a variable for smooth fits."""
    return cos_theta / np.sqrt(cos_theta * cos_theta + alpha * alpha)
