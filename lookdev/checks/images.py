"""Compares frames with the float64 reference by t-tests on a random subset of pixels.

The spread of a frame's independent halves is its noise; the reference has its own standard error. Both are estimated
from few values, so a difference divided by its error follows Student's t, with the degrees of freedom of Welch (1947)
and Satterthwaite (1946). Rare bright paths make heavy-tailed noise: a pixel whose halves all missed such a path has too
low a value and too small a spread. So the reference, which has more samples, gives a lower bound of the noise.

Noise alone fails each of three tests once in `1 / LEVEL` frames:

- every channel of every pixel: no |t| is beyond the quantile for all tests (Šidák 1967); detects local errors;
- the number of pixels beyond a quantile in the middle of the distribution; detects small errors at many pixels;
- the mean relative difference of each channel; detects a bias far below the noise of a pixel.

The picture of an approximation is compared with the exact picture instead, by relMSE and by FLIP. Both pictures are two
independent halves. A product of differences of independent halves is unbiased, so relMSE needs no converged pictures.
FLIP has no such estimator, so its value for two renders of the same picture is reported, too.
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
"""The least number of halves: with fewer, the quantiles of Student's t are too large for any failure."""

_MIDDLE = 0.2  # the share of pixels that noise alone puts beyond the middle quantile
_DIRECTIONS = 4.0  # the most directions per shading point of a frame for each direction of the reference
_FLOOR = 1e-6  # of an error: ten times the float32 rounding of 1
_WORST = 5


@dataclass(frozen=True)
class Agreement:
    """The difference of a frame from the reference at P pixels; all arrays have the shape (P, 3)."""

    difference: Floats  # frame minus reference
    error: Floats  # its standard error
    t: Floats  # difference over error
    freedom: Floats  # degrees of freedom of the error
    claimed: Floats  # the frame's own standard error


def choose_pixels(alpha: Reals, count: int, seed: int = 0) -> Ints:
    """Choose at most `count` random pixels (P, 2), column and row, where `alpha` (H, W) or a neighbour's is above 0.

    Neighbours are included because pixels that a frame's samples happen to cover are brighter than average.
    """
    rows, columns = np.nonzero(binary_dilation(alpha > 0.0, np.ones((3, 3))))
    selection = np.random.default_rng(seed).permutation(len(rows))[:count]
    return np.asarray(np.stack([columns, rows], axis=-1)[selection], np.int64)


def compare_pixels(halves: Reals, samples: int, reference: Estimate) -> Agreement:
    """Compare pixels of a frame with the reference.

    `halves` (K, P, 3) are independent renders of equal cost, premultiplied, exposure 0; `samples` is the number per
    pixel over all of them. A RenderError reports fewer than `MIN_HALVES`.
    """
    count = len(halves)
    if count < MIN_HALVES:
        raise RenderError(f"{count} independent renders are too few to estimate noise; {MIN_HALVES} would be right")
    halves = halves.astype(np.float64)
    variance = halves.var(axis=0, ddof=1) / count
    min_variance = reference.error**2 * (reference.samples * reference.scrambles / (samples * _DIRECTIONS))
    frame_variance, reference_variance = np.maximum(variance, min_variance), reference.error**2
    error = np.maximum(np.sqrt(frame_variance + reference_variance), _FLOOR)
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
    """Check a frame against the reference; errors are those of `compare_pixels`.

    Parameters
    ----------
    subject
        Look, light and pose, for the report.
    halves : (K, H, W, 3)
        Independent renders of equal cost, premultiplied, exposure 0; at least `MIN_HALVES`.
    alpha : (H, W)
        Coverage.
    samples
        Per pixel, over all halves.
    pixels : (P, 2)
        Column and row of the pixels of `reference`, from `choose_pixels`.
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
    # The probability of such a deviation by noise, for each channel, and the lowest that passes.
    p_values = 2.0 * stats.t.sf(np.abs(agreement.t), agreement.freedom)
    min_p_value = 1.0 - (1.0 - LEVEL) ** (1.0 / tests)
    suspicious = int((p_values < min_p_value).any(axis=-1).sum())
    # Channels of a pixel share their samples, so a pixel has one number: the median of its channels.
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
        "relmse_claimed": float(np.mean((agreement.claimed / scale) ** 2)),
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

    Andersson et al. 2021, "Visualizing Errors in Rendered High Dynamic Range Images": the visible difference of two
    pictures over all exposures at which either shows anything.
    """
    import flip_evaluator

    test, reference = (np.ascontiguousarray(np.maximum(picture, 0.0), np.float32) for picture in (image, converged))
    flip_map, mean, _ = flip_evaluator.evaluate(reference, test, "HDR", applyMagma=False)
    return float(mean), np.asarray(flip_map, np.float64).reshape(image.shape[:2])


def _mean_bias(agreement: Agreement, scale: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the mean relative difference of channels, its standard error, and the limit of its noise, (3,) each."""
    variance = (agreement.error / scale) ** 2
    bias, error = np.mean(agreement.difference / scale, axis=0), np.sqrt(variance.sum(axis=0)) / len(variance)
    freedom = variance.sum(axis=0) ** 2 / (variance**2 / agreement.freedom).sum(axis=0)
    limit = stats.t.isf((1.0 - (1.0 - LEVEL) ** (1.0 / 3.0)) / 2.0, freedom) * error
    return bias, error, limit


def _describe_pixel(agreement: Agreement, pixels: Ints, reference: Estimate, index: int) -> str:
    def format_numbers(values: Sequence[float] | Floats) -> str:
        return " ".join(f"{value:.4g}" for value in values)

    value = reference.value[index]
    return (
        f"pixel {pixels[index, 0]},{pixels[index, 1]}: frame {format_numbers(value + agreement.difference[index])}, "
        f"reference {format_numbers(value)}, error {format_numbers(agreement.error[index])}, "
        f"t {format_numbers(agreement.t[index])}"
    )


def _plot_differences(agreement: Agreement, reference: Estimate) -> FindingPlot:
    x = reference.value.mean(axis=-1)
    scale = np.sqrt(x**2 + EPSILON)
    y, error = agreement.difference.mean(axis=-1) / scale, 2.0 * agreement.error.mean(axis=-1) / scale
    series = PlotCurve("pixels, two standard errors", x, y, y - error, y + error, "points")
    return FindingPlot("Frame minus reference", "reference, mean of channels", "relative difference", (series,))


def _plot_histogram(agreement: Agreement) -> FindingPlot:
    """Return a plot of t as normal deviates of equal probability, which do not depend on the degrees of freedom."""
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
    """Return a frame (H, W, 3) as a picture of the report."""
    return PlotImage(name, np.clip(image, 0.0, 1.0).astype(np.float64) ** (1.0 / 2.2))


def _difference_picture(agreement: Agreement, shape: tuple[int, ...], pixels: Ints) -> PlotImage:
    canvas = np.full(shape, np.nan)
    canvas[pixels[:, 1], pixels[:, 0]] = agreement.t.mean(axis=-1)
    return PlotImage("t of the pixels compared", canvas, -6.0, 6.0)


@dataclass(frozen=True, eq=False)
class Gap:
    """The difference of two pictures over the asset's pixels."""

    relmse: float  # of their expectations
    relmse_error: float  # its standard error
    flip: float  # mean HDR-FLIP
    noise: float  # mean HDR-FLIP of two renders of the exact picture
    flip_map: Floats  # the map of FLIP, (H, W)


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
        flip_map=flip_map,
    )


def check_gap(subject: str, exact: tuple[Reals, Reals], other: tuple[Reals, Reals], alpha: Reals) -> CheckFinding:
    """Check that the mean FLIP is at most `MAX_FLIP`; the parameters are those of `measure_gap`."""
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
