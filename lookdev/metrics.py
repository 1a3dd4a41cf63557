"""The error of a frame, relMSE: against a reference, or estimated from two independent halves of the frame's samples.

Pictures are (H, W, 3), linear and premultiplied; their coverage alpha is (H, W).
"""

from __future__ import annotations

import numpy as np

from lookdev.arrays import Floats, Floats32, Reals

EPSILON = 0.01
"""The addend to the squared reference in the denominator of relMSE: it bounds the relative error of dark pixels."""

ROUNDING = 2.0**-11
"""The largest relative rounding error of a half float."""


def relmse(image: Reals, reference: Reals, alpha: Reals) -> float:
    """Return the relMSE of an image: the mean of ``(image - reference)^2 / (reference^2 + 0.01)``.

    image, reference : (H, W, 3), premultiplied; alpha : (H, W). The mean is over channels and pixels with alpha > 0. If
    there are no such pixels, it is 0.
    """
    reference = reference.astype(np.float64)
    error = (image - reference) ** 2 / (reference**2 + EPSILON)
    return _mean_over_asset(error, alpha)


def relmse_of_halves(a: Reals, b: Reals, alpha: Reals) -> float:
    """Estimate the relMSE of ``(a + b) / 2`` from two independent renders of equal cost.

    ``((a - b) / 2)^2`` estimates the variance of the mean ``(a + b) / 2``. The reference in the denominator of relMSE
    is not known. In its place is the larger of two values for each pixel and channel. One is the ninther, about the
    median, of the colours of 3 x 3 pixels, times the pixel's own coverage. The pixel's own value would be large at a
    bright outlier, and so hide its error. The other is the smaller of `a` and `b`: a fine highlight is bright in both.

    a, b : (H, W, 3), premultiplied; alpha : (H, W). Pixels with alpha > 0 count. If there are no such pixels, the
    result is 0.
    """
    window = _asset_window(alpha)
    if window is None:
        return 0.0
    a, b, alpha = (image[window].astype(np.float64) for image in (a, b, alpha))
    reference = reference_of_halves(a, b, alpha)
    return _mean_over_asset(((a - b) / 2) ** 2 / (reference**2 + EPSILON), alpha)


def standard_error(a: Reals, b: Reals) -> Floats32:
    """Return ``|a - b| / 2``, the standard error of ``(a + b) / 2`` in each pixel and channel, from one difference.

    The numbers are cut to 10 bits after the leading bit: they then compress to half the size of the full numbers.

    a, b : (H, W, 3), independent renders of equal cost.
    """
    error = np.abs(np.asarray(a, np.float32) - np.asarray(b, np.float32)) * np.float32(0.5)
    return np.asarray((error.view(np.uint32) & np.uint32(0xFFFFE000)).view(np.float32))


def pooled_error(error: Reals) -> Floats32:
    """Return the standard error of each pixel's colour, (H, W), from `standard_error` (H, W, 3).

    One difference of halves is a poor estimate of a variance. So the squared errors, summed over channels, are averaged
    over blocks of 3 x 3 pixels. Each pixel takes the largest average of the blocks that contain it: at an edge, few of
    its neighbours have the same noise. The result is averaged over blocks again. So an outlier in one half alone never
    differs by more than 3 of these errors.
    """
    from scipy.ndimage import maximum_filter, uniform_filter  # not at the top: as in `reference_of_halves`

    variance = np.square(np.asarray(error, np.float64)).sum(axis=-1)
    largest = maximum_filter(uniform_filter(variance, 3, mode="nearest"), 3, mode="nearest")
    return np.asarray(np.sqrt(np.maximum(uniform_filter(largest, 3, mode="nearest"), 0.0)), np.float32)


def noise_ratio(a: Reals, b: Reals, error_a: Reals, error_b: Reals, size: int = 1) -> Floats32:
    """Return z, (H, W): the difference of two pictures around each pixel, in units of its standard deviation by noise.

    ``z^2 = sum_c (sum_i (a_ic - b_ic))^2 / sum_i (error_ai^2 + error_bi^2 + rounding_i^2)``. The sums are over the
    channels c, and over the pixels i of a square around the pixel, whose side is `size`, an odd number. ``rounding_i``
    is the largest error of a and b by rounding to half floats. Where two pictures differ by Gaussian noise alone, z is
    above 3 in at most .27 % of pixels, and in fewer where the noise of channels is independent. A larger square detects
    weaker differences.

    a, b : (H, W, 3), which may be rounded to half floats; error_a, error_b : (H, W), from `pooled_error`.
    """
    from scipy.ndimage import uniform_filter  # not at the top: as in `reference_of_halves`

    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    rounding = (a**2 + b**2).sum(axis=-1) * ROUNDING**2
    noise = np.square(error_a, dtype=np.float64) + np.square(error_b, dtype=np.float64) + rounding
    # Means over the square: the variance of a mean of n values is n^-2 of the sum of their variances.
    noise = np.maximum(uniform_filter(noise, size, mode="constant"), 0.0) / size**2
    distance = np.square(uniform_filter(a - b, (size, size, 1), mode="constant")).sum(axis=-1)
    return np.asarray(np.sqrt(np.divide(distance, noise, where=noise > 0.0, out=np.zeros_like(noise))), np.float32)


def reference_of_halves(a: Floats, b: Floats, alpha: Reals) -> Floats:
    """Return the colours (H, W, 3) that replace the unknown reference in `relmse_of_halves`, which explains them."""
    # Not at the top: the import takes a sixth of a second, and would delay the first sample of a job.
    from scipy.ndimage import uniform_filter

    covered = alpha > 0
    color = (a + b) / 2 / np.where(covered, alpha, 1.0)[..., None]
    # Pixels off the asset take the mean colour of covered neighbours, so that a silhouette is not beside black.
    weight = uniform_filter(covered.astype(np.float64), 3, mode="constant")[..., None]
    nearby = uniform_filter(color * covered[..., None], (3, 3, 1), mode="constant") / np.where(weight > 0, weight, 1.0)
    typical = _ninther(np.where(covered[..., None], color, nearby)) * alpha[..., None]
    return np.maximum(typical, np.minimum(a, b))


def _asset_window(alpha: Reals) -> tuple[slice, ...] | None:
    """Return the smallest window of a picture that contains the asset; None where the asset covers no pixel."""
    covered = alpha > 0
    if not covered.any():
        return None
    spans = (np.flatnonzero(covered.any(axis=axis)) for axis in (1, 0))
    return tuple(slice(int(span[0]), int(span[-1]) + 1) for span in spans)


def _ninther(image: Floats) -> Floats:
    """Return the ninther around each pixel: the median of the medians of three columns of three pixels (Tukey 1978).

    It takes a tenth of the time of the median of nine pixels.
    """
    for axis in (0, 1):
        padded = np.pad(image, [(1, 1) if axis == other else (0, 0) for other in range(image.ndim)], mode="edge")
        size = image.shape[axis]
        before, here, after = (np.take(padded, range(start, start + size), axis) for start in range(3))
        # The median of three numbers.
        image = np.maximum(np.minimum(before, here), np.minimum(np.maximum(before, here), after))
    return image


def _mean_over_asset(error: Floats, alpha: Reals) -> float:
    """Return the mean of errors (H, W, 3) over the pixels with alpha > 0; 0 if there are none."""
    covered = alpha > 0
    return float(error[covered].mean()) if covered.any() else 0.0
