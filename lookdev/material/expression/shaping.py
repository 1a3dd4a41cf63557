"""The functions and operators of the expression language: arithmetic, and the shaping functions of SeExpr.

`FUNCTIONS` and `OPERATORS` list them. They are plain functions over arrays that broadcast. They call only those NumPy
functions that `lookdev.brdf` uses too: these also accept the symbolic arrays of code generation.

For finite arguments within `MAX_MAGNITUDE`, every result is finite. Where SeExpr leaves a value undefined, the
docstring states the value here. A function of a colour takes a tuple of three arrays; others work on one channel at a
time.

- SeExpr 2, Disney Enterprises: user documentation, and the formulas of its built-in functions.
- Perlin, K. 2002. Improving Noise. SIGGRAPH.
- McEwan, I., Sheets, D., Gustavson, S., Richardson, M. 2012. Efficient Computational Noise in GLSL. JGT 16(2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import e, log2, pi
from typing import Literal

import numpy as np

from lookdev.arrays import MAX_MAGNITUDE
from lookdev.brdf.vectors import TINY, Array, BooleanArray, Real

_LUMINANCE = (0.2126, 0.7152, 0.0722)  # the weights of r, g, b in Rec.709, as in SeExpr
_PERIOD = 289.0  # of noise, in lattice points: 17^2, as in McEwan et al. 2012


@dataclass(frozen=True)
class LanguageFunction:
    """A function or operator of the language.

    evaluate
        Computes the result from the arguments.
    parameters
        The names of the parameters.
    optional
        The number of parameters that may be omitted; these are the last ones.
    domain
        The type of the arguments. ``"each"``: floats and colours, where `evaluate` gets one channel at a time.
        ``"float"``: floats only. ``"color"``: a colour, as a tuple of three arrays, then floats. ``"truth"``: truth
        values.
    result
        The type of the result; None if it is the type of the arguments.
    """

    evaluate: Callable[..., Array | BooleanArray | tuple[Array, ...]]
    parameters: tuple[str, ...]
    optional: int = 0
    domain: Literal["each", "float", "color", "truth"] = "each"
    result: Literal["float", "color", "truth"] | None = None

    def signature(self, name: str) -> str:
        """Return the text of a call, with optional parameters in brackets."""
        required = len(self.parameters) - self.optional
        rest = "".join(f"[, {parameter}]" for parameter in self.parameters[required:])
        return f"{name}({', '.join(self.parameters[:required])}{rest})"


def clip_to_bound(x: Array) -> Array:
    """Clip numbers to the range from -`MAX_MAGNITUDE` to `MAX_MAGNITUDE`; NaN becomes 0."""
    return np.where(x > 0.0, np.minimum(x, MAX_MAGNITUDE), np.where(x < 0.0, np.maximum(x, -MAX_MAGNITUDE), 0.0))


def divide(x: Real, y: Array) -> Array:
    """Return x / y; 0 where the magnitude of y is below TINY."""
    zero = np.absolute(y) < TINY
    return np.where(zero, 0.0, x / np.where(zero, 1.0, y))


def modulo(x: Array, y: Real) -> Array:
    """Return x - y floor(x / y), which has the sign of y; 0 where the magnitude of y is below TINY.

    SeExpr's operator % is the same function, but its fmod is another.
    """
    zero = np.absolute(y) < TINY
    y = np.where(zero, 1.0, y)
    return np.where(zero, 0.0, x - y * np.floor(x / y))


def power(x: Array, y: Array) -> Array:
    """Return x to the power y; 0 where no real value exists (x < 0 and y not whole, or x = 0 and y < 0)."""
    # `size` is the magnitude of the power. `sign` is the sign of the power of a negative x: -1 for odd y, 1 for even y,
    # and 0 where y is not whole.
    zero = np.equal(x, 0.0)
    size = np.where(zero, np.where(np.equal(y, 0.0), 1.0, 0.0), np.power(np.where(zero, 1.0, np.absolute(x)), y))
    whole = np.floor(y)
    sign = np.where(np.equal(y, whole), 1.0 - 2.0 * modulo(whole, 2.0), 0.0)
    signed: Array = size * np.where(x < 0.0, sign, 1.0)
    return signed


def square_root(x: Array) -> Array:
    """Return the square root; 0 of a negative number."""
    root: Array = np.sqrt(np.maximum(x, 0.0))
    return root


def logarithm(x: Array) -> Array:
    """Return the natural logarithm of x; log(TINY), -41.4, where x is below TINY."""
    log: Array = np.log(np.maximum(x, TINY))
    return log


def ceiling(x: Array) -> Array:
    """Return the smallest integer that is not below x."""
    return -np.floor(-x)


def truncate(x: Array) -> Array:
    """Return the nearest integer towards zero."""
    return np.where(x < 0.0, ceiling(x), np.floor(x))


def round_half_away(x: Array) -> Array:
    """Return the nearest integer; halves are rounded away from zero."""
    return np.where(x < 0.0, ceiling(x - 0.5), np.floor(x + 0.5))


def mix(a: Array, b: Array, alpha: Array) -> Array:
    """Blend linearly from a (alpha 0) to b (alpha 1)."""
    # In this form, generated code omits one of the two terms for a constant alpha of 0 or 1.
    return a * (1.0 - alpha) + b * alpha


def boxstep(x: Array, a: Array) -> Array:
    """Return 0 for x < a, else 1."""
    return np.where(x < a, 0.0, 1.0)


def linearstep(x: Array, a: Array, b: Array) -> Array:
    """Return a linear ramp in x from 0 at a to 1 at b, constant beyond. Where a = b, it is `boxstep`."""
    width = b - a
    is_step = np.absolute(width) < TINY
    return np.where(is_step, boxstep(x, a), np.clip((x - a) / np.where(is_step, 1.0, width), 0.0, 1.0))


def _smooth(t: Array) -> Array:
    """Return a cubic curve that rises from 0 at t = 0 to 1 at t = 1, with slope 0 at both ends."""
    return t * t * (3.0 - 2.0 * t)


def _gaussian(t: Array) -> Array:
    """Return half a Gaussian bell that rises to 1 at t = 1; 0 at t = 0."""
    # As in SeExpr, the bell begins at 2^-8, just above t = 0.
    return np.where(t > 0.0, np.exp((-8.0 / log2(e)) * (1.0 - t) * (1.0 - t)), 0.0)


def smoothstep(x: Array, a: Array, b: Array) -> Array:
    """Return `linearstep`, smoothed by a cubic curve."""
    return _smooth(linearstep(x, a, b))


def gaussstep(x: Array, a: Array, b: Array) -> Array:
    """Return `linearstep`, shaped by half a Gaussian bell; 0 at x = a."""
    return _gaussian(linearstep(x, a, b))


def remap(x: Array, source: Array, span: Array, falloff: Array, interp: Array) -> Array:
    """Return 1 where x is within `span` of `source`; beyond, the value falls to 0 over the distance `falloff`.

    `interp` is the shape of the fall: 0 linear, 1 smooth, 2 gaussian.
    """
    span, falloff, distance = np.absolute(span), np.absolute(falloff), np.absolute(x - source)
    is_step = falloff < TINY
    t = np.clip((span + falloff - distance) / np.where(is_step, 1.0, falloff), 0.0, 1.0)
    shaped = np.where(interp < 1.0, t, np.where(interp < 2.0, _smooth(t), _gaussian(t)))
    return np.where(is_step, np.where(distance < span, 1.0, 0.0), shaped)


def fit(x: Array, a1: Array, b1: Array, a2: Array, b2: Array) -> Array:
    """Map x linearly so that a1 becomes a2 and b1 becomes b2, also beyond these ends; a2 where a1 = b1."""
    return a2 + divide((x - a1) * (b2 - a2), b1 - a1)


def gamma(x: Array, g: Array) -> Array:
    """Return x^(1/g)."""
    return power(x, divide(1.0, g))


def bias(x: Array, b: Array) -> Array:
    """Return x^(log(b) / log(0.5)) (Perlin): the curve is raised for b > 0.5 and lowered for b < 0.5."""
    return power(x, logarithm(b) * (-1.0 / np.log(2.0)))


def contrast(x: Array, c: Array) -> Array:
    """Return x with higher contrast for c > 0.5, lower for c < 0.5 (Perlin's gain); 0 or 1 for x outside [0, 1].

    SeExpr computes bias(1 - c, 2 x). Here the arguments are exchanged, with the same result: a^log(b) = b^log(a). In
    this form, the lower bound in `logarithm` affects only c.
    """
    low = x < 0.5
    half = 0.5 * bias(np.where(low, 2.0 * x, 2.0 - 2.0 * x), 1.0 - c)
    return np.where(low, half, 1.0 - half)


def luminance(color: tuple[Array, ...]) -> Array:
    """Return the Rec.709 luminance of a linear colour."""
    r, g, b = (channel * weight for channel, weight in zip(color, _LUMINANCE, strict=True))
    return r + g + b


def saturate(color: tuple[Array, ...], amount: Array) -> tuple[Array, ...]:
    """Scale the distance of each channel from the luminance by `amount`; negative results become 0."""
    gray = luminance(color)
    return tuple(np.maximum(mix(gray, channel, amount), 0.0) for channel in color)


def _wrap_index(i: Array, period: float = _PERIOD) -> Array:
    """Return whole numbers modulo a period, exact in float32 for i below 3e6."""
    # (i + 0.5) / period is at least 0.5 / period away from any integer, so a smaller error does not change the floor.
    # For i below 3e6, the error of the quotient in float32 is at most 1 / 900, and 0.5 / 289 is 1 / 578.
    return i - period * np.floor((i + 0.5) * (1.0 / period))


def _permute(i: Array) -> Array:
    """Return a permutation of the whole numbers from 0 to 288, as a hash."""
    # McEwan et al. 2012, section 2.2, with the linear coefficient of the authors' later code. The authors pass a sum of
    # two hashes, for which the modulo would be inexact in float32. Here i is at most 289, so the product is below
    # 2.9e6, and its modulo is exact.
    return _wrap_index((34.0 * i + 10.0) * i)


def _hash(i: Array, j: Array, k: Array) -> Array:
    """Return a whole number from 0 to 288 for the lattice point (i, j, k), whose indices are in this range or 289."""
    return _permute(_wrap_index(_permute(_wrap_index(_permute(i) + j)) + k))


def _gradient_product(number: Array, x: Array, y: Array, z: Array) -> Array:
    """Return the dot product of a lattice point's gradient and the vector (x, y, z) from the point.

    The hash `number` of the point selects the gradient.
    """
    # Perlin 2002: the gradients point to the twelve edges of a cube. Perlin has four of them twice, which favours one
    # axis; here each occurs once. A gradient has two components that are not 0: `edge` / 4 selects their axes, and the
    # two lowest bits of `edge` are their signs.
    edge = _wrap_index(number, 12.0)
    u, v = np.where(edge < 8.0, x, y), np.where(edge < 4.0, y, z)
    half = np.floor(0.5 * edge)
    return u * (1.0 - 2.0 * (edge - 2.0 * half)) + v * (1.0 - 2.0 * modulo(half, 2.0))


def _lattice(x: Real) -> tuple[Array, Array, Array]:
    """Return, for one axis, the index of the lattice point below x, x minus this point, and the next point's weight.

    The index is modulo the period. The weight is Perlin's polynomial of degree five in x minus the point.
    """
    floor = np.floor(x)
    t = x - floor
    return _wrap_index(floor), t, t * t * t * (t * (6.0 * t - 15.0) + 10.0)


def noise(x: Array, y: Real = 0.0, z: Real = 0.0) -> Array:
    """Return Perlin's gradient noise in [0, 1], with mean 0.5 and period 289. At lattice points it is 0.5.

    The hashes are whole numbers below 2^24, and therefore equal in float32 and float64. An omitted coordinate is the
    constant 0, on the lattice. For this coordinate, generated code omits the terms of the next lattice point.
    """
    # Along the three axes: `i`, `j`, `k` are indices of the lattice point, `u`, `v`, `w` weights of the next point. In
    # the functions below, `a`, `b`, `c` are 0 for this point and 1 for the next one.
    (i, x, u), (j, y, v), (k, z, w) = (_lattice(value) for value in (np.asarray(0.0) + x, y, z))

    def corner(a: int, b: int, c: int) -> Array:
        return _gradient_product(_hash(i + a, j + b, k + c), x - a, y - b, z - c)

    def edge(b: int, c: int) -> Array:
        return mix(corner(0, b, c), corner(1, b, c), u)

    def face(c: int) -> Array:
        return mix(edge(0, c), edge(1, c), v)

    return np.clip(0.5 + 0.5 * mix(face(0), face(1), w), 0.0, 1.0)


def cellnoise(x: Array, y: Real = 0.0, z: Real = 0.0) -> Array:
    """Return a random value, constant in each cell of the lattice: one of 289 values from 0 to 1, with period 289."""
    i, j, k = (_wrap_index(np.floor(value)) for value in (x, y, z))
    return _hash(i, j, k) * (1.0 / (_PERIOD - 1.0))


CONSTANTS: dict[str, float] = {"PI": pi, "E": e, "linear": 0.0, "smooth": 1.0, "gaussian": 2.0}
"""The named constants of the language; the last three are for `interp` of `remap`. Inputs cannot have these names."""

FUNCTIONS: dict[str, LanguageFunction] = {
    "abs": LanguageFunction(np.absolute, ("x",)),
    "atan2": LanguageFunction(np.arctan2, ("y", "x")),
    "bias": LanguageFunction(bias, ("x", "b")),
    "boxstep": LanguageFunction(boxstep, ("x", "a")),
    "ceil": LanguageFunction(ceiling, ("x",)),
    "cellnoise": LanguageFunction(cellnoise, ("x", "y", "z"), optional=2, domain="float"),
    "clamp": LanguageFunction(lambda x, lo, hi: np.minimum(np.maximum(x, lo), hi), ("x", "lo", "hi")),
    "contrast": LanguageFunction(contrast, ("x", "c")),
    "cos": LanguageFunction(np.cos, ("x",)),
    "exp": LanguageFunction(np.exp, ("x",)),
    "fit": LanguageFunction(fit, ("x", "a1", "b1", "a2", "b2")),
    "floor": LanguageFunction(np.floor, ("x",)),
    "fract": LanguageFunction(lambda x: x - np.floor(x), ("x",)),
    "gamma": LanguageFunction(gamma, ("x", "g")),
    "gaussstep": LanguageFunction(gaussstep, ("x", "a", "b")),
    "invert": LanguageFunction(lambda x: 1.0 - x, ("x",)),
    "lerp": LanguageFunction(mix, ("a", "b", "alpha")),
    "linearstep": LanguageFunction(linearstep, ("x", "a", "b")),
    "log": LanguageFunction(logarithm, ("x",)),
    "luminance": LanguageFunction(luminance, ("color",), domain="color", result="float"),
    "max": LanguageFunction(np.maximum, ("a", "b")),
    "min": LanguageFunction(np.minimum, ("a", "b")),
    "mix": LanguageFunction(mix, ("a", "b", "alpha")),
    "mod": LanguageFunction(modulo, ("x", "y")),
    "noise": LanguageFunction(noise, ("x", "y", "z"), optional=2, domain="float"),
    "pow": LanguageFunction(power, ("x", "y")),
    "remap": LanguageFunction(remap, ("x", "source", "range", "falloff", "interp")),
    "round": LanguageFunction(round_half_away, ("x",)),
    "saturate": LanguageFunction(saturate, ("color", "amount"), domain="color", result="color"),
    "sin": LanguageFunction(np.sin, ("x",)),
    "smoothstep": LanguageFunction(smoothstep, ("x", "a", "b")),
    "sqrt": LanguageFunction(square_root, ("x",)),
    "tan": LanguageFunction(np.tan, ("x",)),
    "trunc": LanguageFunction(truncate, ("x",)),
}
"""The functions of the language by name."""

_PAIR = ("a", "b")

OPERATORS: dict[str, LanguageFunction] = {
    "+": LanguageFunction(np.add, _PAIR),
    "-": LanguageFunction(np.subtract, _PAIR),
    "*": LanguageFunction(np.multiply, _PAIR),
    "/": LanguageFunction(divide, _PAIR),
    "%": LanguageFunction(modulo, _PAIR),
    "^": LanguageFunction(power, _PAIR),
    "negative": LanguageFunction(np.negative, ("a",)),
    "<": LanguageFunction(np.less, _PAIR, domain="float", result="truth"),
    "<=": LanguageFunction(np.less_equal, _PAIR, domain="float", result="truth"),
    ">": LanguageFunction(np.greater, _PAIR, domain="float", result="truth"),
    ">=": LanguageFunction(np.greater_equal, _PAIR, domain="float", result="truth"),
    "==": LanguageFunction(np.equal, _PAIR, domain="float", result="truth"),
    "!=": LanguageFunction(lambda a, b: np.logical_not(np.equal(a, b)), _PAIR, domain="float", result="truth"),
    "&&": LanguageFunction(np.logical_and, _PAIR, domain="truth", result="truth"),
    "||": LanguageFunction(np.logical_or, _PAIR, domain="truth", result="truth"),
    "!": LanguageFunction(np.logical_not, ("a",), domain="truth", result="truth"),
}
"""The operators of the language by their sign; ``"negative"`` is the sign - before an operand."""
