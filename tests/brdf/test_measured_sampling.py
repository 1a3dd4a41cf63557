"""Sampling of measured data: a chi-square test against the pdf, bounded weights, and variance beside the model's own.

The pdf is a step function of half vectors; its integrals over the bins, even in cosine and azimuth of the light's
direction, are sums over a fine grid. What these leave uncertain is added to the variance expected.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_files import MODELS, known, measured, measured_file, view
from scipy import stats

from lookdev.brdf import Bsdf, evaluate_cosine, pdf, sample
from lookdev.brdf.measured.files import write_anisotropic
from lookdev.brdf.quadrature import half_vector_grid

_SAMPLES = 1 << 16
_BINS = (20, 50)
_CASES = [(name, angle) for name in MODELS for angle in (0.0, 0.3, 45.0, 80.0, 89.0)]
# Šidák: the probability that any of the tests fails by chance is 1e-3.
_SIGNIFICANCE = 1.0 - (1.0 - 1e-3) ** (1.0 / len(_CASES))


def _numbers(count: int = _SAMPLES) -> np.ndarray:
    return np.random.default_rng(20050629).random((count, 2))


def _expected(bsdf: Bsdf, wo: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how many samples each bin expects, and the error of that: the difference of two grids."""
    found = []
    for cells in ((700, 400), (520, 300)):
        light, weight = half_vector_grid(wo, 0.05, cells)
        found.append(_binned(light, _SAMPLES * weight * pdf(bsdf, np.broadcast_to(wo, light.shape), light)))
    return found[0], np.abs(found[0] - found[1])


def _binned(wi: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    row = np.minimum((wi[:, 2] * _BINS[0]).astype(int), _BINS[0] - 1)
    column = (np.arctan2(wi[:, 1], wi[:, 0]) / (2.0 * np.pi) % 1.0 * _BINS[1]).astype(int) % _BINS[1]
    return np.bincount(row * _BINS[1] + column, weights, minlength=_BINS[0] * _BINS[1])


@pytest.mark.parametrize(("name", "angle"), _CASES)
def test_samples_follow_the_density(name: str, angle: float) -> None:
    bsdf, wo = measured(measured_file(name)), view(angle)
    wi = sample(bsdf, np.broadcast_to(wo, (_SAMPLES, 3)), _numbers())
    up = wi[:, 2] > 0.0
    np.testing.assert_allclose(np.linalg.norm(wi[up], axis=-1), 1.0, rtol=1e-12)

    expected, error = _expected(bsdf, wo)
    assert p_value(_binned(wi[up]), expected, error) > _SIGNIFICANCE
    # A glossy highlight is in few bins.
    assert np.count_nonzero(expected >= 5.0) > (20 if name == "gloss" else 150)

    above = up.mean()
    noise = 4.0 * np.sqrt(above * (1.0 - above) / _SAMPLES)
    assert abs(expected.sum() / _SAMPLES - above) < noise + 1e-3


def p_value(counts: np.ndarray, expected: np.ndarray, error: np.ndarray) -> float:
    """Return the chi-square p-value of bins that expect at least five samples."""
    seen = expected >= 5.0
    statistic = ((counts - expected)[seen] ** 2 / (expected + error**2)[seen]).sum()
    return float(stats.chi2.sf(statistic, np.count_nonzero(seen)))


def test_a_wrong_density_is_found() -> None:
    bsdf, wo = measured(measured_file("metal")), view(45.0)
    counts = _binned(sample(bsdf, np.broadcast_to(wo, (_SAMPLES, 3)), _numbers()))
    assert p_value(counts, *_expected(measured(measured_file("plastic")), wo)) < 1e-12


def _weights(bsdf: Bsdf, wo: np.ndarray) -> np.ndarray:
    wos = np.broadcast_to(wo, (_SAMPLES, 3))
    wi = sample(bsdf, wos, _numbers())
    density = pdf(bsdf, wos, wi)
    value = evaluate_cosine(bsdf, wos, wi).mean(axis=-1)
    return np.where(density > 0.0, value / np.where(density > 0.0, density, 1.0), 0.0)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("angle", [0.0, 30.0, 60.0, 75.0, 85.0])
def test_sampling_costs_at_most_twice_the_variance_of_the_models_own(name: str, angle: float) -> None:
    wo = view(angle)
    own, ours = _weights(known(name), wo), _weights(measured(measured_file(name)), wo)
    # Five standard errors, and the interpolation of coarse anisotropic data.
    noise = 5.0 * np.hypot(own.std(), ours.std()) / np.sqrt(_SAMPLES)
    assert abs(own.mean() - ours.mean()) < noise + {"satin": 0.1, "gloss": 0.03}.get(name, 0.01) * own.mean()
    assert ours.var() <= 2.0 * own.var()
    assert ours.max() < 40.0 * ours.mean()


@pytest.mark.parametrize("value", [0.0, 0.3])
def test_samples_without_contrast_are_sampled_by_the_cosine(tmp_path: Path, value: float) -> None:
    file = tmp_path / "even.dat"
    write_anisotropic(file, np.full((3, 3, 3, 3, 3), value))
    weights = _weights(measured(file), view(50.0))
    np.testing.assert_allclose(weights.mean(), np.pi * value, rtol=1e-2, atol=0.0)
    assert weights.std() <= 0.2 * np.pi * value
