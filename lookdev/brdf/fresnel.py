"""Fresnel terms."""

from __future__ import annotations

import numpy as np

from lookdev.brdf.vectors import Array, mix_color


# Schlick 1994, eq. 15, the weight between normal and grazing incidence.
def schlick_weight(cos_theta: Array) -> Array:
    """Return ``(1 - cos_theta)^5`` for cosines in [0, 1]."""
    # The cosine of equal directions can round to above 1; the odd power would turn negative.
    m = np.maximum(1.0 - cos_theta, 0.0)
    m2 = m * m
    return m2 * m2 * m


# Smits, "Useful Functions": Schlick's approximation between any two reflectances.
def fresnel_blend(normal: Array, grazing: Array, cos_theta: Array) -> Array:
    """Blend colours (..., 3) from normal to grazing incidence by a cosine (...)."""
    return mix_color(normal, grazing, schlick_weight(cos_theta))
