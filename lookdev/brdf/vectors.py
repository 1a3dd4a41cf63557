"""Small vector algebra over the last axis, and the array type every model works on.

Functions use only ufuncs, `where`, `stack`, `expand_dims` and sums over the last axis, so that symbolic arrays
(`lookdev.codegen`) run through the same code.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

Array: TypeAlias = Any
"""A float64 array or number, or a symbolic array standing for one."""

TINY = 1e-18
"""A floor for divisors: its square and the inverse of its square are normal numbers in float32 too."""


def scale(vector: Array, factor: Array) -> Array:
    """Multiply vectors (..., 3) by scalars (...)."""
    return vector * np.expand_dims(factor, -1)


def mix(a: Array, b: Array, t: Array) -> Array:
    """Interpolate linearly: exactly `a` at t = 0 and `b` at t = 1, however far apart they are."""
    # Not a + (b - a) t, which leaves of a small b at t near 1 what rounding leaves of a.
    return a + 0.0 * t if same(a, b) else a * (1.0 - t) + b * t


def mix_color(a: Array, b: Array, t: Array) -> Array:
    """Interpolate colours (..., 3) by scalars (...)."""
    return mix(a, b, np.expand_dims(t, -1))


def dot(a: Array, b: Array) -> Array:
    """Dot product over the last axis."""
    # Not numpy.sum, which takes three times as long over an axis of three.
    product = a * b
    return product[..., 0] + product[..., 1] + product[..., 2]


def normalize(v: Array) -> Array:
    """Scale vectors (..., 3) to unit length; the length must not be zero."""
    return scale(v, 1.0 / np.sqrt(dot(v, v)))


def reflect(w: Array, wm: Array) -> Array:
    """Mirror `w` about the unit microfacet normal `wm` (Burley 2012, appendix B.1)."""
    return scale(wm, 2.0 * dot(w, wm)) - w


def mean(color: Array) -> Array:
    """Mean of the three channels, (...)."""
    return (color[..., 0] + color[..., 1] + color[..., 2]) * (1.0 / 3.0)


def same(a: Array, b: Array) -> bool:
    """Tell whether two values are known to be equal; of symbolic ones only where their difference folds to zero."""
    difference = a - b
    return isinstance(difference, np.ndarray | np.floating | float) and not np.any(difference)
