"""Isotropic microfacet distributions of the Torrance-Sparrow model and their sampling; Smith's G1 for Beckmann's D.

- Beckmann, P. and Spizzichino, A. 1963. The Scattering of Electromagnetic Waves from Rough Surfaces.
- Blinn, J. F. 1977. Models of Light Reflection for Computer Synthesized Pictures. SIGGRAPH.
- Walter, B. et al. 2007. Microfacet Models for Refraction through Rough Surfaces. EGSR.
- Burley, B. 2012. Physically Based Shading at Disney, appendix B.

wm is the half vector, a unit vector (..., 3), and theta_h its angle to the normal. m is the roughness, and gamma the
exponent of the distribution ``"gtr"``. u1 and u2 are uniform random numbers.

The integral of D cos theta_h over the hemisphere is 1. The exception is ``"gaussian"``: its integral goes to 1 as m
goes to 0, and is smaller for larger m. Formulas use ``sin^2 theta_h = wm_x^2 + wm_y^2``, which does not cancel near the
normal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lookdev.brdf.classic.parts import log_complement, sin2_of_power, versine
from lookdev.brdf.microfacet import gtr2_aniso, polar
from lookdev.brdf.special import expm1_ratio, log1p_ratio, scaled_erfc, squared_angle
from lookdev.brdf.vectors import TINY, Array, Real

Density = Callable[[Array, Real, Real], Array]
"""A function of half vectors, m and gamma that returns D, (...), in 1/sr."""


@dataclass(frozen=True)
class Distribution:
    """A distribution D, and a way to draw half vectors from it or from a similar distribution.

    `density` is D. `sample` is a function of m, gamma, u1 and u2 that returns half vectors, with the pdf
    `sampled_density` times ``cos theta_h`` over their solid angle.
    """

    density: Density
    sample: Callable[[Real, Real, Array, Array], Array]
    sampled_density: Density


def _sin2(wm: Array) -> Array:
    """Return sin^2 theta_h, (...)."""
    return wm[..., 0] * wm[..., 0] + wm[..., 1] * wm[..., 1]


# Walter et al. 2007, eq. 25 and 28.
def _beckmann(wm: Array, m: Real, gamma: Real) -> Array:
    # At this floor, the exponential underflows to 0. Without the floor, D would be 0 / 0 at the horizon.
    cos2 = np.maximum(wm[..., 2] * wm[..., 2], 1e-8)
    return np.exp(-_sin2(wm) / (m * m * cos2)) / (np.pi * m * m * cos2 * cos2)


def _sample_beckmann(m: Real, gamma: Real, u1: Array, u2: Array) -> Array:
    tan2 = -m * m * log_complement(u2)
    return polar(tan2 / (1.0 + tan2), u1)


# Walter et al. 2007, eq. 33 and 35.
def _ggx(wm: Array, m: Real, gamma: Real) -> Array:
    return gtr2_aniso(wm, m, m)


def _sample_ggx(m: Real, gamma: Real, u1: Array, u2: Array) -> Array:
    square = m * m * u2
    return polar(square / (1.0 - u2 + square), u1)


# Burley 2012, eq. 1: (gamma - 1) (m^2 - 1) / (pi (1 - m^(2 - 2 gamma))) over t^gamma. With L = ln m^2 the factor is
# expm1_ratio(L) / (pi expm1_ratio((1 - gamma) L)), which is also defined at gamma = 1 (eq. 4), and 1 / pi at m = 1.
def _gtr(wm: Array, m: Real, gamma: Real) -> Array:
    log_m2 = 2.0 * np.log(m)
    t = m * m * wm[..., 2] * wm[..., 2] + _sin2(wm)
    factor: Array = expm1_ratio(log_m2) / (np.pi * expm1_ratio((1.0 - gamma) * log_m2))
    return factor * np.exp(-gamma * np.log(t))


# Burley 2012, appendix B, solved for t of `_gtr`. With x = (1 - gamma) L and R = 1 - ln(1 + (1 - u) expm1(x)) / x, the
# code computes sin^2 theta_h = (t - m^2) / (1 - m^2) from t = m^2 exp(-L R), without cancellation.
def _sample_gtr(m: Real, gamma: Real, u1: Array, u2: Array) -> Array:
    log_m2, complement = 2.0 * np.log(m), 1.0 - u2
    x = (1.0 - gamma) * log_m2
    excess = complement * x * expm1_ratio(x)
    log_ratio = 1.0 - complement * expm1_ratio(x) * log1p_ratio(excess, 1.0 + excess)
    sin2 = m * m * log_ratio * expm1_ratio(-log_m2 * log_ratio) / expm1_ratio(log_m2)
    return polar(np.clip(sin2, 0.0, 1.0), u1)


# Blinn 1977, normalised.
def _blinn(wm: Array, m: Real, gamma: Real) -> Array:
    """Return D in proportion to a power of cos theta_h, with the exponent 2 / m^2 - 2."""
    sin2, inverse = _sin2(wm), 1.0 / (m * m)
    return inverse / np.pi * np.exp((1.0 - inverse) * sin2 * log1p_ratio(-sin2, wm[..., 2] * wm[..., 2]))


def _sample_blinn(m: Real, gamma: Real, u1: Array, u2: Array) -> Array:
    return polar(sin2_of_power(m * m, u2), u1)


def _gaussian(wm: Array, m: Real, gamma: Real) -> Array:
    """Return D in proportion to exp(-theta_h^2 / m^2)."""
    inverse = 1.0 / (m * m)
    return inverse / np.pi * np.exp(-squared_angle(versine(wm)) * inverse)


DISTRIBUTIONS: dict[str, Distribution] = {
    "beckmann": Distribution(_beckmann, _sample_beckmann, _beckmann),
    "ggx": Distribution(_ggx, _sample_ggx, _ggx),
    "gtr": Distribution(_gtr, _sample_gtr, _gtr),
    "blinn": Distribution(_blinn, _sample_blinn, _blinn),
    # Half vectors are drawn from GGX of the same m, as this D is at most 1.5 times the D of GGX.
    "gaussian": Distribution(_gaussian, _sample_ggx, _ggx),
}
"""The distributions, by the token of the parameter ``"distribution"``. The first one is the default."""


# Walter et al. 2007, section 5.2: Lambda = exp(-a^2) (1 / (a sqrt(pi)) - exp(a^2) erfc(a)) / 2, a = 1 / (m tan theta).
def smith_beckmann(cos_theta: Array, m: Real) -> Array:
    """Return Smith's G1 for Beckmann's distribution, divided by ``2 cos theta``, for cosines (...) of directions.

    G1 is 1 / (1 + Lambda).
    """
    slope = m * np.sqrt(np.maximum((1.0 - cos_theta) * (1.0 + cos_theta), 0.0))
    # For a above 6, `masked` would be below 1e-17.
    a = np.minimum(cos_theta / np.maximum(slope, TINY), 6.0)
    masked = np.exp(-a * a) * (1.0 - np.sqrt(np.pi) * a * scaled_erfc(a))
    g1: Array = 1.0 / (2.0 * cos_theta + slope * (1.0 / np.sqrt(np.pi)) * masked)
    return g1
