"""Losses between two surfaces: the root mean square of the difference of f cos theta_i, compressed or not.

- Ngan, A., Durand, F., Matusik, W. 2005. Experimental Analysis of BRDF Models. EGSR, eq. 6: linear.
- Löw, J. et al. 2012. BRDF Models for Accurate and Efficient Rendering of Glossy Surfaces. ACM TOG 31(1): log.
- Bieron, J., Peers, P. 2020. An Adaptive BRDF Fitting Metric. CGF 39(4), on such losses.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lookdev.arrays import Floats

LOSSES: dict[str, Callable[[Floats], Floats]] = {
    "log": np.log1p,
    "cbrt": np.cbrt,
    "linear": lambda value: value,
}
"""The function that compresses f cos theta_i, (...), by the name of the loss."""
