"""How a surface is sampled: its pdf beside f times the cosine, the weights of its samples, and a chi-square test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from lookdev.brdf import Bsdf, evaluate_cosine, pdf, sample
from lookdev.errors import LookdevError
from lookdev.plotting.angles import LUMINANCE, Floats, Values, towards
from lookdev.plotting.figure import Plot, distinct, figure_of, shown
from lookdev.plotting.options import Options
from lookdev.plotting.subject import Subject

_SAMPLES = 1 << 18
_CELLS = 32, 64  # of cosine of both sides, and of azimuth
_NODES = 8
_LEAST = 5.0
"""The expected number below which cells are put together, as is usual for the test."""
_RESOLVED = 0.1
"""The largest quadrature error of a cell, in its standard deviations, for the statistic to have a meaning."""


@dataclass(frozen=True)
class ChiSquare:
    """The statistic, its degrees of freedom, and the probability p that chance makes it as large.

    `resolved` is whether the pdf's integrals over cells are known well enough for it to have a meaning.
    """

    statistic: float
    freedom: int
    p: float
    resolved: bool

    def __str__(self) -> str:
        if not self.resolved:
            return "χ²: the lobe is narrower than the cells"
        return f"χ² {self.statistic:.0f} of {self.freedom}, p = {self.p:.2g}"


def sampling(subjects: Sequence[Subject], options: Options) -> Plot:
    """Plot, for each surface, the pdf and f times the cosine over the sphere, and the weights of samples."""
    figure, axes = figure_of(3, len(subjects), size=(4.0, 3.0))
    columns: dict[str, Floats] = {}
    notes = []
    for row, (label, subject) in enumerate(zip(distinct([s.label for s in subjects]), subjects, strict=True)):
        found = sampling_values(subject, options)
        cos, phi, density, value = (found[name] for name in ("cos", "phi", "pdf", "value"))
        top = float(max(density.max(), 1e-12))
        for ax, image, title in zip(
            axes[row], (density, value), (f"{shown(label)}\npdf (1/sr)", "f cos θi (1/sr)"), strict=False
        ):
            shown_image = ax.imshow(
                np.log10(np.maximum(image, top * 1e-6)), origin="lower", extent=(0, 360, -1, 1), aspect="auto",
                interpolation="nearest",
            )  # fmt: skip
            ax.set(xlabel="φ (degrees)", ylabel="cos θi")
            ax.set_title(title, fontsize=8)
            figure.colorbar(shown_image, ax=ax, label="log10", shrink=0.9)
        ax = axes[row, 2]
        ax.stairs(found["counts"], found["edges"], fill=True, color="#0072b2")
        ax.set(xscale="log", yscale="log", xlabel="f cos / pdf", ylabel="samples")
        note = sampling_note(found)
        ax.set_title(note.replace("; ", "\n"), fontsize=7)
        notes.append(f"{label}: {note}")
        columns |= {"cos theta_i": np.repeat(cos, len(phi)), "phi (degrees)": np.tile(np.degrees(phi), len(cos))}
        columns |= {f"{label} pdf": density.ravel(), f"{label} f cos": value.ravel()}
    figure.suptitle(f"θo = {options.theta:g}°, {_SAMPLES} samples", fontsize=9)
    return Plot(figure, columns, tuple(notes))


def sampling_values(subject: Subject, options: Options, draft: bool = False) -> Values:
    """Return the `pdf` and the `value`, f times the cosine, (n, 2n), at cosines `cos` (n,) and azimuths `phi` (2n,).

    `counts` (k,) between `edges` (k + 1,) are of the samples' weights; `test` has their mean, its standard error, the
    largest weight, and statistic, degrees of freedom, p of `ChiSquare`, and whether it is resolved.
    """
    if subject.is_delta:
        raise LookdevError(
            f"{subject.label}: scatters along single directions and has no pdf; plot fresnel or albedo of it"
        )
    wo = towards(np.radians(options.theta), np.radians(options.phi))
    count = options.size or (64 if draft else 192)
    cos = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    phi = (np.arange(2 * count) + 0.5) / count * np.pi
    wi = towards(np.arccos(cos)[:, None], phi[None, :])
    view = np.broadcast_to(wo, wi.shape)
    density, value = pdf(subject.bsdf, view, wi), evaluate_cosine(subject.bsdf, view, wi) @ LUMINANCE
    weights, test = _samples(subject.bsdf, wo, *((1 << 12, _NODES // 4) if draft else (_SAMPLES, _NODES)))
    drawn = weights[weights > 0.0]
    counts, edges = np.histogram(drawn, np.geomspace(*_range(drawn), 80))
    spread = weights.std() / np.sqrt(len(weights))
    numbers = [weights.mean(), spread, weights.max(), test.statistic, test.freedom, test.p, test.resolved]
    return {
        "cos": cos, "phi": phi, "pdf": density, "value": value, "counts": counts, "edges": edges,
        "test": np.array(numbers, np.float64),
    }  # fmt: skip


def sampling_note(values: Values) -> str:
    """Return what `sampling_values` found, in words."""
    mean, spread, most, statistic, freedom, p, resolved = values["test"].tolist()
    test = ChiSquare(statistic, int(freedom), p, bool(resolved))
    return f"albedo {mean:.4f} ± {spread:.1g}, largest weight {most:.3g}; {test}"


def _range(drawn: Floats) -> tuple[float, float]:
    low, high = (float(drawn.min()), float(drawn.max())) if len(drawn) else (0.1, 10.0)
    return max(low * 0.9, high * 1e-8), high * 1.1


def _samples(bsdf: Bsdf, wo: Floats, samples: int, nodes: int) -> tuple[Floats, ChiSquare]:
    """Return luminances of the samples' weights f cos / pdf, and the test of their directions against the pdf."""
    u = np.random.default_rng(0).random((samples, 2))
    view = np.broadcast_to(wo, (samples, 3))
    wi = sample(bsdf, view, u)
    density = pdf(bsdf, view, wi)
    drawn = (density > 0.0) & (wi[:, 2] != 0.0)
    value = evaluate_cosine(bsdf, view, wi) @ LUMINANCE
    weights = np.where(drawn, value / np.where(drawn, density, 1.0), 0.0)
    return weights, chi_square(bsdf, wo, wi[drawn], samples, nodes)


def chi_square(bsdf: Bsdf, wo: Floats, wi: Floats, samples: int, nodes: int = _NODES) -> ChiSquare:
    """Test directions (n, 3) that are above 0 among some number of samples against the pdf, in cells of the sphere."""
    rows, columns = _CELLS
    row = np.minimum((0.5 * (wi[:, 2] + 1.0) * rows).astype(int), rows - 1)
    turn = np.arctan2(wi[:, 1], wi[:, 0]) / (2.0 * np.pi) % 1.0
    column = np.minimum((turn * columns).astype(int), columns - 1)
    observed = np.bincount(row * columns + column, minlength=rows * columns).astype(float)
    coarse, fine = (samples * _expected(bsdf, wo, count) for count in (nodes // 2, nodes))
    # Of directions that count as none, the number is known, too.
    observed, fine = np.append(observed, samples - len(wi)), np.append(fine, max(samples - fine.sum(), 0.0))
    many = fine >= _LEAST
    o, e = (np.append(each[many], each[~many].sum()) for each in (observed, fine))
    o, e = (o, e) if e[-1] >= _LEAST else (np.append(o[:-2], o[-2:].sum()), np.append(e[:-2], e[-2:].sum()))
    off = np.abs(coarse - fine[:-1]) / np.sqrt(np.maximum(fine[:-1], _LEAST))
    statistic, freedom = float(((o - e) ** 2 / e).sum()), max(len(e) - 1, 1)
    return ChiSquare(statistic, freedom, float(chi2.sf(statistic, freedom)), bool(off.max() < _RESOLVED))


def _expected(bsdf: Bsdf, wo: Floats, nodes: int) -> Floats:
    """Return the integral of the pdf over each cell by Gauss's rule, flattened."""
    rows, columns = _CELLS
    x, w = np.polynomial.legendre.leggauss(nodes)  # type: ignore[no-untyped-call]
    x, w = 0.5 * (x + 1.0), 0.5 * w
    cos = ((np.arange(rows)[:, None] + x) / rows * 2.0 - 1.0).ravel()
    phi = ((np.arange(columns)[:, None] + x) / columns * 2.0 * np.pi).ravel()
    wi = towards(np.arccos(cos)[:, None], phi[None, :])
    density = pdf(bsdf, np.broadcast_to(wo, wi.shape), wi).reshape(rows, nodes, columns, nodes)
    area = (2.0 / rows) * (2.0 * np.pi / columns)
    return np.asarray(np.einsum("rncm,n,m->rc", density, w, w) * area).ravel()
