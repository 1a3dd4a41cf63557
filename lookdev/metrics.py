"""The error of a frame: relMSE, against a reference or from two independent halves."""

from __future__ import annotations

import numpy as np

from lookdev.arrays import Floats, Floats32, Reals

EPSILON = 0.01
"""The addend to the squared reference: it bounds the relative error of dark pixels."""

ROUNDING = 2.0**-11
"""The largest relative rounding error of a half float."""


def relmse(image: Reals, reference: Reals, alpha: Reals) -> float:
    """Return ``mean((x - ref)^2 / (ref^2 + 0.01))`` over the pixels of the asset.

    image, reference : (H, W, 3), premultiplied; alpha : (H, W). Pixels with alpha > 0 count; without any, it is 0.
    """
    reference = reference.astype(np.float64)
    error = (image - reference) ** 2 / (reference**2 + EPSILON)
    return _mean_over_asset(error, alpha)


def relmse_of_halves(a: Reals, b: Reals, alpha: Reals) -> float:
    """Estimate the relMSE of ``(a + b) / 2`` from two independent renders of equal cost.

    ``((a - b) / 2)^2`` estimates the variance of the mean. Two values replace the unknown reference in the denominator,
    of which the brighter counts. One is the ninther of the 3 x 3 neighbours' colours times the pixel's own coverage:
    the pixel itself would hide a bright outlier. The other is the darker half, since a fine highlight is in both.

    a, b : (H, W, 3), premultiplied; alpha : (H, W). Pixels with alpha > 0 count; without any, it is 0.
    """
    window = _asset_window(alpha)
    if window is None:
        return 0.0
    a, b, alpha = (image[window].astype(np.float64) for image in (a, b, alpha))
    reference = reference_of_halves(a, b, alpha)
    return _mean_over_asset(((a - b) / 2) ** 2 / (reference**2 + EPSILON), alpha)


def standard_error(a: Reals, b: Reals) -> Floats32:
    """Return ``|a - b| / 2``, the standard error of ``(a + b) / 2`` in each pixel and channel, from one difference.

    The numbers are cut to 10 bits after the leading one: such noise compresses to half the size of the full numbers.

    a, b : (H, W, 3), independent renders of equal cost.
    """
    error = np.abs(np.asarray(a, np.float32) - np.asarray(b, np.float32)) * np.float32(0.5)
    return np.asarray((error.view(np.uint32) & np.uint32(0xFFFFE000)).view(np.float32))


def pooled_error(error: Reals) -> Floats32:
    """Return the standard error of each pixel's colour, (H, W), from `standard_error` (H, W, 3).

    One difference of halves is a poor estimate of a variance. So the squares, summed over channels, are averaged over
    3 x 3 pixels. Each pixel takes the largest average of the squares that contain it: at an edge, few of its neighbours
    have the same noise. These are averaged again. As a result, an outlier in one half alone never differs by more than
    3 of these errors.
    """
    from scipy.ndimage import maximum_filter, uniform_filter  # not at the top: as in `reference_of_halves`

    variance = np.square(np.asarray(error, np.float64)).sum(axis=-1)
    largest = maximum_filter(uniform_filter(variance, 3, mode="nearest"), 3, mode="nearest")
    return np.asarray(np.sqrt(np.maximum(uniform_filter(largest, 3, mode="nearest"), 0.0)), np.float32)


def noise_ratio(a: Reals, b: Reals, error_a: Reals, error_b: Reals, size: int = 1) -> Floats32:
    """Return z, (H, W): the difference of two pictures around each pixel, in units of their noise.

    ``z^2 = sum_c (sum_i (a_ic - b_ic))^2 / sum_i (error_ai^2 + error_bi^2 + rounding_i^2)``, over the channels c and
    the pixels i of a square whose side is `size`, an odd number. Where two pictures differ by Gaussian noise alone, z
    is above 3 in at most .27 % of pixels, and in fewer where the noise of channels is independent. A larger square
    detects weaker differences.

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
    """Return colours (H, W, 3) that replace the unknown reference in the denominator of `relmse_of_halves`."""
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
    """Return the median of the medians of three rows around each pixel (Tukey 1978), in a tenth of a median's time."""
    for axis in (0, 1):
        padded = np.pad(image, [(1, 1) if axis == k else (0, 0) for k in range(image.ndim)], mode="edge")
        size = image.shape[axis]
        before, here, after = (np.take(padded, range(start, start + size), axis) for start in range(3))
        image = np.maximum(np.minimum(before, here), np.minimum(np.maximum(before, here), after))
    return image


def _mean_over_asset(error: Floats, alpha: Reals) -> float:
    covered = alpha > 0
    return float(error[covered].mean()) if covered.any() else 0.0
