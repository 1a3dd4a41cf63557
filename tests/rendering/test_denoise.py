"""Halves smoothed by any filter: the measured error of the mixture is the true one, and is not above the raw error."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from lookdev.arrays import Floats
from lookdev.metrics import relmse, relmse_of_halves
from lookdev.rendering.denoise import denoise_halves
from lookdev.rendering.oidn import make_denoiser

SIDE = 96


def picture() -> tuple[Floats, Floats]:
    """Return a disc with a smooth and a checkered half, and its alpha."""
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE - 0.5
    alpha = (x * x + y * y < 0.2).astype(np.float64)
    checks = ((x * 24).astype(int) + (y * 24).astype(int)) % 2
    grey = np.where(x < 0.0, 0.5 + x, 0.2 + 0.6 * checks)
    return np.stack([grey, 0.7 * grey, 0.4 * grey], axis=-1) * alpha[..., None], alpha


def halves(truth: Floats, sigma: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return two renders with skewed noise, as that of paths."""
    noise = rng.gamma(0.5, 2.0, (2, *truth.shape)) - 1.0
    a, b = truth * (1.0 + sigma * noise)
    return a, b


def blur(radius: float):
    return lambda image: gaussian_filter(image, (radius, radius, 0))


# Where the noise is as strong as the picture and skewed, typical colours are darker than the mean. The error is
# relative to the darker, and comes out too large, as it does for raw halves.
@pytest.mark.parametrize(("sigma", "most"), [(0.1, 1.25), (0.5, 1.25), (1.0, 1.6)])
@pytest.mark.parametrize("radius", [0.7, 3.0])
def test_the_error_of_the_mixture_is_measured(sigma: float, most: float, radius: float) -> None:
    truth, alpha = picture()
    rng = np.random.default_rng(1)
    measured, true, raw = [], [], []
    for _ in range(12):
        a, b = halves(truth, sigma, rng)
        result = denoise_halves(a, b, alpha, blur(radius))
        measured.append(result.relmse)
        true.append(relmse(0.5 * (result.a + result.b), truth, alpha))
        raw.append(relmse(0.5 * (a + b), truth, alpha))
    assert 0.75 < np.mean(measured) / np.mean(true) < most
    assert (np.array(true) < np.array(raw)).all()
    # Where noise is strong, a blur helps much.
    assert np.mean(true) < (0.5 if sigma > 0.3 else 0.8) * np.mean(raw)


def test_a_filter_that_ruins_the_picture_is_not_used() -> None:
    truth, alpha = picture()
    a, b = halves(truth, 0.2, np.random.default_rng(2))
    result = denoise_halves(a, b, alpha, lambda image: np.full_like(image, 0.9))
    assert relmse(0.5 * (result.a + result.b), truth, alpha) < 1.02 * relmse(0.5 * (a + b), truth, alpha)
    assert result.relmse == pytest.approx(relmse_of_halves(a, b, alpha), rel=0.3)


def test_halves_without_noise_and_those_without_the_asset_stay_as_they_are() -> None:
    truth, alpha = picture()
    for color, covered in ((truth, alpha), (0.0 * truth, 0.0 * alpha)):
        result = denoise_halves(color, color, covered, blur(2.0))
        np.testing.assert_array_equal(result.a, color)
        assert result.relmse == 0.0


@pytest.mark.parametrize("quick", [False, True])
def test_open_image_denoise_is_guided(quick: bool) -> None:
    truth, alpha = picture()
    a, _ = halves(truth, 1.0, np.random.default_rng(3))
    flat = np.zeros((SIDE, SIDE, 3), np.float32)
    upright = flat + np.float32([0.0, 0.0, 1.0]) * alpha[..., None].astype(np.float32)
    guided = make_denoiser(truth.astype(np.float32), upright, quick=quick)(a.astype(np.float32))
    unguided = make_denoiser(flat, flat, quick=quick)(a.astype(np.float32))
    raw_error, unguided_error, guided_error = (relmse(image, truth, alpha) for image in (a, unguided, guided))
    assert guided_error < 0.5 * unguided_error < 0.5 * raw_error
