"""The check "image" of `lookdev check`: compares frames with the float64 reference at random pixels, by t-tests.

A frame is several independent renders, its halves. Their spread gives the noise of the frame; the reference has a
standard error of its own. Both are estimated from few values. A difference divided by its error therefore follows
Student's t, with the degrees of freedom of Welch (1947) and Satterthwaite (1946). Rare bright paths make heavy-tailed
noise: if no half of a pixel has found such a path, its value is too low and its spread too small. The reference has
more samples, so its standard error gives a lower bound of the frame's noise.

There are three tests. Noise alone fails each of them once in `1 / LEVEL` frames:

- No channel of any pixel has a |t| beyond the quantile for all comparisons together (Šidák 1967). This detects local
  errors.
- The number of pixels beyond a quantile in the middle of the distribution is not too large. This detects small errors
  at many pixels.
- The mean relative difference of each channel is not too large. This detects a bias far below the noise of a pixel.

The picture of a backend that approximates the models is not compared with the reference, but with the picture of the
backend ``exact``, by relMSE and by FLIP. Each picture has two independent halves. Products of differences between
different halves estimate relMSE without bias, so no converged pictures are needed. FLIP has no such estimator. The FLIP
of two renders of the same picture is therefore reported for comparison.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.ndimage import binary_dilation

from lookdev.arrays import Floats, Ints, Reals
from lookdev.checks.finding import CheckFinding, FindingPlot, PlotCurve, PlotImage
from lookdev.errors import RenderError
from lookdev.metrics import EPSILON
from lookdev.reference.render import Estimate

LEVEL = 3e-4
"""The probability that noise alone fails a test."""

MAX_FLIP = 0.05
"""The largest mean FLIP at which a check of an approximation passes."""

MIN_HALVES = 8
"""The least number of halves. With fewer, the quantiles of Student's t are so large that no frame fails."""

_MIDDLE = 0.2  # the share of pixels that noise alone puts beyond the quantile of the second test
# At a shading point, a sample of the frame draws at most this number of times the directions of a reference's sample.
_DIRECTIONS = 4.0
_FLOOR = 1e-6  # the least standard error: ten times the float32 rounding of 1
_WORST = 5  # the number of pixels that a finding lists


@dataclass(frozen=True)
class Agreement:
    """The difference of a frame from the reference at P pixels; all arrays have the shape (P, 3)."""

    difference: Floats  # frame minus reference
    error: Floats  # standard error of the difference
    t: Floats  # difference / error
    freedom: Floats  # degrees of freedom of the error
    frame_error: Floats  # the standard error of the frame, from the spread of its halves alone


def choose_pixels(alpha: Reals, count: int, seed: int = 0) -> Ints:
    """Choose at most `count` random pixels (P, 2), column and row, at the asset or next to it.

    A pixel is at the asset if its coverage in `alpha` (H, W) is above 0. The neighbours are included because coverage
    is random at the asset's edge: pixels that happen to be covered are brighter than average.
    """
    rows, columns = np.nonzero(binary_dilation(alpha > 0.0, np.ones((3, 3))))
    selection = np.random.default_rng(seed).permutation(len(rows))[:count]
    return np.asarray(np.stack([columns, rows], axis=-1)[selection], np.int64)


def compare_pixels(halves: Reals, samples: int, reference: Estimate) -> Agreement:
    """Compare pixels of a frame with the reference.

    `halves` (K, P, 3) has the pixels of independent renders of equal cost, premultiplied, with exposure 0. `samples` is
    the number of samples per pixel in all halves together. Raises RenderError for fewer than `MIN_HALVES` halves.
    """
    count = len(halves)
    if count < MIN_HALVES:
        raise RenderError(f"{count} independent renders are too few to estimate noise; {MIN_HALVES} would be right")
    halves = halves.astype(np.float64)
    variance = halves.var(axis=0, ddof=1) / count
    # The lower bound of the frame's variance: the reference's variance, scaled to the number of the frame's directions.
    min_variance = reference.error**2 * (reference.samples * reference.scrambles / (samples * _DIRECTIONS))
    # Where some halves are 0, light arrives by rare events, and their number is a Poisson variable. The spread of a few
    # halves can miss all of them, so their size is that of the largest event which such a pixel shows.
    is_rare = (halves == 0.0).any(axis=0)
    event = np.where(is_rare, halves, 0.0).max(axis=(0, 1))
    min_variance = np.maximum(min_variance, np.where(is_rare, np.maximum(reference.value, 0.0) * event / count, 0.0))
    frame_variance, reference_variance = np.maximum(variance, min_variance), reference.error**2
    error = np.maximum(np.sqrt(frame_variance + reference_variance), _FLOOR)
    # The degrees of freedom of Welch and Satterthwaite.
    spread = frame_variance**2 / (count - 1) + reference_variance**2 / (reference.scrambles - 1)
    freedom = np.where(
        spread > 0.0, (frame_variance + reference_variance) ** 2 / np.where(spread > 0.0, spread, 1.0), count - 1.0
    )
    difference = halves.mean(axis=0) - reference.value
    return Agreement(difference, error, difference / error, freedom, np.sqrt(variance))


def check_frame(
    subject: str,
    halves: Reals,
    alpha: Reals,
    samples: int,
    pixels: Ints,
    reference: Estimate,
    converged: Reals | None = None,
) -> CheckFinding:
    """Check a frame against the reference; raises as `compare_pixels`.

    Parameters
    ----------
    subject
        Look, light and pose, for the report.
    halves : (K, H, W, 3)
        Independent renders of equal cost, premultiplied, exposure 0; at least `MIN_HALVES`.
    alpha : (H, W)
        Coverage.
    samples
        Samples per pixel in all halves together.
    pixels : (P, 2)
        Column and row of the compared pixels, from `choose_pixels`.
    reference
        The values of these pixels.
    converged : (H, W, 3)
        The same frame with many more samples, for FLIP.
    """
    columns, rows = pixels.T
    broken = pixels[~np.isfinite(halves[:, rows, columns]).all(axis=(0, 2))]
    if len(broken):
        details = tuple(f"pixel {column},{row}: not finite" for column, row in broken[:_WORST])
        summary = f"{len(broken)} of {len(pixels)} pixels are not finite"
        return CheckFinding("image", subject, False, summary, {"broken": float(len(broken))}, details)
    agreement = compare_pixels(halves[:, rows, columns], samples, reference)
    tests = agreement.t.size
    # The probability (P, 3) that noise causes such a deviation or a larger one, and the lowest probability that passes.
    p_values = 2.0 * stats.t.sf(np.abs(agreement.t), agreement.freedom)
    min_p_value = 1.0 - (1.0 - LEVEL) ** (1.0 / tests)
    suspicious = int((p_values < min_p_value).any(axis=-1).sum())
    # The channels of a pixel share their samples, so their median counts as one value.
    beyond = int((np.median(p_values, axis=-1) < _MIDDLE).sum())
    beyond_limit = int(stats.binom.ppf(1.0 - LEVEL, len(pixels), _MIDDLE))
    scale = np.sqrt(reference.value**2 + EPSILON)
    bias, bias_error, bias_limit = _mean_bias(agreement, scale)
    relmse = float(np.mean((agreement.difference / scale) ** 2 - (reference.error / scale) ** 2))
    worst_bias = int(np.abs(bias / bias_limit).argmax())
    figures = {
        "pixels": float(len(pixels)),
        "suspicious": float(suspicious),
        "largest_t": float(np.abs(agreement.t).max()),
        "beyond": beyond / len(pixels),
        "beyond_limit": beyond_limit / len(pixels),
        "bias": float(bias[worst_bias]),
        "bias_error": float(bias_error[worst_bias]),
        "bias_limit": float(bias_limit[worst_bias]),
        "relmse": max(relmse, 0.0),
        "relmse_claimed": float(np.mean((agreement.frame_error / scale) ** 2)),
    }
    pictures = [frame_picture("frame", halves.mean(axis=0)), _difference_picture(agreement, alpha.shape, pixels)]
    skipped = ""
    if converged is None:
        skipped = "FLIP: no converged frame to compare with"
    else:
        figures["flip"], flip_map = flip(halves.mean(axis=0), converged)
        pictures.append(PlotImage("FLIP", flip_map, 0.0, 1.0))
    passed = suspicious == 0 and beyond <= beyond_limit and bool((np.abs(bias) <= bias_limit).all())
    summary = (
        f"{len(pixels)} pixels: {suspicious} beyond noise (largest t {figures['largest_t']:.1f}), "
        f"{figures['beyond']:.0%} beyond the middle (noise {_MIDDLE:.0%}, at most {figures['beyond_limit']:.0%}), "
        f"bias {figures['bias']:+.2%} ± {figures['bias_limit']:.2%}, relMSE {figures['relmse']:.2g}"
    )
    plots = (
        _plot_differences(agreement, reference),
        _plot_histogram(agreement),
        FindingPlot("The frame", pictures=tuple(pictures)),
    )
    details = tuple(
        _describe_pixel(agreement, pixels, reference, index) for index in np.argsort(p_values.min(axis=-1))[:_WORST]
    )
    return CheckFinding("image", subject, passed, summary, figures, details, plots, skipped)


def flip(image: Reals, converged: Reals) -> tuple[float, Floats]:
    """Return the mean HDR-FLIP of an image (H, W, 3) against a converged one, and its map (H, W), both in [0, 1].

    HDR-FLIP is the visible difference of two pictures, over all exposures that show anything of one of the pictures
    (Andersson et al. 2021, "Visualizing Errors in Rendered High Dynamic Range Images").
    """
    import flip_evaluator

    test, reference = (np.ascontiguousarray(np.maximum(picture, 0.0), np.float32) for picture in (image, converged))
    flip_map, mean, _ = flip_evaluator.evaluate(reference, test, "HDR", applyMagma=False)
    return float(mean), np.asarray(flip_map, np.float64).reshape(image.shape[:2])


def _mean_bias(agreement: Agreement, scale: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the mean relative difference, its standard error, and the largest that passes, each (3,), by channel."""
    variance = (agreement.error / scale) ** 2
    bias, error = np.mean(agreement.difference / scale, axis=0), np.sqrt(variance.sum(axis=0)) / len(variance)
    freedom = variance.sum(axis=0) ** 2 / (variance**2 / agreement.freedom).sum(axis=0)
    limit = stats.t.isf((1.0 - (1.0 - LEVEL) ** (1.0 / 3.0)) / 2.0, freedom) * error
    return bias, error, limit


def _describe_pixel(agreement: Agreement, pixels: Ints, reference: Estimate, index: int) -> str:
    """Return a line with the position, the values and the deviation of a compared pixel; `index` is its index."""

    def format_numbers(values: Sequence[float] | Floats) -> str:
        return " ".join(f"{value:.4g}" for value in values)

    value = reference.value[index]
    return (
        f"pixel {pixels[index, 0]},{pixels[index, 1]}: frame {format_numbers(value + agreement.difference[index])}, "
        f"reference {format_numbers(value)}, error {format_numbers(agreement.error[index])}, "
        f"t {format_numbers(agreement.t[index])}"
    )


def _plot_differences(agreement: Agreement, reference: Estimate) -> FindingPlot:
    """Return a plot of relative differences over the values of the reference, with two standard errors as bars."""
    x = reference.value.mean(axis=-1)
    scale = np.sqrt(x**2 + EPSILON)
    y, error = agreement.difference.mean(axis=-1) / scale, 2.0 * agreement.error.mean(axis=-1) / scale
    series = PlotCurve("pixels, two standard errors", x, y, y - error, y + error, "points")
    return FindingPlot("Frame minus reference", "reference, mean of channels", "relative difference", (series,))


def _plot_histogram(agreement: Agreement) -> FindingPlot:
    """Return a histogram of t, converted to normal deviates of the same probability, beside the normal distribution.

    Normal deviates do not depend on the degrees of freedom, which differ between pixels.
    """
    deviates = np.sign(agreement.t) * stats.norm.isf(
        np.maximum(stats.t.sf(np.abs(agreement.t), agreement.freedom), 1e-300)
    )
    edges = np.linspace(-6.0, 6.0, 49)
    density = np.histogram(np.clip(deviates, -6.0, 6.0), edges)[0] / (deviates.size * (edges[1] - edges[0]))
    noise = np.linspace(-6.0, 6.0, 121)
    series = (
        PlotCurve("channels of pixels", edges, density, style="bars"),
        PlotCurve("noise", noise, stats.norm.pdf(noise)),
    )
    return FindingPlot("Differences over their errors", "standard errors", "density", series)


def frame_picture(name: str, image: Reals) -> PlotImage:
    """Return a linear frame (H, W, 3) as a picture of the report, with a display gamma of 2.2."""
    return PlotImage(name, np.clip(image, 0.0, 1.0).astype(np.float64) ** (1.0 / 2.2))


def _difference_picture(agreement: Agreement, shape: tuple[int, ...], pixels: Ints) -> PlotImage:
    """Return a picture with the mean t of each compared pixel, and without values elsewhere."""
    canvas = np.full(shape, np.nan)
    canvas[pixels[:, 1], pixels[:, 0]] = agreement.t.mean(axis=-1)
    return PlotImage("t of the pixels compared", canvas, -6.0, 6.0)


@dataclass(frozen=True, eq=False)
class Gap:
    """The difference between the picture of an approximation and the exact picture, over the asset's pixels."""

    relmse: float  # the relMSE of the approximation's picture without noise, against the exact picture without noise
    relmse_error: float  # standard error of `relmse`
    flip: float  # mean HDR-FLIP between the two pictures
    noise: float  # mean HDR-FLIP between two renders of the exact picture
    flip_map: Floats  # HDR-FLIP of each pixel, (H, W)


def measure_gap(exact: tuple[Reals, Reals], other: tuple[Reals, Reals], alpha: Reals) -> Gap:
    """Compare the exact picture with another picture, each given by two independent halves (H, W, 3).

    The halves are premultiplied and have exposure 0. `alpha` (H, W) is the coverage.
    """
    covered = alpha > 0.0
    a, b, c, d = (half.astype(np.float64)[covered] for half in (*exact, *other))
    # The denominator of relMSE has the square of the exact picture. A product of independent halves replaces it, too.
    squares = (a - c) * (b - d) / (np.maximum(a * b, 0.0) + EPSILON)
    pixels = squares.mean(axis=-1)
    # The noise is the FLIP of one half against the other. `flip_map` compares means of two halves, with less noise.
    _, noise_map = flip(exact[0], exact[1])
    _, flip_map = flip((other[0] + other[1]) / 2.0, (exact[0] + exact[1]) / 2.0)
    return Gap(
        relmse=float(pixels.mean()),
        relmse_error=float(pixels.std(ddof=1) / np.sqrt(pixels.size)),
        flip=float(flip_map[covered].mean()),
        noise=float(noise_map[covered].mean()),
        flip_map=flip_map,
    )


def check_gap(subject: str, exact: tuple[Reals, Reals], other: tuple[Reals, Reals], alpha: Reals) -> CheckFinding:
    """Check that the mean FLIP of a picture against the exact one is at most `MAX_FLIP`; see `measure_gap`."""
    gap = measure_gap(exact, other, alpha)
    figures = {"flip": gap.flip, "flip_noise": gap.noise, "relmse": gap.relmse, "relmse_error": gap.relmse_error}
    summary = (
        f"FLIP to exact {gap.flip:.3f} (at most {MAX_FLIP}; of two exact renders {gap.noise:.3f}), "
        f"relMSE {gap.relmse:.2g} ± {gap.relmse_error:.1g}"
    )
    pictures = (
        frame_picture("nodes", (other[0] + other[1]) / 2.0),
        frame_picture("exact", (exact[0] + exact[1]) / 2.0),
        PlotImage("FLIP", gap.flip_map, 0.0, 1.0),
    )
    plot = FindingPlot("The frame", pictures=pictures)
    return CheckFinding("image", subject, gap.flip <= MAX_FLIP, summary, figures, plots=(plot,))
