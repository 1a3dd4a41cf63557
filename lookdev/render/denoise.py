"""Denoised halves, mixed with the raw ones so that no frame is worse, and their measured error.

- Firmino, A., Frisvad, J. R. and Jensen, H. W. 2022. Progressive Denoising of Monte Carlo Rendered Images. Computer
  Graphics Forum 41(2): mixing by estimated errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookdev.metrics import EPSILON, reference_of_halves

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

_WINDOW = 9  # pixels over which errors are averaged before pixels are mixed


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

        E ((D(a) + D(b)) / 2 - m)^2 = E [((D(a) + D(b)) / 2)^2 - D(a) b - D(b) a + a b],

    since ``E D(a) m = E D(a) b`` and ``m^2 = E a b``: bias and what noise is left are measured, not believed. In each
    pixel, raw and denoised are mixed by the weight of least error, from errors averaged over its neighbourhood.

    a, b : (H, W, 3), premultiplied; alpha : (H, W), pixels with alpha > 0 count.
    """
    covered = alpha > 0.0
    smooth_a, smooth_b = (smooth(half.astype(np.float32)).astype(np.float64) for half in (a, b))
    smooth_a, smooth_b = (np.where(covered[..., None], each, half) for each, half in ((smooth_a, a), (smooth_b, b)))
    # Relative to the colours that the error of raw halves is relative to: smooth ones hide their own bias.
    scale = 1.0 / (reference_of_halves(a, b, alpha) ** 2 + EPSILON)
    raw = 0.25 * (a - b) ** 2
    raw_error = _around(raw * scale, covered)
    smooth_error = _around(_error(smooth_a, smooth_b, a, b) * scale, covered)
    # E (mean - m) ((a + b) / 2 - m): of a half, only the noise of the same half is in what was made of it.
    both = _around(0.25 * (smooth_a - smooth_b) * (a - b) * scale, covered)
    spread = raw_error + smooth_error - 2.0 * both
    weight = np.clip((raw_error - both) / np.where(spread > 0.0, spread, 1.0), 0.0, 1.0)
    weight = np.where(spread > 0.0, weight, 0.0)[..., None]
    mixed_a, mixed_b = (half + weight * (each - half) for each, half in ((smooth_a, a), (smooth_b, b)))
    if not covered.any():
        return Denoised(a, b, 0.0)
    measured, without = (float((each * scale)[covered].mean()) for each in (_error(mixed_a, mixed_b, a, b), raw))
    return Denoised(mixed_a, mixed_b, measured) if measured < without else Denoised(a, b, without)


def _error(smooth_a: Floats, smooth_b: Floats, a: Floats, b: Floats) -> Floats:
    """Return, for each pixel and channel, numbers whose mean is the squared error of the mean of smooth halves."""
    return np.asarray((0.5 * (smooth_a + smooth_b)) ** 2 - smooth_a * b - smooth_b * a + a * b)


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
