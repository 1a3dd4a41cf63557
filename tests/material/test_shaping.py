"""Shaping functions: SeExpr's formulas, values where those have none, and noise that float32 does not change."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from lookdev.material.expression import shaping
from lookdev.material.expression.shaping import FUNCTIONS, OPERATORS

# A dozen operations at 2^-53 each, some of which lose a digit by cancellation.
_RTOL = 1e-13


def _boxstep(x: float, a: float) -> float:
    return 0.0 if x < a else 1.0


def _ramp(x: float, a: float, b: float, curve: Callable[[float], float]) -> float:
    """Return a step with SeExpr's own branches; `curve` maps (0, 1) to (0, 1)."""
    if a < b:
        return 0.0 if x < a else 1.0 if x >= b else curve((x - a) / (b - a))
    if a > b:
        return 1.0 if x <= b else 0.0 if x > a else curve(1.0 - (x - b) / (a - b))
    return _boxstep(x, a)


def _linear(x: float, a: float, b: float) -> float:
    return _ramp(x, a, b, lambda t: t)


def _smooth(x: float, a: float, b: float) -> float:
    return _ramp(x, a, b, lambda t: t * t * (3.0 - 2.0 * t))


def _gauss(x: float, a: float, b: float) -> float:
    return _ramp(x, a, b, lambda t: 2.0 ** (-8.0 * (1.0 - t) ** 2))


def _remap(x: float, source: float, span: float, falloff: float, interp: float) -> float:
    if falloff == 0.0:
        return float(abs(x - source) < abs(span))
    side = 1.0 if x > source else -1.0
    a = source + side * abs(span)
    return (_linear, _smooth, _gauss)[min(int(interp), 2)](x, a + side * abs(falloff), a)


def _bias(x: float, b: float) -> float:
    return x ** (math.log(b) / math.log(0.5))


def _contrast(x: float, c: float) -> float:
    return 0.5 * _bias(1.0 - c, 2.0 * x) if x < 0.5 else 1.0 - 0.5 * _bias(1.0 - c, 2.0 - 2.0 * x)


def _fit(x: float, a1: float, b1: float, a2: float, b2: float) -> float:
    return (x * (b2 - a2) - a1 * b2 + b1 * a2) / (b1 - a1)


def _saturate(r: float, g: float, b: float, amount: float) -> list[float]:
    gray = 0.2126 * r + 0.7152 * g + 0.0722 * b
    return [max(gray * (1.0 - amount) + channel * amount, 0.0) for channel in (r, g, b)]


@pytest.mark.parametrize(
    ("name", "wanted", "count"),
    [
        ("bias", _bias, 2),
        ("boxstep", _boxstep, 2),
        ("contrast", _contrast, 2),
        ("fit", _fit, 5),
        ("gamma", lambda x, g: x ** (1.0 / g), 2),
        ("gaussstep", _gauss, 3),
        ("linearstep", _linear, 3),
        ("mix", lambda a, b, alpha: a * (1.0 - alpha) + b * alpha, 3),
        ("remap", lambda x, s, r, f, i: _remap(x, s, r, f, 3.0 * i), 5),
        ("smoothstep", _smooth, 3),
    ],
)
def test_formulas_are_those_of_seexpr(name: str, wanted: Callable[..., float], count: int) -> None:
    rng = np.random.default_rng(4)
    arguments = rng.uniform(0.01, 0.99, (count, 500))
    given = [*arguments[:4], 3.0 * arguments[4]] if name == "remap" else arguments
    expected = [wanted(*column) for column in arguments.T]
    # Where a difference of arguments divides, its rounding counts as much as its value is small: fit, at worst 1000.
    np.testing.assert_allclose(FUNCTIONS[name].evaluate(*given), expected, rtol=_RTOL, atol=1e-11)


def test_saturate_is_that_of_seexpr() -> None:
    rng = np.random.default_rng(5)
    r, g, b, amount = rng.uniform(0.0, 2.0, (4, 200))
    got = np.stack(shaping.saturate((r, g, b), amount), axis=-1)
    expected = [_saturate(*column) for column in np.stack([r, g, b, amount], axis=-1)]
    np.testing.assert_allclose(got, expected, rtol=_RTOL, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "arguments", "value"),
    [
        ("/", (1.0, 0.0), 0.0),
        ("%", (3.5, 0.0), 0.0),
        ("%", (-1.0, 3.0), 2.0),
        ("^", (0.0, 0.0), 1.0),
        ("^", (0.0, -1.0), 0.0),
        ("^", (-8.0, 3.0), -512.0),
        ("^", (-8.0, -2.0), 1.0 / 64.0),
        ("^", (-8.0, 0.5), 0.0),
        ("sqrt", (-1.0,), 0.0),
        ("log", (0.0,), math.log(1e-18)),
        ("log", (-5.0,), math.log(1e-18)),
        ("fit", (0.3, 1.0, 1.0, 4.0, 5.0), 4.0),
        ("linearstep", (1.0, 1.0, 1.0), 1.0),
        ("smoothstep", (0.9, 1.0, 1.0), 0.0),
        ("gaussstep", (1.0, 1.0, 2.0), 0.0),
        ("remap", (0.5, 0.5, 0.0, 0.0, 0.0), 0.0),
        ("contrast", (1.5, 0.7), 1.0),
        ("contrast", (-0.5, 0.7), 0.0),
        ("gamma", (-0.5, 2.2), 0.0),
        ("round", (-2.5,), -3.0),
        ("round", (2.5,), 3.0),
        ("trunc", (-2.5,), -2.0),
        ("ceil", (-2.5,), -2.0),
        ("fract", (-0.25,), 0.75),
    ],
)
def test_what_is_undefined_elsewhere_has_a_value(name: str, arguments: tuple[float, ...], value: float) -> None:
    function = FUNCTIONS.get(name) or OPERATORS[name]
    assert function.evaluate(*(np.array(argument) for argument in arguments)) == pytest.approx(value, rel=_RTOL)


def test_whole_numbers_wrap_exactly_in_float32() -> None:
    # The largest that a hash makes is of 289, the lattice point beyond 288; coordinates can be negative.
    largest = (34 * 289 + 10) * 289
    numbers = np.arange(-largest, largest + 1)
    for period in (289, 12):
        wrapped = shaping._wrapped(numbers.astype(np.float32), float(period))
        assert wrapped.dtype == np.float32
        np.testing.assert_array_equal(wrapped, numbers % period)


def test_every_lattice_point_of_a_line_has_a_hash_of_its_own() -> None:
    i = np.arange(289.0)
    for hashed in (shaping._hash(i, 5.0, 7.0), shaping._hash(5.0, i, 7.0), shaping._hash(5.0, 7.0, i)):
        np.testing.assert_array_equal(np.sort(hashed), i)


def _places(count: int, scale: float = 100.0) -> Any:
    return np.random.default_rng(6).uniform(-scale, scale, (3, count))


def test_noise_covers_its_range_evenly_around_the_middle() -> None:
    count = 100_000
    for dimensions in (1, 2, 3):
        values = shaping.noise(*_places(count)[:dimensions])
        deviation = values.std()
        assert 0.08 < deviation < 0.2
        # Six standard errors, were the values independent.
        assert abs(values.mean() - 0.5) < 6.0 * deviation / math.sqrt(count)
        # Along a line of one dimension, half a unit from two lattice points, it cannot go beyond a quarter.
        assert 0.0 <= values.min() < 0.26
        assert 0.74 < values.max() <= 1.0


def test_noise_of_fewer_coordinates_is_a_slice() -> None:
    x, y, _ = _places(100)
    np.testing.assert_array_equal(shaping.noise(x), shaping.noise(x, 0.0, 0.0))
    np.testing.assert_array_equal(shaping.noise(x, y), shaping.noise(x, y, 0.0))


def test_noise_is_smooth_across_the_lattice_and_periodic() -> None:
    whole = np.floor(_places(500))
    np.testing.assert_array_equal(shaping.noise(*whole), 0.5)
    x, y, z = _places(500)
    step = 1e-4
    for function in (lambda s: shaping.noise(np.floor(x) + s, y, z), lambda s: shaping.noise(x, y, np.floor(z) + s)):
        below, at, above = function(-step), function(0.0), function(step)
        # The slope is below 2; the second derivative vanishes on the lattice from both sides, up to the step itself.
        assert np.abs(at - below).max() < 2.0 * step
        assert np.abs(above - 2.0 * at + below).max() < 100.0 * step**3 + 1e-15
    np.testing.assert_allclose(shaping.noise(x + 289.0, y - 289.0, z), shaping.noise(x, y, z), atol=1e-12)


def test_noise_looks_alike_along_every_axis() -> None:
    shift = 0.5
    x, y, z = _places(50_000)
    centered = shaping.noise(x, y, z) - 0.5
    correlations = [
        np.mean(centered * (shaping.noise(x + shift * a, y + shift * b, z + shift * c) - 0.5)) / centered.var()
        for a, b, c in np.eye(3)
    ]
    # A standard error of 1 / sqrt(count) each; six of them.
    assert np.ptp(correlations) < 6.0 / math.sqrt(50_000)


def test_cellnoise_is_flat_in_a_cell_and_even_over_many() -> None:
    x, y, z = _places(50_000)
    values = shaping.cellnoise(x, y, z)
    np.testing.assert_array_equal(values, shaping.cellnoise(np.floor(x), np.floor(y) + 0.75, z))
    counts = np.histogram(values, bins=17, range=(0.0, 1.0))[0]
    # 289 values in 17 bins: every bin 1/17, with six standard deviations.
    expected = 50_000 / 17
    assert np.abs(counts - expected).max() < 6.0 * math.sqrt(expected)
