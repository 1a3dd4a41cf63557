"""Thin films against quadrature over wavelengths, and in limits that are known."""

from __future__ import annotations

import numpy as np
import pytest
from film_reference import WAVELENGTHS, color_weights, film_by_quadrature
from numpy.typing import NDArray

from lookdev.brdf import MODELS, complete_parameters, evaluate, film
from lookdev.brdf.film import film_reflectance
from lookdev.brdf.fresnel import schlick_weight

Floats = NDArray[np.float64]

_COUNT = 4000


def _cases() -> tuple[Floats, Floats, Floats, Floats]:
    rng = np.random.default_rng(7)
    gray = np.repeat(rng.uniform(0.02, 0.1, (_COUNT, 1)), 3, axis=1)
    f0 = np.where(rng.random((_COUNT, 1)) < 0.5, gray, rng.random((_COUNT, 3)))
    cos_theta = rng.uniform(0.02, 1.0, _COUNT)
    bare = f0 + (1.0 - f0) * schlick_weight(cos_theta)[:, None]
    thickness = rng.uniform(0.0, 1.0, _COUNT) * rng.choice([200.0, 1000.0, 3000.0], _COUNT)
    return bare, cos_theta, thickness, rng.uniform(1.0, 3.0, _COUNT)


def test_a_film_is_what_quadrature_gives() -> None:
    bare, cos_theta, thickness, ior = _cases()
    wanted = film_by_quadrature(bare, cos_theta, thickness, ior)
    error = np.abs(film_reflectance(bare, cos_theta, thickness, ior) - np.clip(wanted, 0.0, 1.0))
    # docs/models.md has the numbers.
    assert np.sqrt(np.mean(error**2)) < 5e-4
    assert error.max() < 0.015
    assert error[cos_theta > np.cos(np.radians(80.0))].max() < 6e-3
    # Iridescence is far more than that.
    assert np.abs(wanted - bare).max() > 0.5


def test_the_table_is_the_fit_that_it_is_said_to_be() -> None:
    path = np.arange(0.0, 16000.0, 20.0)
    wanted = np.cos(2.0 * np.pi * path[:, None] / WAVELENGTHS) @ color_weights().T
    decay = np.exp(-2.0 * (np.pi * film._WIDTH * path) ** 2)
    basis = decay[:, None] * np.cos(2.0 * np.pi * path[:, None] * film._CENTRES)
    free = basis[:, :-1] - basis[:, -1:]
    fitted = np.linalg.lstsq(free, wanted - basis[:, -1:], rcond=None)[0]
    np.testing.assert_allclose(film._WEIGHTS[:-1], fitted, atol=5e-4)
    np.testing.assert_allclose(film._WEIGHTS.sum(axis=0), 1.0, atol=1e-12)
    np.testing.assert_allclose(basis @ film._WEIGHTS, wanted, atol=0.013)


@pytest.mark.parametrize("thickness", [0.0, 1.0, 300.0, 3000.0])
def test_a_film_of_the_index_of_air_is_none(thickness: float) -> None:
    bare, cos_theta, _, _ = _cases()
    np.testing.assert_allclose(film_reflectance(bare, cos_theta, thickness, 1.0), bare, rtol=1e-12)


def test_a_film_without_thickness_is_none_but_for_the_end_of_the_series() -> None:
    bare, cos_theta, _, ior = _cases()
    found = film_reflectance(bare, cos_theta, 0.0, ior)
    np.testing.assert_allclose(found, bare, atol=0.02)
    np.testing.assert_allclose(found[cos_theta > 0.2], bare[cos_theta > 0.2], atol=6e-3)


def test_a_quarter_wave_of_the_mean_index_reflects_no_green() -> None:
    # Glass of index 1.5 under a film of index sqrt(1.5), a quarter of 550 nm thick.
    ior = np.sqrt(1.5)
    coated = film_reflectance(np.full(3, 0.04), np.array(1.0), 550.0 / 4.0 / ior, ior)
    assert coated[1] < 1e-3
    assert coated.min() < coated.max() < 0.02


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_no_input_gives_what_is_no_reflectance(dtype: type) -> None:
    cosines, bares = [0.0, 1e-18, 1e-9, 1e-4, 0.3, 1.0], [0.0, 1e-12, 0.04, 1.0, 1.5]
    grid = np.meshgrid(cosines, bares, [0.0, 1e-6, 500.0, 3000.0], [1.0, 1.0 + 1e-7, 3.0])
    cos_theta, bare, thickness, ior = (axis.ravel().astype(dtype) for axis in grid)
    found = film_reflectance(np.repeat(bare[:, None], 3, axis=1), cos_theta, thickness, ior)
    assert ((found >= 0.0) & (found <= 1.0)).all()
    np.testing.assert_array_equal(found[bare >= 1.0], 1.0)


def test_disneys_specular_lobe_has_the_colours_of_a_film() -> None:
    wi = np.array([0.6, 0.0, 0.8])
    wo = wi * [-1.0, 1.0, 1.0]

    def lobe(**given: float) -> Floats:
        return evaluate(MODELS["disney"].bsdf(complete_parameters("disney", {"baseColor": (0, 0, 0)} | given)), wo, wi)

    # At the mirror direction the half vector is the normal.
    bare = np.full(3, 0.04 + 0.96 * schlick_weight(np.array(0.8)))
    films = {"filmThickness": 450.0, "filmIor": 1.6}
    wanted = film_reflectance(bare, np.array(0.8), *films.values())
    np.testing.assert_allclose(lobe(**films) / lobe(), wanted / bare, rtol=1e-12)
    assert np.ptp(wanted) > 0.03
