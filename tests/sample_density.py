"""Whether samples follow their density: point by point, by a Jacobian, and all together, by chi-square."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from lookdev.arrays import Floats


def jacobian(sample: Callable[[Floats], Any], u: Floats, step: float = 1e-5) -> tuple[Floats, Floats]:
    """Return the solid angle (n,) that a sampling gives to a unit square of random numbers about u (n, 2).

    One over it is the density with which the directions (n, 3) are drawn, if no other numbers lead there. Differences
    are central; the second array bounds their error, by twice the step.
    """

    def differences(step: float) -> Floats:
        along = [(sample(u + step * axis) - sample(u - step * axis)) / (2.0 * step) for axis in np.eye(2)]
        return np.linalg.norm(np.cross(*along), axis=-1)

    near, far = differences(step), differences(2.0 * step)
    return near, np.abs(far - near)


def p_value(counts: NDArray[Any], expected: Floats, error: Floats | float = 0.0, fewest: float = 5.0) -> float:
    """Return the chi-square p-value of counts in bins (n,); `error` is that of what is expected.

    Bins that expect fewer than `fewest` are pooled, with the next ones where together they expect fewer.
    """
    variance = expected + np.square(error)
    order = np.argsort(expected)
    counts, expected, variance = counts[order], expected[order], variance[order]
    pooled = max(np.count_nonzero(expected < fewest), 1 + np.searchsorted(np.cumsum(expected), fewest))
    counts, expected, variance = (
        np.append(each[pooled:], each[:pooled].sum()) for each in (counts, expected, variance)
    )
    return float(stats.chi2.sf(((counts - expected) ** 2 / variance).sum(), expected.size - 1))
