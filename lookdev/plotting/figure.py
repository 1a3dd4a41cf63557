"""Plots as values: a matplotlib figure and its numbers, and functions that draw curves and legends.

The global state of matplotlib is not used or changed.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lookdev.arrays import Bools, Elements, Floats
from lookdev.cache import atomic_path
from lookdev.errors import LookdevError
from lookdev.plotting.options import PlotOptions
from lookdev.plotting.subject import PlotSubject

PlotValues = dict[str, NDArray[Any]]
"""The numbers of one surface in a plot: arrays by name. The functions that return them state the names and shapes."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of R, G and B in the luminance of linear Rec.709."""

PLOT_SUFFIXES = (".png", ".svg", ".pdf", ".csv")
"""Suffixes of the files that a plot is written to."""

SUBJECT_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000", "#e69f00", "#56b4e9", "#8c564b")
"""Colours of subjects, in order: Okabe and Ito's palette for the colour-blind."""
RGB_COLORS = ("#c8322d", "#2b8a3e", "#2454c5")
"""Colours of the curves of the channels red, green and blue."""
DASHES = ("-", "--", ":", "-.")
"""Matplotlib's line styles, for curves that share a colour."""

_MAX_LABEL_LENGTH = 56
# Metadata that are left out of files, by suffix: without dates, the same plot is the same file.
_STABLE_METADATA: dict[str, dict[str, None]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}


@dataclass(frozen=True, eq=False)
class Plot:
    """A plot: its figure, its numbers, and notes for the user, such as the error of an integral.

    The numbers are columns of equal length, by the names of the columns; angles are in degrees.
    """

    figure: Figure
    columns: Mapping[str, Elements]
    notes: tuple[str, ...] = ()

    def write(self, file: Path, dpi: float = 120.0) -> None:
        """Write the figure, or for ``.csv`` the numbers, completely or not at all.

        Raises
        ------
        LookdevError
            The suffix of the file is not one of `PLOT_SUFFIXES`.
        """
        suffix = check_suffix(file)
        with atomic_path(file) as temporary:
            if suffix == ".csv":
                with temporary.open("w", newline="", encoding="utf-8") as stream:
                    rows = csv.writer(stream)
                    rows.writerow(self.columns)
                    rows.writerows(zip(*(column.tolist() for column in self.columns.values()), strict=True))
            else:
                with mpl.rc_context({"svg.hashsalt": "lookdev"}):  # a constant in place of random names
                    self.figure.savefig(temporary, format=suffix[1:], dpi=dpi, metadata=_STABLE_METADATA[suffix])


def check_suffix(file: Path) -> str:
    """Return the suffix of a file to write; raises LookdevError if it is not one of `PLOT_SUFFIXES`."""
    if file.suffix.lower() not in PLOT_SUFFIXES:
        raise LookdevError(f"{file}: a plot is written to a file that ends in {', '.join(PLOT_SUFFIXES)}")
    return file.suffix.lower()


def create_figure(
    columns: int = 1, rows: int = 1, size: tuple[float, float] = (6.4, 4.4), projection: str | None = None
) -> tuple[Figure, NDArray[np.object_]]:
    """Return a figure with a grid of axes, each of `size` (width, height) in inches, and the axes, (rows, columns)."""
    figure = Figure(figsize=(size[0] * columns, size[1] * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, subplot_kw={"projection": projection})


def legend_label(label: str) -> str:
    """Return a label for a legend: shortened, and with escaped dollar signs, which begin mathematics in matplotlib."""
    label = label if len(label) <= _MAX_LABEL_LENGTH else f"{label[: _MAX_LABEL_LENGTH - 1]}…"
    return label.replace("$", r"\$")


def unique_labels(subjects: Sequence[PlotSubject]) -> list[str]:
    """Return the labels of surfaces; a number is appended to the repetitions of a label, so that all differ."""
    labels = [subject.label for subject in subjects]
    return [
        label if label not in labels[:index] else f"{label} #{labels[: index + 1].count(label)}"
        for index, label in enumerate(labels)
    ]


def rgb_columns(label: str, colors: Floats) -> dict[str, Floats]:
    """Return the three channels of n colours (..., 3) as columns (n,), by name."""
    return {f"{label}.{name}": colors[..., channel].ravel() for channel, name in enumerate("rgb")}


def split_channels(values: Floats, options: PlotOptions) -> dict[str, Floats]:
    """Return the curves that are drawn for colours (..., 3), by the suffixes of their labels.

    By `options.channels`, they are the three channels or the luminance.
    """
    if options.channels == "rgb":
        return {f".{name}": values[..., index] for index, name in enumerate("rgb")}
    return {"": values @ LUMINANCE}


def draw_curves(
    axes: Axes,
    x: Floats,
    subjects: Sequence[PlotSubject],
    colors: Sequence[Floats],
    options: PlotOptions,
    marker: str = "None",
    height: Callable[[Floats], Floats] = lambda values: values,
) -> dict[str, Floats]:
    """Draw the colours (n, 3) of each surface as curves over x (n,), and return the values of the curves as columns.

    `height` maps the values of a curve to the heights at which they are drawn.
    """
    columns: dict[str, Floats] = {}
    for index, (label, values) in enumerate(zip(unique_labels(subjects), colors, strict=True)):
        for channel, (ending, curve) in enumerate(split_channels(values, options).items()):
            color = RGB_COLORS[channel] if ending else SUBJECT_COLORS[index % len(SUBJECT_COLORS)]
            dashes = DASHES[(index if ending else index // len(SUBJECT_COLORS)) % len(DASHES)]
            text = f"{legend_label(label)}{ending}"
            axes.plot(x, height(curve), color=color, linestyle=dashes, label=text, marker=marker, markersize=4)
            columns[f"{label}{ending}"] = curve
    return columns


def scale_values(axes: Axes, options: PlotOptions, inner: Bools) -> None:
    """Set the scales of axes by the options, and their limits by the values of the curves.

    Only values where `inner` (n,) is true count: near the horizon, some models grow without bound. A log axis shows at
    most eight decades.
    """
    values = np.concatenate([np.asarray(line.get_ydata(), np.float64)[inner] for line in axes.lines if inner.any()])
    high = float(values.max(initial=0.0)) or 1.0
    positive = values[values > 0.0]
    if options.scale == "log" and len(positive):
        axes.set_yscale("log", nonpositive="mask")
        axes.set_ylim(max(positive.min(), high * 1e-8) * 0.7, high * 1.6)
    elif options.scale == "sqrt":
        axes.set_yscale("function", functions=(lambda v: np.sqrt(np.maximum(v, 0.0)), np.square))
        axes.set_ylim(0.0, high * 1.1)
    else:
        axes.set_ylim(0.0, high * 1.05)
    if options.angles == "sqrt":
        axes.set_xscale("function", functions=(lambda v: np.sign(v) * np.sqrt(np.abs(v)), lambda v: np.sign(v) * v * v))
        axes.set_xlim(left=max(axes.get_xlim()[0], -options.limit if options.axis == "theta_i" else 0.0))


def draw_legend(axes: Axes) -> None:
    """Draw the grid of axes, and their legend below them."""
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), frameon=False, fontsize=8)


def encode_srgb(values: Floats, options: PlotOptions) -> Floats:
    """Convert values (..., 3) from linear Rec.709 to sRGB in [0, 1] (IEC 61966-2-1).

    The values are first divided by their largest channel if `options.chroma` is true, and then brightened by the
    exposure.
    """
    if options.chroma:
        values = values / np.maximum(values.max(axis=-1, keepdims=True), 1e-300)
    linear = np.clip(values * 2.0**options.exposure, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
