"""Fresnel terms."""

from __future__ import annotations

from lookdev.brdf.vectors import Array


# Schlick 1994, eq. 15, the weight between normal and grazing incidence.
def schlick_weight(cos_theta: Array) -> Array:
    """Return ``(1 - cos_theta)^5`` for cosines in [0, 1]."""
    m = 1.0 - cos_theta
    m2 = m * m
    return m2 * m2 * m
