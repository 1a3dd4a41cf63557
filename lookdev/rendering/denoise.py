"""Denoising of a frame: denoised pixels are mixed with raw pixels, and the error of the result is measured.

A frame is rendered as two independent halves of its samples, each a picture of the whole frame. The mixture prevents
denoising from making a frame worse. `lookdev.rendering.frame` calls `denoise_halves` after each round of samples.

- Firmino, A., Frisvad, J. R. and Jensen, H. W. 2022. Progressive Denoising of Monte Carlo Rendered Images. Computer
  Graphics Forum 41(2): mixing by estimated errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Bools, Floats, Floats32
from lookdev.metrics import EPSILON, reference_of_halves, relmse_of_halves

# The following numbers are tuned on the 14 random scenes of `lookdev bench --denoise-trial --seed 0`. Reported figures
# are from another seed.
_WINDOW = 13  # side, in pixels, of the window in which errors are averaged for the weight of a pixel
_USUAL_BIAS = 0.1  # this share of the raw error is added to the measured error of denoised pixels, as a squared bias
# A residual is a mixed half minus its raw half, relative to the colour. Residuals are clipped to the larger of two
# limits: the number _LARGE_RESIDUAL, and the quantile _USUAL_RESIDUALS of the frame's absolute residuals.
_LARGE_RESIDUAL, _USUAL_RESIDUALS = 0.3, 0.8
# The raw error of a frame must be at least this factor of the mixed error. Otherwise the raw halves are returned,
# because both errors are estimates.
_LEAST_GAIN = 1.1


@dataclass(frozen=True)
class Denoised:
    """The two halves (H, W, 3) of a frame after denoising, and the relMSE of their mean, which is the picture."""

    a: Floats
    b: Floats
    relmse: float


def denoise_halves(a: Floats, b: Floats, alpha: Floats, smooth: Callable[[Floats32], Floats32]) -> Denoised:
    """Denoise two independent renders a and b of equal cost, and measure the error of their mean.

    a, b : (H, W, 3), premultiplied; alpha : (H, W), only pixels with alpha > 0 are denoised and measured; smooth : the
    denoiser D. It returns the denoised colours of a half.

    Each half is denoised by itself, so D(a) does not depend on the noise of b. Let m be the picture without noise and E
    the expectation over renders. The squared bias is ``E (D(a) - m) (D(b) - m)``, and the squared error is

        E ((D(a) + D(b)) / 2 - m)^2 = E [((D(a) - D(b)) / 2)^2 + (D(a) - a) (D(b) - b)],

    the variance plus the squared bias, since ``E D(a) m = E D(a) b`` and ``m^2 = E a b``. Both terms can be measured
    without m. The result mixes raw and denoised colours in each pixel with the weight of least error. The errors for
    this weight are averaged over the neighbours of the pixel.

    The error of the frame is measured by the same formula, with the mixed halves in place of D(a) and D(b). A few
    pixels with rare bright paths have most of the noise of the second term. Residuals, which are mixed halves minus raw
    halves, are therefore clipped, relative to the colour, and the term is at least 0 over the frame. The error then
    misses the light of rare paths that the denoiser removes. (The error of the raw halves misses paths that neither
    half has sampled.)
    """
    covered = alpha > 0.0
    if not covered.any():
        return Denoised(a, b, 0.0)
    smooth_a, smooth_b = (smooth(half.astype(np.float32)).astype(np.float64) for half in (a, b))
    smooth_a, smooth_b = (
        np.where(covered[..., None], smoothed, half) for smoothed, half in ((smooth_a, a), (smooth_b, b))
    )
    typical = reference_of_halves(a, b, alpha)
    weight = _smooth_weight(smooth_a, smooth_b, a, b, 1.0 / (typical**2 + EPSILON), covered)
    mixed_a, mixed_b = (half + weight * (smoothed - half) for smoothed, half in ((smooth_a, a), (smooth_b, b)))
    mixed = np.maximum(0.5 * (mixed_a + mixed_b), 0.0)
    # Errors are relative to a guess of the noise-free picture, and no single guess is safe. The bright guess includes
    # outliers of the raw picture, so an outlier hides its own error. The dark guess misses glints, so all errors there
    # are too large. The mixture must therefore have the smaller error with both guesses.
    dark, bright = np.minimum(typical, mixed), np.maximum(np.maximum(typical, mixed), 0.5 * (a + b))
    errors = [
        _mixed_and_raw_error(mixed_a, mixed_b, a, b, 1.0 / (guess**2 + EPSILON), covered) for guess in (dark, bright)
    ]
    if all(_LEAST_GAIN * mixed_error < raw_error for mixed_error, raw_error in errors):
        return Denoised(mixed_a, mixed_b, errors[0][0])
    return Denoised(a, b, relmse_of_halves(a, b, alpha))


def _mixed_and_raw_error(
    mixed_a: Floats, mixed_b: Floats, a: Floats, b: Floats, scale: Floats, covered: Bools
) -> tuple[float, float]:
    """Return the relMSE of the mean of the mixed halves, and the relMSE of the mean of the raw halves.

    `scale` (H, W, 3) makes squared errors relative: it is 1 over the square of the colour. `covered` (H, W) selects
    the pixels on the asset.
    """
    variance, raw_error = (
        float((0.25 * (first - second) ** 2 * scale)[covered].mean()) for first, second in ((mixed_a, mixed_b), (a, b))
    )
    residuals = np.stack([(mixed_a - a)[covered], (mixed_b - b)[covered]]) * np.sqrt(scale[covered])
    largest = max(_LARGE_RESIDUAL, float(np.quantile(np.abs(residuals), _USUAL_RESIDUALS)))
    bias = float(np.clip(residuals, -largest, largest).prod(axis=0).mean())
    return variance + max(bias, 0.0), raw_error


def _smooth_weight(smooth_a: Floats, smooth_b: Floats, a: Floats, b: Floats, scale: Floats, covered: Bools) -> Floats:
    """Return the weight (H, W, 1) of the smooth halves that gives the mixture with the raw halves the least error.

    `scale` and `covered` are as in `_mixed_and_raw_error`.
    """
    raw = _neighbourhood_mean(0.25 * (a - b) ** 2 * scale, covered)
    error = 0.25 * (smooth_a - smooth_b) ** 2 + (smooth_a - a) * (smooth_b - b)
    smooth = _neighbourhood_mean(error * scale, covered) + _USUAL_BIAS * raw
    # The covariance of the smooth mean and the raw mean. The noise of a smooth half comes from its own raw half alone,
    # so the product of half the differences estimates the covariance.
    covariance = _neighbourhood_mean(0.25 * (smooth_a - smooth_b) * (a - b) * scale, covered)
    # The mean of ``(smooth - raw)^2``. The following weight minimises the error of ``raw + weight * (smooth - raw)``.
    squared_difference = raw + smooth - 2.0 * covariance
    weight = np.clip((raw - covariance) / np.where(squared_difference > 0.0, squared_difference, 1.0), 0.0, 1.0)
    return np.asarray(np.where(squared_difference > 0.0, weight, 0.0)[..., None])


def _neighbourhood_mean(error: Floats, covered: Bools) -> Floats:
    """Return the mean error (H, W) of the neighbours of each pixel, over the channels, without the pixel itself.

    Only pixels on the asset count. The noise of a pixel is independent of the noise of its neighbours. A weight from
    the neighbours alone is therefore independent of the pixel's own noise. With its own error in the weight, each pixel
    would prefer the picture, raw or smooth, that its noise makes look better by chance.
    """
    from scipy.ndimage import uniform_filter  # imported here as in `lookdev.metrics`

    mask = covered.astype(np.float64)

    def sum_of_others(values: Floats) -> Floats:
        return np.asarray(_WINDOW**2 * uniform_filter(values, _WINDOW, mode="constant") - values)

    return np.asarray(sum_of_others(error.mean(axis=-1) * mask) / np.maximum(sum_of_others(mask), 1.0))
