"""Special functions for the classic models, in plain arithmetic: code generation can trace them.

They are also precise in float32. OSL's own logarithm near 1, exponential near 0 and arc cosine have errors of 1e-7 or
more. NumPy lacks the complementary error function. Coefficients were fitted at Chebyshev nodes.
"""

from __future__ import annotations

import math

import numpy as np

from lookdev.brdf.rational import Rational, polynomial
from lookdev.brdf.vectors import TINY, Array, Real

# The coefficients of ln(1 + x) = 2 z (1 + z^2 / 3 + z^4 / 5 + ...), z = x / (2 + x), whose error is 1e-16 for
# |x| < _NEAR.
_LOG1P_SERIES = tuple((1.0 / (2 * k + 1),) for k in range(6))
_NEAR = 0.1

# The coefficients of expm1(x) / x = 1 + x / 2 + x^2 / 6 + ..., whose error is 1e-15 for |x| < _NEAR.
_EXPM1_SERIES = tuple((1.0 / math.factorial(k + 1),) for k in range(9))

# The polynomial in t = 1 / (1 + 0.4 x) for exp(x^2) erfc(x), whose error is 4.9e-12 for x in [0, 6].
_ERFCX = (
    (-8.386678567285e-06,), (0.2258588664417,), (0.2239178022431,), (0.2172914787798,), (0.1387054318229,),
    (0.1879923733884,), (0.01180884504786,), (-0.07245904919875,), (0.3406701482286,), (-0.5455088144453,),
    (0.3865181113334,), (-0.1334344069796,), (0.01864760002123,),
)  # fmt: skip

# The squared angle over twice its versine v = 1 - cos, as a function of v. The relative error is 2.9e-12 for v in
# [0, 1].
_ANGLE = Rational(
    ((1.000000000001,), (-0.9546440810042,), (0.284631162825,), (-0.02682066977133,), (0.0003106335685443,)),
    ((1.0,), (-1.121310747531,), (0.4270718401817,), (-0.06244896949248,), (0.002677104605665,)),
)


def log1p_ratio(x: Real, one_plus_x: Real) -> Array:
    """Return ``ln(1 + x) / x`` for x above -1; the result is 1 at 0.

    `one_plus_x` is 1 + x, which the caller may know more precisely than the sum.
    """
    is_near = np.absolute(x) < _NEAR
    small = np.where(is_near, x, 0.0)
    z = small / (2.0 + small)
    series = polynomial(_LOG1P_SERIES, z * z, 0.0) * 2.0 / (2.0 + small)
    # The floor is for x = -1. Its inverse is a normal float32.
    far = np.log(np.maximum(one_plus_x, TINY * TINY)) / np.where(is_near, 1.0, x)
    return np.where(is_near, series, far)


def expm1_ratio(x: Real) -> Array:
    """Return ``expm1(x) / x``, which is 1 at 0."""
    is_near = np.absolute(x) < _NEAR
    divisor = np.where(is_near, 1.0, x)
    return np.where(is_near, polynomial(_EXPM1_SERIES, np.where(is_near, x, 0.0), 0.0), np.expm1(divisor) / divisor)


def cosine_power(cosine: Array, versine: Real, exponent: Real) -> Array:
    """Return ``cosine^exponent``, or 0 where the cosine is not positive.

    `versine` is 1 - cosine, and is more precise than the cosine near 1. With an exponent of 1e5, the cosine alone would
    leave two correct digits in float32.
    """
    power = np.exp(-exponent * versine * log1p_ratio(-versine, cosine))
    return np.where(cosine > 0.0, power, 0.0)


def squared_angle(versine: Array) -> Array:
    """Return the square of the angle, in [0, pi / 2] radians, whose cosine is 1 - `versine`."""
    return 2.0 * versine * _ANGLE(versine)


def scaled_erfc(x: Array) -> Real:
    """Return ``exp(x^2) erfc(x)`` for x in [0, 6]."""
    return polynomial(_ERFCX, 1.0 / (1.0 + 0.4 * x), 0.0)
