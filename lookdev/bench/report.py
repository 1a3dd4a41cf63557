"""Tables and SVG plots of the benchmarks of time against error (`matrix`) and of growth (`growth`).

The tables show times to an error, their ratios, estimated errors, bias and memory.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from lookdev.bench.benchmark import MEGABYTE, Spread, TextTable
from lookdev.bench.growth import Growth
from lookdev.bench.measure import (
    EXACT,
    PICTURES,
    CellRun,
    CurveEffort,
    CurvePoint,
    Measurement,
    PictureKind,
    Ratio,
    Series,
)
from lookdev.bench.options import BenchOptions
from lookdev.cache import atomic_path

BIAS_LIMIT = 5.0
"""A bias is reported if it is larger than this number of its standard errors."""

COLORS = {
    "exact": "C0",
    "principled": "C1",
    "mitsuba-principled": "C2",
    "mitsuba": "C3",
    "nodes": "C4",
    "nodes-exact": "C5",
}
"""The colour of each backend's curves; curves of other backends are black."""

# Letters are stored as text, which is small. With a fixed salt for ids, equal figures are equal files.
_STYLE: Any = {"svg.hashsalt": "lookdev", "svg.fonttype": "none", "font.size": 8.0, "path.simplify": False}
_TITLES = {"mitsuba": "`mitsuba`", "principled": "Blender's Principled", "mitsuba-principled": "Mitsuba's principled"}
_LEGEND = (
    "Seconds of a frame to the relMSE; in brackets the least and the most of the repeats. *takes*: the time of `exact` "
    "over that of the backend before it. *by samples*: the samples that `exact` needs over those of the backend, times "
    "what a sample of `exact` costs more in renders that followed each other. `~`: beyond the most samples, which did "
    "not suffice; `<`: the fewest samples suffice; `-`: not reached. Geometric means are of all ratios but bounds."
)


def cell_blocks(cells: Sequence[CellRun], options: BenchOptions) -> Iterator[str | TextTable]:
    """Yield tables of times to an error, of renders with the most samples and of estimated errors, with headings."""
    if not cells:
        return
    all_series = list(dict.fromkeys(series for cell in cells for series in cell.curves))
    others = list(dict.fromkeys(series.backend for series in all_series if series.backend != EXACT))
    columns = [(f"{_TITLES.get(backend, backend)}, s", "takes", "by samples") for backend in others]
    yield _LEGEND
    for way in PICTURES:
        for target in options.targets:
            if rows := list(_time_rows(cells, others, way, target)):
                yield f"#### {way.capitalize()}, to {target:g}"
                yield TextTable(["", "exact, s", *(column for group in columns for column in group)], rows)
    yield "#### At the most samples"
    yield TextTable(
        ["", *(f"{series}: samples, s, relMSE" for series in all_series)],
        [[str(cell.cell), *(_point_text(cell.curves.get(series)) for series in all_series)] for cell in cells],
    )
    if options.target_estimate is not None and (rows := list(_estimate_rows(cells))):
        yield f"#### Estimates, and frames that end at {options.target_estimate:g}"
        yield (
            "The relMSE that `exact` estimates of a frame, over that against the reference: the median of all frames, "
            "the least and the most. Then frames that are rendered until they estimate "
            f"{options.target_estimate:g}, with at most {options.samples[-1]} samples: seconds, samples, true relMSE."
        )
        head = ("", "raw: estimate over truth", "denoised", "raw: s", "samples", "relMSE")
        yield TextTable((*head, "denoised: s", "samples", "relMSE"), rows)


def _time_rows(cells: Sequence[CellRun], others: Sequence[str], way: PictureKind, target: float) -> Iterator[list[str]]:
    """Yield a row for each cell, then rows with geometric means over the cells of each scene, and over all cells.

    `others` are the backends beside ``exact``, `way` is the kind of picture, and `target` the relMSE.
    """
    cells = [cell for cell in cells if any(series.picture_kind == way for series in cell.curves)]
    for cell in cells:
        row = [str(cell.cell), _seconds_text(cell, Series(EXACT, way), target)]
        for series in (Series(backend, way) for backend in others):
            row += [_seconds_text(cell, series, target), *_ratio_texts(cell.ratio(series, target))]
        yield row
    scenes = list(dict.fromkeys(cell.cell.scene for cell in cells))
    groups = {scene: [cell for cell in cells if cell.cell.scene == scene] for scene in scenes if len(scenes) > 1}
    for name, group in (groups | {"all": cells}).items() if cells and others else ():
        row = [f"geometric mean, {name}", ""]
        for backend in others:
            ratios = [cell.ratio(Series(backend, way), target) for cell in group]
            row += ["", _mean_text([ratio.value if ratio else None for ratio in ratios])]
            row.append(_mean_text([ratio.by_samples if ratio else None for ratio in ratios]))
        yield row


def _mean_text(values: Sequence[CurveEffort | None]) -> str:
    """Return the geometric mean of ratios as text.

    Missing ratios and bounds are left out. If there are any, the text also has the number of ratios in the mean.
    """
    ratios = [value.value for value in values if value is not None and value.mark in ("", "~")]
    if not ratios:
        return "-"
    count = f" ({len(ratios)} of {len(values)})" if len(ratios) < len(values) else ""
    return f"{statistics.geometric_mean(ratios):.2f}{count}"


def _seconds_text(cell: CellRun, series: Series, target: float) -> str:
    """Return the seconds of a series to the relMSE `target`, with the spread of the repeats, as text."""
    times = cell.times(series, target)
    if times.value is None:
        return "-"
    return times.value.mark + Spread(times.value.value, times.low, times.high).text(format_short)


def _ratio_texts(ratio: Ratio | None) -> tuple[str, str]:
    """Return the texts of a ratio by times, with its spread, and by samples."""
    if ratio is None or ratio.value is None:
        return "-", "-"
    by_samples = "-" if ratio.by_samples is None else f"{ratio.by_samples.mark}{ratio.by_samples.value:.2f}"
    spread = Spread(ratio.value.value, ratio.low, ratio.high)
    return ratio.value.mark + spread.text(format_short, f"{spread.middle:.2f}"), by_samples


def _point_text(curve: Sequence[CurvePoint] | None) -> str:
    """Return the samples, seconds and relMSE of the last point of a curve as text."""
    if not curve:
        return "-"
    error = "uncertain" if curve[-1].relmse is None else f"{curve[-1].relmse:.2e}"
    return f"{curve[-1].samples}, {format_short(curve[-1].seconds)}, {error}"


def _estimate_rows(cells: Sequence[CellRun]) -> Iterator[list[str]]:
    """Yield a row for each cell that ``exact`` has rendered, then a row for all cells.

    A row has the ratios of estimated to true error, and the figures of aimed frames (see `PictureKind`).
    """
    rows_of_all: Mapping[PictureKind, list[Measurement]] = {way: [] for way in PICTURES}
    for cell in cells:
        if cell.measurements_of(Series(EXACT)):
            row = [str(cell.cell)]
            for way in PICTURES:
                row.append(_estimate_ratio_text(cell.measurements_of(Series(EXACT, way))))
                rows_of_all[way].extend(cell.measurements_of(Series(EXACT, way)))
            yield [
                *row,
                *_aimed_texts(cell.measurements_of(Series(EXACT, "aimed"))),
                *_aimed_texts(cell.measurements_of(Series(EXACT, "aimed, denoised"))),
            ]
    if any(rows_of_all.values()):
        yield ["all", *map(_estimate_ratio_text, rows_of_all.values()), *[""] * 6]


def _estimate_ratio_text(rows: Sequence[Measurement]) -> str:
    """Return the median ratio of estimated to true relMSE, with its extremes, as text."""
    ratios = [row.estimate / row.relmse for row in rows if row.estimate is not None and row.relmse]
    return Spread.of(ratios).text() if ratios else "-"


def _aimed_texts(rows: Sequence[Measurement]) -> tuple[str, str, str]:
    """Return the seconds, samples and true relMSE of aimed frames as texts."""
    if not rows:
        return "-", "-", "-"
    errors = [row.relmse for row in rows if row.relmse is not None]
    error = f"{statistics.median(errors):.2e}" if errors else "uncertain"
    samples = f"{statistics.median(row.samples for row in rows):.0f}"
    return Spread.of([row.seconds for row in rows]).text(format_short), samples, error


def growth_blocks(growth: Sequence[Growth]) -> Iterator[str | TextTable]:
    """Yield a heading and a table for each quantity; a table has a row for each size."""
    for name in dict.fromkeys(result.quantity for result in growth):
        group = [result for result in growth if result.quantity == name]
        rows: dict[int, list[str]] = {
            size: [] for size in sorted({row.size for result in group for row in result.rows})
        }
        for result in group:
            by_size = {row.size: row for row in result.rows}
            for size, texts in rows.items():
                row = by_size.get(size)
                seconds = "-" if row is None else Spread(row.seconds, row.low, row.high).text(format_short)
                texts += [seconds, "-" if row is None else f"{row.memory / MEGABYTE:.0f}"]
        head = [name, *(column for result in group for column in (f"{result.backend}, s a frame", "MB"))]
        yield f"#### Growth with {name}"
        yield TextTable(head, [[f"{size:,}", *texts] for size, texts in rows.items()])


def bias_and_memory(cells: Sequence[CellRun]) -> TextTable:
    """Return a table with the bias at the most samples and the peak memory, for each series of each cell."""
    rows = []
    for cell in cells:
        for series, curve in cell.curves.items():
            if curve:
                memory = max(row.memory for row in cell.measurements_of(series))
                bias = f"{100.0 * curve[-1].bias:+.2f}±{100.0 * curve[-1].bias_error:.2f}"
                rows.append([f"{cell.cell}: {series}", bias, f"{memory / MEGABYTE:.0f}"])
    return TextTable(("", "bias, %", "MB"), rows)


def bias_warnings(cells: Sequence[CellRun]) -> list[str]:
    """Return a message for each point of a raw curve whose bias exceeds `BIAS_LIMIT` standard errors."""
    return [
        f"{result.cell}: {series} with {point.samples} samples is off by {point.bias:+.2%}, "
        f"{abs(point.bias) / point.bias_error:.1f} standard errors: biased, or the cached reference is of another "
        "picture; --fresh makes a new one"
        for result in cells
        for series, curve in result.curves.items()
        if series.picture_kind == "raw"  # denoised pictures are biased in any case
        for point in curve
        if abs(point.bias) > BIAS_LIMIT * point.bias_error
    ]


def skip_lines(cells: Sequence[CellRun]) -> list[str]:
    """Return lines with the `Candidate.skips` of each backend; cells with the same skips share a line."""
    names: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for result in cells:
        for key in result.skips.items():
            names.setdefault(key, []).append(str(result.cell))
    return [
        f"{backend} skips {', '.join(skips)}: {'; '.join(cells)}" for (backend, skips), cells in names.items() if skips
    ]


def format_short(value: float) -> str:
    """Return a number as text with about three significant digits and no exponent."""
    digits = max(0, 2 - math.floor(math.log10(value))) if value > 0.0 else 0
    return f"{value:.{min(digits, 4)}f}"


def draw_curves(cells: Sequence[CellRun], targets: Sequence[float], folder: Path, prefix: str) -> list[Path]:
    """Draw relMSE over seconds, and return the files: an SVG for each look, with a panel for each scene and light."""
    files = []
    for look in dict.fromkeys(result.cell.look for result in cells):
        group = [result for result in cells if result.cell.look == look]
        columns = len({result.cell.ibl for result in group})
        files.append(folder / f"{prefix}{look}.svg")
        with _draw_panels(files[-1], f"{look}: relMSE over seconds of a frame", len(group), columns) as panels:
            for axes, result in zip(panels, group, strict=True):
                _draw_cell(axes, result, targets)
    return files


def _draw_cell(axes: Any, result: CellRun, targets: Sequence[float]) -> None:
    """Draw the curves of a cell and horizontal lines at the target errors; curves of denoised pictures are dashed."""
    for series, curve in result.curves.items():
        if points := [(point.seconds, point.relmse) for point in curve if point.relmse is not None]:
            style = {"markersize": 3.0, "color": COLORS.get(series.backend, "black"), "label": str(series)}
            axes.plot(*zip(*points, strict=True), "o-" if series.picture_kind == "raw" else "o--", **style)
    for target in targets:
        axes.axhline(target, color="0.7", linewidth=0.8)
    title = f"{result.cell.scene}, {result.cell.ibl}"
    axes.set(title=title, xlabel="seconds", ylabel="relMSE", xscale="log", yscale="log")
    _mark_round_numbers(axes.xaxis)
    _mark_round_numbers(axes.yaxis)


def draw_growth(growth: Sequence[Growth], file: Path) -> Path:
    """Draw the seconds of a frame over its size, with a panel for each quantity; return `file`."""
    quantities = list(dict.fromkeys(result.quantity for result in growth))
    with _draw_panels(file, "seconds of a frame", len(quantities), 3) as panels:
        for axes, quantity in zip(panels, quantities, strict=True):
            for result in (result for result in growth if result.quantity == quantity):
                sizes, seconds = [row.size for row in result.rows], [row.seconds for row in result.rows]
                spread = zip(*((row.seconds - row.low, row.high - row.seconds) for row in result.rows), strict=True)
                style: dict[str, Any] = {"fmt": "o-", "markersize": 3.0, "color": COLORS.get(result.backend, "black")}
                axes.errorbar(sizes, seconds, list(spread), label=result.backend, **style)
            axes.set(xlabel=quantity, ylabel="seconds", xscale="linear" if quantity == "frames" else "log")
            axes.set_xticks(sizes, [f"{size:,}" for size in sizes], minor=False)
            axes.xaxis.set_minor_locator(NullLocator())
            if quantity == "pixels":  # seconds grow in proportion to pixels, a straight line in logarithms
                axes.set_yscale("log")
                _mark_round_numbers(axes.yaxis)
            else:
                axes.set_ylim(bottom=0.0)
    return file


@contextmanager
def _draw_panels(file: Path, title: str, count: int, columns: int) -> Iterator[list[Any]]:
    """Yield `count` panels of a new figure, then write it to `file`, with one legend for the curves of all panels."""
    columns = min(columns, count)
    rows = math.ceil(count / columns)
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(3.4 * columns, 2.6 * rows + 0.5), layout="constrained")
        figure.suptitle(title)
        panels = list(figure.subplots(rows, columns, squeeze=False).ravel())
    yield panels[:count]
    for number, axes in enumerate(panels):
        axes.grid(alpha=0.3)
        axes.set_visible(number < count)
    pairs = (pair for axes in panels for pair in zip(*axes.get_legend_handles_labels(), strict=True))
    if handles := {label: handle for handle, label in pairs}:
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3, frameon=False)
    with mpl.rc_context(_STYLE), atomic_path(file) as path:
        figure.savefig(path, format="svg", metadata={"Date": None})


def _mark_round_numbers(axis: Any) -> None:
    """Label a logarithmic axis at few round numbers: powers of ten, and on a short axis also their multiples."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0,) if high > 100.0 * low else (1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
