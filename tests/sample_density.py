"""Tools for tests that samples follow their density: at single points by a Jacobian, and together by chi-square."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from lookdev.arrays import Floats


def jacobian(sample: Callable[[Floats], Any], u: Floats, step: float = 1e-5) -> tuple[Floats, Floats]:
    """Return the Jacobian (n,) of a sampling at random numbers u (n, 2), and a bound (n,) of its error.

    `sample` maps random numbers (n, 2) to directions (n, 3). The Jacobian is the solid angle for each unit area of
    random numbers. The density of the samples is one over it, if no other random numbers lead to the same direction. It
    is computed by central differences; the bound is the change of the result with twice the step.
    """

    def differences(step: float) -> Floats:
        along = [(sample(u + step * axis) - sample(u - step * axis)) / (2.0 * step) for axis in np.eye(2)]
        return np.linalg.norm(np.cross(*along), axis=-1)

    near, far = differences(step), differences(2.0 * step)
    return near, np.abs(far - near)


def p_value(counts: NDArray[Any], expected: Floats, error: Floats | float = 0.0, fewest: float = 5.0) -> float:
    """Return the chi-square p-value of counts (n,) in bins with expected counts (n,), whose standard error is `error`.

    Bins with expected counts below `fewest` are pooled into one. If its expected count is below `fewest`, too, the next
    larger bins are added.
    """
    variance = expected + np.square(error)
    order = np.argsort(expected)
    counts, expected, variance = counts[order], expected[order], variance[order]
    pooled = max(np.count_nonzero(expected < fewest), 1 + np.searchsorted(np.cumsum(expected), fewest))
    counts, expected, variance = (
        np.append(values[pooled:], values[:pooled].sum()) for values in (counts, expected, variance)
    )
    return float(stats.chi2.sf(((counts - expected) ** 2 / variance).sum(), expected.size - 1))
