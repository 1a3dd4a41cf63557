"""Special functions, small rationals, vectors, tables and quadratures, against NumPy's, SciPy's and closed forms."""

import numpy as np
import pytest
from scipy.special import erfcx

from lookdev.brdf import microfacet as mf
from lookdev.brdf.quadrature import half_vector_grid, hemisphere_grid
from lookdev.brdf.rational import Rational
from lookdev.brdf.special import cosine_power, expm1_ratio, log1p_ratio, scaled_erfc, squared_angle
from lookdev.brdf.table import NumberTable, look_up
from lookdev.brdf.vectors import cross, mean, perpendicular, reflect
from lookdev.closures.setups import view_at

# Numbers of both signs: small ones, where the functions are 1, and some beyond the range of the series.
X = np.concatenate([sign * np.logspace(-12.0, -0.01, 200) for sign in (-1.0, 1.0)])


def test_logarithm_and_exponential_near_their_zeros() -> None:
    for ratio in (log1p_ratio(X, 1.0 + X), log1p_ratio(X, 1.0 + np.where(np.abs(X) < 0.1, 9.0, X)), mf._log1p_ratio(X)):
        # The sum 1 + x loses digits beyond the series.
        np.testing.assert_allclose(ratio, np.log1p(X) / X, rtol=1e-11)
    for x in (X, 30.0 * X):
        np.testing.assert_allclose((expm1_ratio(x), mf._expm1_ratio(x)), (np.expm1(x) / x,) * 2, rtol=1e-12)
    assert (log1p_ratio(0.0, 1.0), expm1_ratio(0.0), mf._expm1_ratio(0.0), mf._log1p_ratio(0.0)) == (1.0, 1.0, 1.0, 1.0)


def test_powers_and_angles_by_the_versine() -> None:
    angle = np.concatenate([np.logspace(-8.0, -1.0, 50), np.linspace(0.1, 0.5 * np.pi, 50)])
    versine = 2.0 * np.sin(0.5 * angle) ** 2
    np.testing.assert_allclose(squared_angle(versine), angle**2, rtol=1e-11)
    for exponent in (0.0, 0.5, 1.0, 30.0, 1e5):
        expected = np.exp(exponent * np.log1p(-versine))
        np.testing.assert_allclose(cosine_power(1.0 - versine, versine, exponent), expected, rtol=1e-9, atol=1e-300)
        assert cosine_power(np.array([0.0, -0.5]), np.array([1.0, 1.5]), exponent).tolist() == [0.0, 0.0]
    x = np.linspace(0.0, 6.0, 200)
    np.testing.assert_allclose(scaled_erfc(x), erfcx(x), atol=5e-12)


def test_a_rational_has_rows_by_powers_of_x() -> None:
    # (1 + 2 y + x (3 + 4 y)) / (5 + 6 x^2) at x = 2, y = 3.
    rational = Rational(((1.0, 2.0), (3.0, 4.0)), ((5.0,), (0.0,), (6.0,)))
    assert rational(2.0, 3.0) == pytest.approx((7.0 + 2.0 * 15.0) / 29.0, rel=1e-15)


def test_vectors() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 100, 3))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), rtol=1e-12)
    np.testing.assert_allclose(mean(a), a.mean(axis=-1), rtol=1e-12)
    n = np.concatenate([a / np.linalg.norm(a, axis=-1, keepdims=True), [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
    across = perpendicular(n)
    np.testing.assert_allclose([(across * n).sum(axis=-1), (across**2).sum(axis=-1) - 1.0], 0.0, atol=1e-14)
    # A mirrored vector has the same component along the normal, and the opposite component across it.
    mirrored, along = reflect(b, n[:100]), (b * n[:100]).sum(axis=-1, keepdims=True) * n[:100]
    np.testing.assert_allclose(mirrored - along, along - b, atol=1e-12)


def test_a_table_is_looked_up_by_rows_and_columns_and_named_by_its_numbers() -> None:
    table = NumberTable(np.arange(12.0).reshape(3, 4))
    assert look_up(table, np.array([0.0, 2.0]), np.array([3.0, 1.0])).tolist() == [3.0, 9.0]
    others = (NumberTable(np.arange(12.0).reshape(4, 3)), NumberTable(np.arange(1.0, 13.0).reshape(3, 4)))
    assert len({str(table), *(str(other) for other in others)}) == 3
    assert str(table) == table.digest == NumberTable(np.arange(12.0).reshape(3, 4)).digest


@pytest.mark.parametrize("degrees", [0.0, 50.0, 85.0])
def test_quadratures_have_the_integrals_of_polynomials(degrees: float) -> None:
    by_half, (wi, weight) = half_vector_grid(view_at(degrees, 20.0), 0.3, (96, 96)), hemisphere_grid(12)
    # Of the cosine, of its square, and of it times x^2 and x y: pi, 2 pi / 3, pi / 4, 0.
    expected = np.array([np.pi, 2.0 * np.pi / 3.0, 0.25 * np.pi, 0.0])
    for (x, y, z), weights, tolerance in ((wi.T, weight, 1e-12), (by_half[0].T, by_half[1], 2e-3)):
        moments = np.stack([z, z * z, z * x * x, z * x * y]) * weights
        np.testing.assert_allclose(moments.sum(axis=-1), expected, atol=tolerance)
