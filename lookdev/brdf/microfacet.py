"""Microfacet distributions D, shadowing, and the drawing of half vectors, for Disney's model and others.

They follow Burley 2012, appendix B, Smith 1967 and Walter et al. 2007.

wm is the half vector, a unit vector (..., 3), and theta_h its angle to the normal. alpha_x and alpha_y are the
roughness along tangent and bitangent, u1 and u2 uniform random numbers. Results are (...) or, for directions, (..., 3).

Distributions are written with ``sin^2 theta_h = wm_x^2 + wm_y^2``, because ``1 + (alpha^2 - 1) cos^2 theta_h`` cancels
in float32 exactly where a smooth lobe has its peak.

- Burley, B. 2012. Physically Based Shading at Disney. SIGGRAPH course notes, version 3 (2014).
- Walter, B. et al. 2007. Microfacet Models for Refraction through Rough Surfaces. EGSR.
- Heitz, E. 2014. Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs. JCGT 3(2).
- Dupuy, J. and Benyoub, A. 2023. Sampling Visible GGX Normals with Spherical Caps. HPG.
"""

from __future__ import annotations

import numpy as np

from lookdev.brdf.vectors import Array, Real, are_equal, normalize, vector


def polar(sin2: Array, u: Array) -> Array:
    """Return the unit vectors (..., 3) with the squared sine `sin2` to the normal and the azimuth ``2 pi u``."""
    sin_theta, phi = np.sqrt(sin2), 2.0 * np.pi * u
    return vector(sin_theta * np.cos(phi), sin_theta * np.sin(phi), np.sqrt(np.maximum(1.0 - sin2, 0.0)))


# Burley 2012, eq. 4.
def gtr1(wm: Array, alpha: Real) -> Array:
    """Return D of the generalised Trowbridge-Reitz distribution (GTR) with gamma = 1; alpha is in (0, 1)."""
    alpha2 = alpha * alpha
    t = alpha2 * wm[..., 2] * wm[..., 2] + wm[..., 0] * wm[..., 0] + wm[..., 1] * wm[..., 1]
    return (alpha2 - 1.0) / (np.pi * np.log(alpha2) * t)


# Burley 2012, eq. 2 and 5. sin^2 theta_h = alpha^2 (alpha^(-2 u) - 1) / (1 - alpha^2) is eq. 5 without cancellation.
def sample_gtr1(alpha: Real, u1: Array, u2: Array) -> Array:
    """Draw half vectors with the pdf ``D cos theta_h``, where D is the result of `gtr1`."""
    alpha2 = alpha * alpha
    return polar(alpha2 * np.expm1(-u2 * np.log(alpha2)) / (1.0 - alpha2), u1)


# Burley 2012, eq. 13.
def gtr2_aniso(wm: Array, alpha_x: Real, alpha_y: Real) -> Array:
    """Return D of the anisotropic GTR with gamma = 2, which is GGX or Trowbridge-Reitz."""
    x, y, z = wm[..., 0] / alpha_x, wm[..., 1] / alpha_y, wm[..., 2]
    t = x * x + y * y + z * z
    return 1.0 / (np.pi * alpha_x * alpha_y * t * t)


# Burley 2012, eq. 1. With L = log(alpha^2) and E(x) = (exp(x) - 1) / x, the constant of eq. 1 can be written as
# E(L) / (pi E((1 - gamma) L)), which has no singularity at gamma = 1. Burley has no anisotropic form with a closed
# normalisation. The form here stretches the slopes of the isotropic distribution whose alpha is the geometric mean of
# alpha_x and alpha_y. For gamma = 2 it is eq. 13.
def gtr_aniso(wm: Array, alpha_x: Real, alpha_y: Real, gamma: Real) -> Array:
    """Return D of the anisotropic GTR for any gamma."""
    alpha2 = alpha_x * alpha_y
    x2, y2, z2 = wm[..., 0] * wm[..., 0], wm[..., 1] * wm[..., 1], wm[..., 2] * wm[..., 2]
    ratio = alpha_y / alpha_x
    x2, y2 = x2 * ratio, y2 / ratio
    # The squared length of the half vector with unstretched slopes.
    length2: Real = 1.0 if are_equal(alpha_x, alpha_y) else x2 + y2 + z2
    log_alpha2 = np.log(alpha2)
    c = _expm1_ratio(log_alpha2) / (np.pi * _expm1_ratio((1.0 - gamma) * log_alpha2))
    d: Array = c * np.power(length2 / (alpha2 * z2 + x2 + y2), gamma) / (length2 * length2)
    return d


# Burley 2012, eq. 2 and 3. Without cancellation, sin^2 theta_h is (exp(w) - 1) alpha^2 / (1 - alpha^2), where w is
# log(1 + u (alpha^(2 (gamma - 1)) - 1)) / (1 - gamma).
def sample_gtr_aniso(alpha_x: Real, alpha_y: Real, gamma: Real, u1: Array, u2: Array) -> Array:
    """Draw half vectors with the pdf ``D cos theta_h``, where D is the result of `gtr_aniso`."""
    alpha2 = alpha_x * alpha_y
    log_alpha2 = np.log(alpha2)
    power = (gamma - 1.0) * log_alpha2
    # This is -w / log(alpha^2), with w of the comment above the function.
    scaled_log = u2 * _expm1_ratio(power) * _log1p_ratio(u2 * np.expm1(power))
    sin2 = np.minimum(alpha2 * scaled_log * _expm1_ratio(-log_alpha2 * scaled_log) / _expm1_ratio(log_alpha2), 1.0)
    phi = 2.0 * np.pi * u1
    sin_theta, stretch = np.sqrt(sin2), np.sqrt(alpha_x / alpha_y)
    x, y = sin_theta * np.cos(phi) * stretch, sin_theta * np.sin(phi) / stretch
    return normalize(vector(x, y, np.sqrt(1.0 - sin2)))


def _expm1_ratio(x: Array) -> Array:
    """Return ``(exp(x) - 1) / x``, which is 1 at 0."""
    small = np.absolute(x) < 1e-6
    return np.where(small, 1.0 + 0.5 * x, np.expm1(x) / np.where(small, 1.0, x))


def _log1p_ratio(x: Array) -> Array:
    """Return ``log(1 + x) / x``, which is 1 at 0."""
    small = np.absolute(x) < 1e-3
    series = 1.0 - x * (1.0 / 2.0 - x * (1.0 / 3.0 - x * (1.0 / 4.0 - x * (1.0 / 5.0))))
    return np.where(small, series, np.log(1.0 + x) / np.where(small, 1.0, x))


# Heitz 2014, eq. 86 with eq. 72:
# G1 / (2 cos theta) = 1 / (cos theta + sqrt(cos^2 theta + (alpha_x x)^2 + (alpha_y y)^2)).
def smith_ggx_aniso(w: Array, alpha_x: Real, alpha_y: Real) -> Array:
    """Return Smith's G1 of a direction `w` for the anisotropic GGX, divided by ``2 cos theta``.

    The product of the results for `wo` and `wi` is ``G / (4 cos_theta_i cos_theta_o)``.
    """
    x, y, z = w[..., 0] * alpha_x, w[..., 1] * alpha_y, w[..., 2]
    return 1.0 / (z + np.sqrt(x * x + y * y + z * z))


# Walter et al. 2007, eq. 34, in Burley's form.
def smith_ggx(cos_theta: Array, alpha: Real) -> Array:
    """Return Smith's G1 for the isotropic GGX, divided by ``2 cos theta``."""
    alpha2 = alpha * alpha
    cos2 = cos_theta * cos_theta
    return 1.0 / (cos_theta + np.sqrt(alpha2 + cos2 - alpha2 * cos2))


# Dupuy and Benyoub 2023, listing 3.
def sample_visible_ggx(wo: Array, alpha_x: Real, alpha_y: Real, u1: Array, u2: Array) -> Array:
    """Draw half vectors of GGX that are visible from `wo`: the pdf is ``G1(wo) D max(0, wo . wm) / cos_theta_o``."""
    standard = normalize(vector(wo[..., 0] * alpha_x, wo[..., 1] * alpha_y, wo[..., 2]))
    phi = 2.0 * np.pi * u1
    one_plus_z = (1.0 - u2) * (1.0 + standard[..., 2])
    z = one_plus_z - standard[..., 2]
    sin_theta = np.sqrt(np.maximum((1.0 - z) * (1.0 + z), 0.0))
    x = sin_theta * np.cos(phi) + standard[..., 0]
    y = sin_theta * np.sin(phi) + standard[..., 1]
    # z + standard_z is exactly one_plus_z, which is never negative.
    return normalize(vector(x * alpha_x, y * alpha_y, one_plus_z))


def visible_ggx_pdf(wo: Array, d: Array, alpha_x: Real, alpha_y: Real) -> Array:
    """Return the pdf ``G1(wo) D / (4 cos_theta_o)`` of views mirrored about the half vectors of `sample_visible_ggx`.

    `wo` are the views, and `d` is D at the half vector.
    """
    return 0.5 * d * smith_ggx_aniso(wo, alpha_x, alpha_y)


# Smits, "Specular" (`lookdev.brdf.pixar`), normalised: the integral of D cos theta_h is 1. In the scan of the paper,
# minus signs are missing.
def sin_gaussian(wm: Array, power: Real) -> Array:
    """Return D of a Gaussian of the sine, in proportion to ``exp(-power sin^2 theta_h)``."""
    sin2 = wm[..., 0] * wm[..., 0] + wm[..., 1] * wm[..., 1]
    return power / (-np.pi * np.expm1(-power)) * np.exp(-power * sin2)


def sample_sin_gaussian(power: Real, u1: Array, u2: Array) -> Array:
    """Draw half vectors with the pdf ``D cos theta_h``, where D is the result of `sin_gaussian`."""
    sin2 = np.clip(-np.log(1.0 + u1 * np.expm1(-power)) / power, 0.0, 1.0)
    sin_theta = np.sqrt(sin2)
    phi = 2.0 * np.pi * u2
    return vector(sin_theta * np.cos(phi), sin_theta * np.sin(phi), np.sqrt(1.0 - sin2))


def sample_cosine(u1: Array, u2: Array) -> Array:
    """Draw directions of the upper hemisphere with the pdf ``cos theta / pi``."""
    return polar(u1, u2)
