"""How far the picture of an approximation is from the exact one, for a machine and for a person.

Both pictures come as two independent halves. Products of differences of unlike halves have no noise in them on
average, so relMSE needs no converged pictures. FLIP has no such form: that of two renders of the same picture, which
should be 0, is reported beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.checks.finding import Finding, Picture, Plot
from lookdev.checks.images import flip, frame_picture
from lookdev.metrics import EPSILON

Floats = NDArray[np.floating[Any]]
Doubles = NDArray[np.float64]

MOST_FLIP = 0.05
"""The largest mean FLIP of an approximation that a check passes."""


@dataclass(frozen=True, eq=False)
class Gap:
    """What two pictures differ by over the asset's pixels.

    relmse of their expectations, and its standard error; flip, the mean HDR-FLIP of the two, and noise, that of two
    renders of the exact one; seen (H, W), the map of FLIP.
    """

    relmse: float
    relmse_error: float
    flip: float
    noise: float
    seen: Doubles


def measure_gap(exact: tuple[Floats, Floats], other: tuple[Floats, Floats], alpha: Floats) -> Gap:
    """Compare two pictures.

    Parameters
    ----------
    exact, other : pairs of (H, W, 3)
        Independent halves, premultiplied, exposure 0.
    alpha : (H, W)
        Coverage; pixels above 0 count.
    """
    covered = alpha > 0.0
    a, b, c, d = (half.astype(np.float64)[covered] for half in (*exact, *other))
    # As relMSE has it, the reference squared; of unlike halves too.
    squares = (a - c) * (b - d) / (np.maximum(a * b, 0.0) + EPSILON)
    pixels = squares.mean(axis=-1)
    # Two halves against two: what four give against four is less noisy than this by half.
    _, apart = flip(exact[0], exact[1])
    _, seen = flip((other[0] + other[1]) / 2.0, (exact[0] + exact[1]) / 2.0)
    return Gap(
        relmse=float(pixels.mean()),
        relmse_error=float(pixels.std(ddof=1) / np.sqrt(pixels.size)),
        flip=float(seen[covered].mean()),
        noise=float(apart[covered].mean()),
        seen=seen,
    )


def check_gap(subject: str, exact: tuple[Floats, Floats], other: tuple[Floats, Floats], alpha: Floats) -> Finding:
    """Check that a person hardly sees the difference: mean FLIP at most `MOST_FLIP`; parameters as `measure_gap`."""
    gap = measure_gap(exact, other, alpha)
    figures = {
        "flip": gap.flip,
        "flip_noise": gap.noise,
        "relmse": gap.relmse,
        "relmse_error": gap.relmse_error,
    }
    summary = (
        f"FLIP to exact {gap.flip:.3f} (at most {MOST_FLIP}; of two exact renders {gap.noise:.3f}), "
        f"relMSE {gap.relmse:.2g} ± {gap.relmse_error:.1g}"
    )
    pictures = (
        frame_picture("nodes", (other[0] + other[1]) / 2.0),
        frame_picture("exact", (exact[0] + exact[1]) / 2.0),
        Picture("FLIP", gap.seen, 0.0, 1.0),
    )
    plot = Plot("The frame", pictures=pictures)
    return Finding("image", subject, gap.flip <= MOST_FLIP, summary, figures, plots=(plot,))
