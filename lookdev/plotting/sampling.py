"""Plots of importance sampling: the pdf beside the BSDF f times the cosine, weights of samples, a chi-square test.

The test compares the numbers of sampled directions in cells of the sphere with the integrals of the pdf over the cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from lookdev.arrays import Floats
from lookdev.brdf import Bsdf, evaluate_cosine, pdf, sample
from lookdev.brdf.angles import spherical_direction
from lookdev.errors import LookdevError
from lookdev.plotting.figure import LUMINANCE, Plot, PlotValues, create_figure, legend_label, unique_labels
from lookdev.plotting.options import PlotOptions
from lookdev.plotting.subject import PlotSubject

_SAMPLES = 1 << 18  # directions drawn for the histogram of weights, and for the test
_CELLS = 32, 64  # cells of the sphere: rows of equal extent in the cosine, and columns in the azimuth
_NODES = 8  # nodes of Gauss's rule in a cell, along each axis
_MIN_EXPECTED = 5.0
"""Cells with a smaller expected number of samples are merged, as is usual for the test."""
_MAX_CELL_ERROR = 0.1
"""The test is valid if no cell has a larger quadrature error, in standard deviations of its number of samples."""


@dataclass(frozen=True)
class ChiSquare:
    """The result of a chi-square test: the statistic, its degrees of freedom, and its p-value.

    The p-value is the probability of a statistic at least as large by chance. `resolved` is whether the integrals of
    the pdf over cells are exact enough for a valid test.
    """

    statistic: float
    freedom: int
    p: float
    resolved: bool

    def __str__(self) -> str:
        if not self.resolved:
            return "χ²: the lobe is narrower than the cells"
        return f"χ² {self.statistic:.0f} of {self.freedom}, p = {self.p:.2g}"


def plot_sampling(subjects: Sequence[PlotSubject], options: PlotOptions) -> Plot:
    """Plot, for each surface, the pdf and f times the cosine over the sphere, and the weights of samples."""
    figure, axes = create_figure(3, len(subjects), size=(4.0, 3.0))
    columns: dict[str, Floats] = {}
    notes = []
    for row, (label, subject) in enumerate(zip(unique_labels(subjects), subjects, strict=True)):
        values = sampling_values(subject, options)
        cos, phi, density, value = (values[name] for name in ("cos", "phi", "pdf", "value"))
        top = float(max(density.max(), 1e-12))
        for ax, image, title in zip(
            axes[row], (density, value), (f"{legend_label(label)}\npdf (1/sr)", "f cos θi (1/sr)"), strict=False
        ):
            drawn_image = ax.imshow(
                np.log10(np.maximum(image, top * 1e-6)), origin="lower", extent=(0, 360, -1, 1), aspect="auto",
                interpolation="nearest",
            )  # fmt: skip
            ax.set(xlabel="φ (degrees)", ylabel="cos θi")
            ax.set_title(title, fontsize=8)
            figure.colorbar(drawn_image, ax=ax, label="log10", shrink=0.9)
        ax = axes[row, 2]
        ax.stairs(values["counts"], values["edges"], fill=True, color="#0072b2")
        ax.set(xscale="log", yscale="log", xlabel="f cos / pdf", ylabel="samples")
        note = sampling_note(values)
        ax.set_title(note.replace("; ", "\n"), fontsize=7)
        notes.append(f"{label}: {note}")
        columns |= {"cos theta_i": np.repeat(cos, len(phi)), "phi (degrees)": np.tile(np.degrees(phi), len(cos))}
        columns |= {f"{label} pdf": density.ravel(), f"{label} f cos": value.ravel()}
    figure.suptitle(f"θo = {options.theta:g}°, {_SAMPLES} samples", fontsize=9)
    return Plot(figure, columns, tuple(notes))


def sampling_values(subject: PlotSubject, options: PlotOptions, draft: bool = False) -> PlotValues:
    """Return the numbers of a plot of sampling, for the view of the options; a draft is coarser.

    ``value`` is the luminance of f times the cosine. ``pdf`` and ``value`` (n, 2n) are for directions to the light with
    the cosines ``cos`` (n,) and the azimuths ``phi`` (2n,). ``counts`` (bins,) and ``edges`` (bins + 1,) are the
    histogram of the samples' weights. ``test`` has seven numbers: the mean of the weights, its standard error, the
    largest weight, and the fields of `ChiSquare` in their order.
    """
    if subject.is_delta:
        raise LookdevError(
            f"{subject.label}: scatters along single directions and has no pdf; plot fresnel or albedo of it"
        )
    wo = spherical_direction(np.radians(options.theta), np.radians(options.phi))
    count = options.size or (64 if draft else 192)
    cos = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    phi = (np.arange(2 * count) + 0.5) / count * np.pi
    wi = spherical_direction(np.arccos(cos)[:, None], phi[None, :])
    view = np.broadcast_to(wo, wi.shape)
    density, value = pdf(subject.bsdf, view, wi), evaluate_cosine(subject.bsdf, view, wi) @ LUMINANCE
    weights, test = _sample_weights(subject.bsdf, wo, *((1 << 12, _NODES // 4) if draft else (_SAMPLES, _NODES)))
    positive_weights = weights[weights > 0.0]
    counts, edges = np.histogram(positive_weights, np.geomspace(*_histogram_range(positive_weights), 80))
    standard_error = weights.std() / np.sqrt(len(weights))
    numbers = [weights.mean(), standard_error, weights.max(), test.statistic, test.freedom, test.p, test.resolved]
    return {
        "cos": cos, "phi": phi, "pdf": density, "value": value, "counts": counts, "edges": edges,
        "test": np.array(numbers, np.float64),
    }  # fmt: skip


def sampling_note(values: PlotValues) -> str:
    """Return the seven numbers ``test`` of `sampling_values` as a line of text."""
    mean, standard_error, most, statistic, freedom, p, resolved = values["test"].tolist()
    test = ChiSquare(statistic, int(freedom), p, bool(resolved))
    return f"albedo {mean:.4f} ± {standard_error:.1g}, largest weight {most:.3g}; {test}"


def _histogram_range(weights: Floats) -> tuple[float, float]:
    """Return the smallest and the largest weight of a histogram, of at most about eight decades."""
    low, high = (float(weights.min()), float(weights.max())) if len(weights) else (0.1, 10.0)
    return max(low * 0.9, high * 1e-8), high * 1.1


def _sample_weights(bsdf: Bsdf, wo: Floats, samples: int, nodes: int) -> tuple[Floats, ChiSquare]:
    """Return the luminances (samples,) of the weights f cos / pdf, and the test of the sampled directions.

    `wo` (3,) is the view, and `nodes` the parameter of `chi_square`. A sample without a direction has weight 0.
    """
    u = np.random.default_rng(0).random((samples, 2))
    view = np.broadcast_to(wo, (samples, 3))
    wi = sample(bsdf, view, u)
    density = pdf(bsdf, view, wi)
    is_drawn = (density > 0.0) & (wi[:, 2] != 0.0)
    value = evaluate_cosine(bsdf, view, wi) @ LUMINANCE
    weights = np.where(is_drawn, value / np.where(is_drawn, density, 1.0), 0.0)
    return weights, chi_square(bsdf, wo, wi[is_drawn], samples, nodes)


def chi_square(bsdf: Bsdf, wo: Floats, wi: Floats, samples: int, nodes: int = _NODES) -> ChiSquare:
    """Test whether sampled directions `wi` (n, 3) are distributed as the pdf for a view `wo` (3,).

    Of `samples` drawn directions, `wi` has the directions with a pdf above 0. `nodes` is the number of nodes of Gauss's
    rule in a cell, along each axis; half as many give the quadrature error.
    """
    rows, columns = _CELLS
    row = np.minimum((0.5 * (wi[:, 2] + 1.0) * rows).astype(int), rows - 1)
    azimuth_fraction = np.arctan2(wi[:, 1], wi[:, 0]) / (2.0 * np.pi) % 1.0
    column = np.minimum((azimuth_fraction * columns).astype(int), columns - 1)
    observed = np.bincount(row * columns + column, minlength=rows * columns).astype(float)
    coarse, fine = (samples * _cell_probabilities(bsdf, wo, count) for count in (nodes // 2, nodes))
    # The last entry of each is the number of samples without a direction.
    observed, fine = np.append(observed, samples - len(wi)), np.append(fine, max(samples - fine.sum(), 0.0))
    # `o` and `e` are observed and expected numbers. Cells of small expected numbers are merged into one, the last. If
    # its expected number is still small, it is merged with the cell before it.
    is_populated = fine >= _MIN_EXPECTED
    o, e = (np.append(counts[is_populated], counts[~is_populated].sum()) for counts in (observed, fine))
    o, e = (o, e) if e[-1] >= _MIN_EXPECTED else (np.append(o[:-2], o[-2:].sum()), np.append(e[:-2], e[-2:].sum()))
    quadrature_error = np.abs(coarse - fine[:-1]) / np.sqrt(np.maximum(fine[:-1], _MIN_EXPECTED))
    statistic, freedom = float(((o - e) ** 2 / e).sum()), max(len(e) - 1, 1)
    return ChiSquare(
        statistic, freedom, float(chi2.sf(statistic, freedom)), bool(quadrature_error.max() < _MAX_CELL_ERROR)
    )


def _cell_probabilities(bsdf: Bsdf, wo: Floats, nodes: int) -> Floats:
    """Return the integral of the pdf for the view `wo` over each cell, row by row, by Gauss's rule."""
    rows, columns = _CELLS
    x, weights = np.polynomial.legendre.leggauss(nodes)  # type: ignore[no-untyped-call]
    x, weights = 0.5 * (x + 1.0), 0.5 * weights  # from [-1, 1] to [0, 1], the extent of a cell
    cos = ((np.arange(rows)[:, None] + x) / rows * 2.0 - 1.0).ravel()
    phi = ((np.arange(columns)[:, None] + x) / columns * 2.0 * np.pi).ravel()
    wi = spherical_direction(np.arccos(cos)[:, None], phi[None, :])
    density = pdf(bsdf, np.broadcast_to(wo, wi.shape), wi).reshape(rows, nodes, columns, nodes)
    area = (2.0 / rows) * (2.0 * np.pi / columns)
    # Indices: r and c of cells, n and m of nodes in a cell.
    return np.asarray(np.einsum("rncm,n,m->rc", density, weights, weights) * area).ravel()
