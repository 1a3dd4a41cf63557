"""The difference between the picture of an approximation and the exact picture, as relMSE and as FLIP.

Both pictures are two independent halves. A product of differences of independent halves is unbiased, so relMSE needs no
converged pictures. FLIP has no such estimator, so its value for two renders of the same picture is reported, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Floats, Reals
from lookdev.checks.finding import Finding, Picture, Plot
from lookdev.checks.images import flip, frame_picture
from lookdev.metrics import EPSILON

MOST_FLIP = 0.05
"""The largest mean FLIP at which a check of an approximation passes."""


@dataclass(frozen=True, eq=False)
class Gap:
    """The difference of two pictures over the asset's pixels."""

    relmse: float  # of their expectations
    relmse_error: float  # its standard error
    flip: float  # mean HDR-FLIP
    noise: float  # mean HDR-FLIP of two renders of the exact picture
    seen: Floats  # the map of FLIP, (H, W)


def measure_gap(exact: tuple[Reals, Reals], other: tuple[Reals, Reals], alpha: Reals) -> Gap:
    """Compare independent halves (H, W, 3) of two pictures, premultiplied, exposure 0; `alpha` (H, W) is coverage."""
    covered = alpha > 0.0
    a, b, c, d = (half.astype(np.float64)[covered] for half in (*exact, *other))
    # The squared reference of relMSE is a product of independent halves too.
    squares = (a - c) * (b - d) / (np.maximum(a * b, 0.0) + EPSILON)
    pixels = squares.mean(axis=-1)
    # One half against the other: four halves against four are less noisy by a factor of 2.
    _, noise_map = flip(exact[0], exact[1])
    _, flip_map = flip((other[0] + other[1]) / 2.0, (exact[0] + exact[1]) / 2.0)
    return Gap(
        relmse=float(pixels.mean()),
        relmse_error=float(pixels.std(ddof=1) / np.sqrt(pixels.size)),
        flip=float(flip_map[covered].mean()),
        noise=float(noise_map[covered].mean()),
        seen=flip_map,
    )


def check_gap(subject: str, exact: tuple[Reals, Reals], other: tuple[Reals, Reals], alpha: Reals) -> Finding:
    """Check that the mean FLIP is at most `MOST_FLIP`; the parameters are those of `measure_gap`."""
    gap = measure_gap(exact, other, alpha)
    figures = {"flip": gap.flip, "flip_noise": gap.noise, "relmse": gap.relmse, "relmse_error": gap.relmse_error}
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
