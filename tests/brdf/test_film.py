"""Thin films against quadrature over wavelengths, and in known limits."""

import numpy as np
import pytest
from film_reference import WAVELENGTHS, Floats, color_weights, film_by_quadrature, metal_film_by_quadrature

from lookdev.brdf import MODELS, complete_parameters, evaluate, film
from lookdev.brdf.conductor import METALS, metal_indices
from lookdev.brdf.film import film_reflectance, metal_film_reflectance
from lookdev.brdf.fresnel import conductor_fresnel, schlick_weight
from lookdev.brdf.metal import metal_index

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
    expected = film_by_quadrature(bare, cos_theta, thickness, ior)
    error = np.abs(film_reflectance(bare, cos_theta, thickness, ior) - np.clip(expected, 0.0, 1.0))
    # docs/models.md has the numbers.
    assert np.sqrt(np.mean(error**2)) < 5e-4
    assert error.max() < 0.015
    assert error[cos_theta > np.cos(np.radians(80.0))].max() < 6e-3
    # The effect of iridescence is far larger.
    assert np.abs(expected - bare).max() > 0.5


def test_the_table_is_the_fit_that_it_is_said_to_be() -> None:
    path = np.arange(0.0, 16000.0, 20.0)
    expected = np.cos(2.0 * np.pi * path[:, None] / WAVELENGTHS) @ color_weights().T
    decay = np.exp(-2.0 * (np.pi * film._WIDTH * path) ** 2)
    basis = decay[:, None] * np.cos(2.0 * np.pi * path[:, None] * film._CENTRES)
    free = basis[:, :-1] - basis[:, -1:]
    fitted = np.linalg.lstsq(free, expected - basis[:, -1:], rcond=None)[0]
    np.testing.assert_allclose(film._WEIGHTS[:-1], fitted, atol=5e-4)
    np.testing.assert_allclose(film._WEIGHTS.sum(axis=0), 1.0, atol=1e-12)
    np.testing.assert_allclose(basis @ film._WEIGHTS, expected, atol=0.013)


def _metals() -> tuple[Floats, Floats]:
    rng = np.random.default_rng(8)
    eta = np.exp(rng.uniform(np.log(0.05), np.log(10.0), (_COUNT, 3)))
    return eta, np.where(rng.random((_COUNT, 1)) < 0.1, 0.0, 20.0 * rng.random((_COUNT, 3)) ** 2)


def test_a_film_on_a_metal_is_what_quadrature_gives() -> None:
    (eta, k), (_, cos_theta, thickness, ior) = _metals(), _cases()
    error = np.zeros((0, 3))
    for part in np.array_split(np.arange(_COUNT), 16):
        inputs = eta[part], k[part], cos_theta[part], thickness[part], ior[part]
        reflectance, expected = metal_film_reflectance(*inputs), metal_film_by_quadrature(*inputs)
        error = np.concatenate([error, np.abs(reflectance - np.clip(expected, 0.0, 1.0))])
    # docs/models.md has the numbers.
    assert np.sqrt(np.mean(error**2)) < 1.5e-3
    assert np.quantile(error, 0.99) < 3.1e-3
    assert error.max() < 0.05
    assert error[cos_theta > np.cos(np.radians(80.0))].max() < 0.03


@pytest.mark.parametrize("name", METALS)
def test_a_film_on_a_metal_by_name_is_near_that_of_its_spectra(name: str) -> None:
    rng = np.random.default_rng(9)
    cos_theta, thickness, ior = rng.uniform(0.1, 1.0, 60), rng.uniform(50.0, 800.0, 60), rng.uniform(1.2, 2.4, 60)
    spectra = (np.asarray(spectrum)[None, None] for spectrum in metal_indices(name, WAVELENGTHS))
    expected = np.clip(metal_film_by_quadrature(*spectra, cos_theta, thickness, ior), 0.0, 1.0)
    eta, k = (np.asarray(value, dtype=np.float64) for value in metal_index(name).values())
    error = metal_film_reflectance(eta, k, cos_theta, thickness, ior) - expected
    # docs/models.md has the number.
    assert np.sqrt(np.mean(error**2)) < 0.03


def test_a_film_of_the_index_of_air_is_none_and_one_without_thickness_but_for_the_end_of_the_series() -> None:
    (eta, k), (bare, cos_theta, thickness, ior) = _metals(), _cases()
    np.testing.assert_allclose(film_reflectance(bare, cos_theta, thickness, 1.0), bare, rtol=1e-12)
    metal = np.asarray(conductor_fresnel(cos_theta[:, None], eta, k))
    coated = metal_film_reflectance(eta, k, cos_theta, thickness, 1.0)
    np.testing.assert_allclose(coated, metal, rtol=1e-12, atol=1e-14)
    for reflectance, expected, most, usual in (
        (film_reflectance(bare, cos_theta, 0.0, ior), bare, 0.02, 6e-3),
        (metal_film_reflectance(eta, k, cos_theta, 0.0, ior), metal, 0.05, 0.03),
    ):
        np.testing.assert_allclose(reflectance, expected, atol=most)
        np.testing.assert_allclose(reflectance[cos_theta > 0.2], expected[cos_theta > 0.2], atol=usual)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_no_input_gives_what_is_no_reflectance(dtype: type) -> None:
    cosines, thicknesses = [0.0, 1e-18, 1e-9, 1e-4, 0.3, 1.0], [0.0, 1e-6, 500.0, 3000.0]
    grid = np.meshgrid(cosines, [0.0, 1e-12, 0.04, 1.0, 1.5], thicknesses, [1.0, 1.0 + 1e-7, 3.0])
    cos_theta, bare, thickness, ior = (axis.ravel().astype(dtype) for axis in grid)
    reflectance = film_reflectance(np.repeat(bare[:, None], 3, axis=1), cos_theta, thickness, ior)
    assert ((reflectance >= 0.0) & (reflectance <= 1.0)).all()
    np.testing.assert_array_equal(reflectance[bare >= 1.0], 1.0)
    grid = np.meshgrid(cosines, [0.05, 1.0, 10.0], [0.0, 1e-9, 20.0], thicknesses, [1.0, 3.0])
    cos_theta, eta, k, thickness, ior = (axis.ravel().astype(dtype) for axis in grid)
    reflectance = metal_film_reflectance(eta[:, None], k[:, None], cos_theta, thickness, ior)
    assert ((reflectance >= 0.0) & (reflectance <= 1.0)).all()


def test_disneys_specular_lobe_has_the_colours_of_a_film() -> None:
    wi, cosine = np.array([0.6, 0.0, 0.8]), np.array(0.8)
    eta, k = (np.asarray(value, dtype=np.float64) for value in metal_index("gold").values())
    films = {"filmThickness": 300.0, "filmIor": 1.6}
    # In the mirror direction the half vector is the normal; the surfaces are black plastic and an exact metal.
    bare = np.full(3, 0.04 + 0.96 * schlick_weight(cosine))
    plastic = film_reflectance(bare, cosine, *films.values()) / bare
    gold = metal_film_reflectance(eta, k, cosine, *films.values()) / conductor_fresnel(0.8, eta, k)
    for inputs, expected in (({"baseColor": (0, 0, 0)}, plastic), ({"metal": "gold", "metallic": 1.0}, gold)):
        bsdfs = (MODELS["disney"].bsdf(complete_parameters("disney", inputs | film)) for film in (films, {}))
        coated, plain = (evaluate(bsdf, wi * [-1.0, 1.0, 1.0], wi) for bsdf in bsdfs)
        np.testing.assert_allclose(coated / plain, expected, rtol=1e-12)
        assert np.ptp(expected) > 0.03
