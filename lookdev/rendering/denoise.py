"""Denoised halves, mixed with the raw ones so that no frame is worse, and their measured error.

- Firmino, A., Frisvad, J. R. and Jensen, H. W. 2022. Progressive Denoising of Monte Carlo Rendered Images. Computer
  Graphics Forum 41(2): mixing by estimated errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookdev.metrics import EPSILON, reference_of_halves, relmse_of_halves

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

# Tuned on the 14 cells of `lookdev bench --denoise-trial --seed 0`, and reported on those of another seed.
_WINDOW = 13  # pixels over which errors are averaged before pixels are mixed
_USUAL_BIAS = 0.1  # squared bias of smooth pixels over the raw ones' error that is supposed whatever is measured
# Residuals are clipped where they are larger than this, relative to the colour, and than this share of them all.
_LARGE_RESIDUAL, _USUAL_RESIDUALS = 0.3, 0.8
_LEAST_GAIN = 1.1  # of the frame's error, below which raw halves stay: both errors are estimates


@dataclass(frozen=True)
class Denoised:
    """Halves (H, W, 3), whose mean is the picture, and the relMSE of that."""

    a: Floats
    b: Floats
    relmse: float


def denoised(a: Floats, b: Floats, alpha: Floats, smooth: Callable[[Image], Image]) -> Denoised:
    """Denoise two independent renders of equal cost, and measure the error of the mean of both.

    Each half is denoised by itself; D(a) does not depend on the noise of b. With m the picture that both would have
    without noise, E being over all renders, ``E (D(a) - m) (D(b) - m)`` is the square of the bias, and

        E ((D(a) + D(b)) / 2 - m)^2 = E [((D(a) - D(b)) / 2)^2 + (D(a) - a) (D(b) - b)],

    variance and squared bias, since ``E D(a) m = E D(a) b`` and ``m^2 = E a b``: both are measured, not believed. In
    each pixel, raw and denoised are mixed by the weight of least error, from errors averaged over its neighbourhood.

    Few pixels, hit by rare bright paths, have most of the noise of the second term. For the error of the frame,
    residuals are clipped there, relative to the colour, and the term is not less than 0 over the frame. What this
    misses is light of rare paths that the denoiser takes away, as the raw halves' error misses what neither has met.

    a, b : (H, W, 3), premultiplied; alpha : (H, W), pixels with alpha > 0 count.
    """
    covered = alpha > 0.0
    if not covered.any():
        return Denoised(a, b, 0.0)
    smooth_a, smooth_b = (smooth(half.astype(np.float32)).astype(np.float64) for half in (a, b))
    smooth_a, smooth_b = (np.where(covered[..., None], each, half) for each, half in ((smooth_a, a), (smooth_b, b)))
    typical = reference_of_halves(a, b, alpha)
    weight = _weight(smooth_a, smooth_b, a, b, 1.0 / (typical**2 + EPSILON), covered)
    mixed_a, mixed_b = (half + weight * (each - half) for each, half in ((smooth_a, a), (smooth_b, b)))
    mixed = np.maximum(0.5 * (mixed_a + mixed_b), 0.0)
    # An outlier in a guess of the picture would hide its own error. Where noise is no outlier but a glint, which most
    # guesses are too dark for, errors by them are too large: so the mixture has to be better by bright guesses too.
    dark, bright = np.minimum(typical, mixed), np.maximum(np.maximum(typical, mixed), 0.5 * (a + b))
    errors = [_errors(mixed_a, mixed_b, a, b, 1.0 / (each**2 + EPSILON), covered) for each in (dark, bright)]
    if all(_LEAST_GAIN * measured < without for measured, without in errors):
        return Denoised(mixed_a, mixed_b, errors[0][0])
    return Denoised(a, b, relmse_of_halves(a, b, alpha))


def _errors(
    mixed_a: Floats, mixed_b: Floats, a: Floats, b: Floats, scale: Floats, covered: NDArray[np.bool_]
) -> tuple[float, float]:
    """Return the relMSE of the mean of mixed halves, and of raw ones, by the scale of squared errors."""
    variance, without = (
        float((0.25 * (one - other) ** 2 * scale)[covered].mean()) for one, other in ((mixed_a, mixed_b), (a, b))
    )
    residuals = np.stack([(mixed_a - a)[covered], (mixed_b - b)[covered]]) * np.sqrt(scale[covered])
    largest = max(_LARGE_RESIDUAL, float(np.quantile(np.abs(residuals), _USUAL_RESIDUALS)))
    bias = float(np.clip(residuals, -largest, largest).prod(axis=0).mean())
    return variance + max(bias, 0.0), without


def _weight(
    smooth_a: Floats, smooth_b: Floats, a: Floats, b: Floats, scale: Floats, covered: NDArray[np.bool_]
) -> Floats:
    """Return the share of smooth halves in the mixture of least error, (H, W, 1)."""
    raw = _around(0.25 * (a - b) ** 2 * scale, covered)
    error = 0.25 * (smooth_a - smooth_b) ** 2 + (smooth_a - a) * (smooth_b - b)
    smooth = _around(error * scale, covered) + _USUAL_BIAS * raw
    # E (mean - m) ((a + b) / 2 - m): of a half, only the noise of the same half is in what was made of it.
    both = _around(0.25 * (smooth_a - smooth_b) * (a - b) * scale, covered)
    spread = raw + smooth - 2.0 * both
    weight = np.clip((raw - both) / np.where(spread > 0.0, spread, 1.0), 0.0, 1.0)
    return np.asarray(np.where(spread > 0.0, weight, 0.0)[..., None])


def _around(error: Floats, covered: NDArray[np.bool_]) -> Floats:
    """Return the mean over the channels and the neighbours of each pixel on the asset, (H, W), itself left out.

    Noise of one pixel is independent of that of others: weights that do not know a pixel's own do not favour what it
    happens to be near.
    """
    from scipy.ndimage import uniform_filter  # not at the top: as in `lookdev.metrics`

    inside = covered.astype(np.float64)

    def others(values: Floats) -> Floats:
        return np.asarray(_WINDOW**2 * uniform_filter(values, _WINDOW, mode="constant") - values)

    return np.asarray(others(error.mean(axis=-1) * inside) / np.maximum(others(inside), 1.0))
