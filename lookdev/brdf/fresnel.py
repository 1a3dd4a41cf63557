"""Schlick's approximation of Fresnel reflectance."""

from __future__ import annotations

import numpy as np

from lookdev.brdf.vectors import Array, Real, same


# Schlick 1994, eq. 15, the weights of normal and of grazing incidence.
def schlick_weights(cos_theta: Array) -> tuple[Array, Array]:
    """Return ``1 - (1 - cos_theta)^5`` and ``(1 - cos_theta)^5`` for cosines in [0, 1]."""
    # The cosine of equal directions can round to above 1, where the odd power is negative.
    m = np.maximum(1.0 - cos_theta, 0.0)
    m2 = m * m
    m4 = m2 * m2
    # The first is a geometric sum: 1 - m^5 cancels at grazing angles in float32.
    return cos_theta * ((1.0 + m) * (1.0 + m2) + m4), m4 * m


def schlick_weight(cos_theta: Array) -> Array:
    """Return ``(1 - cos_theta)^5`` for cosines in [0, 1]."""
    return schlick_weights(cos_theta)[1]


def schlick_blend(normal: Real, grazing: Real, cos_theta: Array) -> Array:
    """Blend numbers (...) from normal to grazing incidence by a cosine (...)."""
    if same(normal, grazing):
        return normal + 0.0 * cos_theta  # of the cosine's shape, in less generated code
    at_normal, at_grazing = schlick_weights(cos_theta)
    return normal * at_normal + grazing * at_grazing


# Smits, "Useful Functions": Schlick's approximation between any two reflectances.
def fresnel_blend(normal: Array, grazing: Array, cos_theta: Array) -> Array:
    """Blend colours (..., 3) from normal to grazing incidence by a cosine (...)."""
    return schlick_blend(normal, grazing, np.expand_dims(cos_theta, -1))
