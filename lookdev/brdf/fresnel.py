"""Fresnel reflectance: Schlick's approximation, and the exact equations for dielectrics and conductors.

- Schlick, C. 1994. An Inexpensive BRDF Model for Physically-Based Rendering. Computer Graphics Forum 13(3).
- Born, M. and Wolf, E. 1999. Principles of Optics, 7th edition, sections 1.5 and 14.2.
"""

from __future__ import annotations

import numpy as np

from lookdev.brdf.vectors import TINY, Array, Real, are_equal


# Schlick 1994, eq. 15.
def schlick_weights(cos_theta: Array) -> tuple[Array, Array]:
    """Return Schlick's weights of normal and of grazing incidence, for cosines (...) in [0, 1].

    They are ``1 - (1 - cos_theta)^5`` and ``(1 - cos_theta)^5``.
    """
    # The cosine of equal directions can round to above 1, where the odd power is negative.
    m = np.maximum(1.0 - cos_theta, 0.0)
    m2 = m * m
    m4 = m2 * m2
    # The first weight, 1 - m^5, would cancel at grazing angles in float32. It is (1 - m) (1 + m + m^2 + m^3 + m^4).
    return cos_theta * ((1.0 + m) * (1.0 + m2) + m4), m4 * m


def schlick_weight(cos_theta: Array) -> Array:
    """Return Schlick's weight of grazing incidence, ``(1 - cos_theta)^5``, for cosines (...) in [0, 1]."""
    return schlick_weights(cos_theta)[1]


def schlick_blend(normal: Real, grazing: Real, cos_theta: Array) -> Array:
    """Blend numbers (...) at normal and at grazing incidence by Schlick's weights at a cosine (...)."""
    if are_equal(normal, grazing):
        return normal + 0.0 * cos_theta  # has the shape of the cosine, and needs less generated code
    at_normal, at_grazing = schlick_weights(cos_theta)
    return normal * at_normal + grazing * at_grazing


# Smits, "Useful Functions" (`lookdev.brdf.pixar`): Schlick's approximation between any two reflectances.
def fresnel_blend(normal: Array, grazing: Array, cos_theta: Array) -> Array:
    """Blend colours (..., 3) at normal and at grazing incidence by Schlick's weights at a cosine (...)."""
    return schlick_blend(normal, grazing, np.expand_dims(cos_theta, -1))


# Born and Wolf, 14.2: a + ib is the refracted wave vector along the normal, r_s = (cos - a - ib) / (cos + a + ib), and
# r_p / r_s = (cos (a + ib) - sin^2) / (cos (a + ib) + sin^2).
def conductor_fresnel(cos_theta: Real, eta: Real, k: Real, external_ior: Real = 1.0, polarisation: Real = 0.5) -> Array:
    """Return the exact reflectance (...), in [0, 1], of a conductor, or with k = 0 of a dielectric.

    cos_theta : cosine of the angle of incidence, in [0, 1].
    eta, k : real part (above 0) and imaginary part (at least 0) of the index of refraction.
    external_ior : index of refraction of the dielectric from which light arrives.
    polarisation : share of the light that is polarised parallel to the plane of incidence; 0.5 is unpolarised.

    All arguments broadcast. Above the angle of total reflection, the reflectance of a dielectric is exactly 1.
    """
    cos2 = cos_theta * cos_theta
    sin2 = np.maximum(1.0 - cos2, 0.0)
    # `excess` is the real part of the squared relative index, minus 1. `cross` is half of its imaginary part. The
    # product (eta - external_ior) (eta + external_ior) replaces a difference of squares, which would cancel for similar
    # media.
    inverse = 1.0 / (external_ior * external_ior)
    excess, cross = ((eta - external_ior) * (eta + external_ior) - k * k) * inverse, eta * k * inverse
    real = excess + cos2
    a, b = square_root(real, cross)
    is_real = real >= 0.0  # whether a >= b
    b2, plus = b * b, cos_theta + a
    # For similar media, b and cos - a are small. cos^2 - a^2 is -(excess + b^2), which does not cancel. The sign of
    # `minus` does not matter, as only its square is used.
    minus = np.where(is_real, (excess + b2) / np.maximum(plus, TINY), cos_theta - a)
    reflectance_s = (minus * minus + b2) / np.maximum(plus * plus + b2, TINY)
    p_minus, p_plus, b2_cos2 = cos_theta * a - sin2, cos_theta * a + sin2, b2 * cos2
    # The floor avoids 0 / 0 at grazing incidence between equal media without absorption.
    ratio = (p_minus * p_minus + b2_cos2) / np.maximum(p_plus * p_plus + b2_cos2, TINY)
    reflectance: Array = reflectance_s * (1.0 - polarisation + polarisation * ratio)
    return reflectance


# Born and Wolf, 1.5 (34) and 14.2: 1 minus the reflectance of each polarisation. `perpendicular` is 1 - |r_s|^2, and
# `one_minus_ratio` is 1 - |r_p / r_s|^2, with r_s and r_p / r_s as above.
def conductor_absorptance(cos_theta: Real, eta: Real, k: Real) -> Array:
    """Return ``1 - conductor_fresnel(cos_theta, eta, k)`` in air for unpolarised light, without cancellation."""
    cos2 = cos_theta * cos_theta
    sin2 = np.maximum(1.0 - cos2, 0.0)
    a, b = square_root((eta - 1.0) * (eta + 1.0) - k * k + cos2, eta * k)
    b2, plus, p_plus = b * b, cos_theta + a, cos_theta * a + sin2
    perpendicular = 4.0 * cos_theta * a / np.maximum(plus * plus + b2, TINY)
    one_minus_ratio = 4.0 * cos_theta * a * sin2 / np.maximum(p_plus * p_plus + b2 * cos2, TINY)
    absorptance: Array = perpendicular + 0.5 * (1.0 - perpendicular) * one_minus_ratio
    return absorptance


def square_root(real: Real, half: Real) -> tuple[Array, Array]:
    """Return a and b of ``a + ib``, the square root of ``real + 2i half``; `half`, `a` and `b` are at least 0."""
    # a^2 - b^2 = real and a b = half. The larger of a and b is computed first, and the smaller one as a quotient, as a
    # difference would cancel. `is_real` is whether the real part a is the larger one.
    large = np.sqrt(0.5 * (np.sqrt(real * real + 4.0 * half * half) + np.absolute(real)))
    small = half / np.maximum(large, TINY)
    is_real = real >= 0.0
    return np.where(is_real, large, small), np.where(is_real, small, large)
