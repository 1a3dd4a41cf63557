"""Frames of lobes that have a normal of their own, inside the frame of the shading normal.

- Duff, T. et al. 2017. Building an Orthonormal Basis, Revisited. JCGT 6(1).
"""

from __future__ import annotations

import numpy as np

from lookdev.brdf.vectors import Array, dot, normalize, same, scale

ZENITH = np.array([0.0, 0.0, 1.0])
"""The shading normal itself."""

_LOWEST = 0.01
_LEAN = 1e-4


def unit_normal(vector: Array) -> Array:
    """Normalise what a normal map says, (..., 3); an overhang, or no vector at all, is pulled up to z = 0.01."""
    normal = normalize(np.stack([vector[..., 0], vector[..., 1], np.maximum(vector[..., 2], _LOWEST)], axis=-1))
    return ZENITH if same(normal, ZENITH) else normal


def facing_viewer(normal: Array, wo: Array) -> Array:
    """Bend unit normals until ``normal . wo`` is positive: a viewer sees no surface that faces away.

    The shading normal itself, which `wo` is above, stays as it is.
    """
    if normal is ZENITH:
        return ZENITH
    lean = dot(normal, wo)
    return normalize(normal + scale(wo, np.maximum(np.minimum(wo[..., 2], _LEAN) - lean, 0.0)))


def _basis(normal: Array) -> tuple[Array, Array]:
    # Duff et al. 2017, listing 3, for z > -1: exactly the axes themselves where the normal is the zenith.
    x, y = normal[..., 0], normal[..., 1]
    a = -1.0 / (1.0 + normal[..., 2])
    xy = x * y * a
    return np.stack([1.0 + x * x * a, xy, -x], axis=-1), np.stack([xy, 1.0 + y * y * a, -y], axis=-1)


def to_local(normal: Array, w: Array) -> Array:
    """Express directions (..., 3) in a frame whose z is `normal`, a unit vector above the horizon."""
    if normal is ZENITH:
        return w
    tangent, bitangent = _basis(normal)
    return np.stack([dot(tangent, w), dot(bitangent, w), dot(normal, w)], axis=-1)


def from_local(normal: Array, w: Array) -> Array:
    """Undo `to_local`."""
    if normal is ZENITH:
        return w
    tangent, bitangent = _basis(normal)
    return scale(tangent, w[..., 0]) + scale(bitangent, w[..., 1]) + scale(normal, w[..., 2])


def mirrored(w: Array) -> Array:
    """Mirror directions (..., 3) in the plane of the surface."""
    return np.stack([w[..., 0], w[..., 1], -w[..., 2]], axis=-1)
