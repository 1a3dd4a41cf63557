"""The data to which `lookdev fit` fits a model: the BRDF f of a surface at pairs of directions, and the losses.

The pairs are centres of cells of the MERL file format, so that no f of a MERL file is interpolated. A loss is the root
mean square of the difference between two surfaces. The compared value is f cos theta_i, where theta_i is the angle
between the direction to the light and the normal. Some losses compress this value first:

- Ngan, A., Durand, F., Matusik, W. 2005. Experimental Analysis of BRDF Models. EGSR, eq. 6: linear.
- Löw, J. et al. 2012. BRDF Models for Accurate and Efficient Rendering of Glossy Surfaces. ACM TOG 31(1): log.
- Bieron, J., Peers, P. 2020. An Adaptive BRDF Fitting Metric. CGF 39(4), on such losses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import Bsdf, evaluate
from lookdev.brdf.angles import half_difference
from lookdev.brdf.measured.files import MERL_SIZE
from lookdev.errors import LookdevError

LOSSES: dict[str, Callable[[Floats], Floats]] = {"log": np.log1p, "cbrt": np.cbrt, "linear": lambda value: value}
"""The function that compresses f cos theta_i, (...), by the name of the loss."""

MAX_ANGLE = 80.0
"""Degrees from the normal beyond which measured data are not used, because they are unreliable (Ngan et al. 2005)."""

# The golden ratio minus 1. Its multiples, modulo 1, are evenly spread in [0, 1).
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@dataclass(frozen=True, eq=False)
class ReflectanceSamples:
    """n pairs of unit directions, and the BRDF f of a surface for each pair.

    `wo` (n, 3) is the direction to the viewer, and `wi` (n, 3) is the direction to the light. `f` (n, 3) is in 1/sr;
    its last axis is the channel.
    """

    wo: Floats
    wi: Floats
    f: Floats

    @property
    def cosine(self) -> Floats:
        """The cosine between `wi` and the normal, (n, 1)."""
        return self.wi[:, 2:]

    def thin(self, step: int) -> ReflectanceSamples:
        """Return every `step`-th pair, starting with the first."""
        return ReflectanceSamples(self.wo[::step], self.wi[::step], self.f[::step])


def evaluate_pairs(
    bsdf: Bsdf, label: str, counts: tuple[int, int, int] = (30, 10, 4), limit: float = MAX_ANGLE
) -> ReflectanceSamples:
    """Evaluate the BRDF of a surface on a grid of pairs of directions, up to `limit` degrees from the normal.

    The axes of the grid are Rusinkiewicz's half and difference angles theta_h, theta_d and phi_d, with `counts` values
    each. theta_h is in even steps of its square root. Each pair is rotated about the normal by a different azimuth: an
    anisotropic model could otherwise fit a tangent direction that the data do not have. `label` is the name of the
    surface in messages. Raises LookdevError if f is 0 everywhere, or is not finite somewhere.
    """
    # Positions in [0, 1] on the axes of a MERL file: the square root of theta_h, theta_d, and phi_d.
    h, d, phi = (_cell_centres(count, size) for count, size in zip(counts, MERL_SIZE, strict=True))
    angles = np.meshgrid(h**2 * 0.5 * np.pi, d * 0.5 * np.pi, phi * np.pi, indexing="ij")
    wo, wi = (w.reshape(-1, 3) for w in half_difference(*angles))
    above = np.minimum(wo[:, 2], wi[:, 2]) > np.cos(np.radians(limit))
    wo, wi = wo[above], wi[above]
    azimuth = 2.0 * np.pi * ((np.arange(len(wo)) * _GOLDEN) % 1.0)
    wo, wi = (_rotate(w, azimuth) for w in (wo, wi))
    f = evaluate(bsdf, wo, wi)
    if not np.isfinite(f).all() or not f.any():
        raise LookdevError(f"{label}: has no f to fit within {limit:g} degrees of the normal")
    # In this order, the pairs of `ReflectanceSamples.thin` are spread over all angles.
    order = np.argsort((np.arange(len(wo)) * _GOLDEN) % 1.0)
    return ReflectanceSamples(wo[order], wi[order], f[order])


def _cell_centres(count: int, size: int) -> Floats:
    """Return the centres, in [0, 1], of `count` of the `size` cells of an axis, evenly spread."""
    return np.asarray((np.floor((np.arange(count) + 0.5) * size / count) + 0.5) / size)


def _rotate(w: Floats, angle: Floats) -> Floats:
    """Rotate directions (n, 3) about the z axis by angles (n,)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * w[:, 0] - s * w[:, 1], s * w[:, 0] + c * w[:, 1], w[:, 2]], axis=-1)
