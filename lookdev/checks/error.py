"""How wrong a frame is: relMSE, against a reference or from two independent halves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

Floats = NDArray[np.float32] | NDArray[np.float64]

EPSILON = 0.01
"""Added to the squared reference: what counts as black in the relative error."""


def relmse(image: Floats, reference: Floats, alpha: Floats) -> float:
    """Return ``mean((x - ref)^2 / (ref^2 + 0.01))`` over the pixels of the asset.

    image, reference : (H, W, 3); alpha : (H, W), pixels with alpha > 0 count. NaN where there is none.
    """
    squared = (image.astype(np.float64) - reference) ** 2
    return _mean_over_asset(squared / (reference.astype(np.float64) ** 2 + EPSILON), alpha)


def relmse_of_halves(a: Floats, b: Floats, alpha: Floats) -> float:
    """Estimate the relMSE of ``(a + b) / 2`` from two independent renders of equal cost.

    The variance of the mean is estimated by ``((a - b) / 2)^2``. The unknown reference in the denominator is
    replaced by the mean over the 3 x 3 neighbourhood: a single bright outlier would otherwise excuse itself.
    """
    a, b = a.astype(np.float64), b.astype(np.float64)
    mean = uniform_filter((a + b) / 2, size=(3, 3, 1), mode="nearest")
    return _mean_over_asset(((a - b) / 2) ** 2 / (mean**2 + EPSILON), alpha)


def _mean_over_asset(error: Floats, alpha: Floats) -> float:
    covered = alpha > 0
    return float(error[covered].mean()) if covered.any() else float("nan")
