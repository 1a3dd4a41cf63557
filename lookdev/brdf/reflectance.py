"""The fitted directional albedo of a GGX lobe with Schlick's Fresnel term.

It is the share of light that a coat withholds from the layers beneath. ``python -m lookdev.closures.reflectance`` makes
the table ``data/reflectance.json``: coefficients and residuals.
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
    """Return the share of uniform light, (...), that a GGX lobe of `alpha` and mean `f0`, (...), reflects to a view.

    The lobe has Smith's separable shadowing; its Fresnel term rises from `f0` to 1.
    """
    unweighted, typical_cosine = ggx_albedo(cos_theta, alpha)
    return unweighted * mix(f0, 1.0, schlick_weight(typical_cosine))


def ggx_albedo(cos_theta: Array, alpha: Array) -> tuple[Array, Array]:
    """Return the lobe's albedo with a Fresnel term of 1, (...), and a cosine that is typical of the lobe, (...).

    At that cosine, Schlick's term has its mean over the lobe. `cos_theta` is the cosine of the view.
    """
    unweighted = np.clip(load_rational(FITS_FILE, "whole")(relative_cosine(cos_theta, alpha), alpha), 0.0, 1.0)
    return unweighted, np.clip(load_rational(FITS_FILE, "cosine")(cos_theta, alpha), 0.0, 1.0)


def relative_cosine(cos_theta: Array, alpha: Array) -> Array:
    """Return the cosine of the view relative to the lobe's width, (...), in [0, 1]. Fits are smooth in it."""
    return cos_theta / np.sqrt(cos_theta * cos_theta + alpha * alpha)
