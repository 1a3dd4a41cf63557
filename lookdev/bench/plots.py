"""Measurements as plots: small SVGs, the same for the same figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from lookdev.bench.growth import Growth
from lookdev.bench.measure import CellResult
from lookdev.cache import atomic_path

COLORS = {
    "exact": "C0",
    "principled": "C1",
    "mitsuba-principled": "C2",
    "mitsuba": "C3",
    "nodes": "C4",
    "nodes-exact": "C5",
}
"""Of the backends' curves; another backend's are black."""

# Text stays text, which is small, and the names of elements do not change from run to run.
_STYLE: Any = {"svg.hashsalt": "lookdev", "svg.fonttype": "none", "font.size": 8.0, "path.simplify": False}


def draw_curves(cells: Sequence[CellResult], targets: Sequence[float], folder: Path, prefix: str) -> list[Path]:
    """Draw relMSE over seconds, an SVG for each look, a panel for each scene and light; return the files."""
    files = []
    for look in dict.fromkeys(result.cell.look for result in cells):
        mine = [result for result in cells if result.cell.look == look]
        columns = len({result.cell.ibl for result in mine})
        figure, panels = _panels(f"{look}: relMSE over seconds of a frame", len(mine), columns)
        for axes, result in zip(panels, mine, strict=True):
            _draw_cell(axes, result, targets)
        files.append(_save(figure, panels, folder / f"{prefix}{look}.svg"))
    return files


def draw_growth(growth: Sequence[Growth], file: Path) -> Path:
    """Draw seconds of a frame over what it grows with, a panel for each quantity; return the file."""
    quantities = list(dict.fromkeys(each.of for each in growth))
    figure, panels = _panels("seconds of a frame", len(quantities), 3)
    for axes, of in zip(panels, quantities, strict=True):
        mine = [each for each in growth if each.of == of]
        sizes = [row.size for row in mine[0].rows]
        for each in mine:
            seconds = [row.seconds for row in each.rows]
            spread = [[row.seconds - row.low for row in each.rows], [row.high - row.seconds for row in each.rows]]
            style: dict[str, Any] = {"fmt": "o-", "markersize": 3.0, **_color(each.backend)}
            axes.errorbar([row.size for row in each.rows], seconds, spread, label=each.backend, **style)
        axes.set(xlabel=of, ylabel="seconds", xscale="linear" if of == "frames" else "log")
        axes.set_xticks(sizes, [f"{size:,}" for size in sizes], minor=False)
        axes.xaxis.set_minor_locator(NullLocator())
        if of == "pixels":  # in proportion to which seconds grow
            axes.set_yscale("log")
            _rule(axes.yaxis)
        else:
            axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3)
    return _save(figure, panels, file)


def _draw_cell(axes: Any, result: CellResult, targets: Sequence[float]) -> None:
    for series, curve in result.curves.items():
        known = [(point.seconds, point.relmse) for point in curve if point.relmse is not None]
        if known:
            line = "o-" if series.way == "raw" else "o--"
            axes.plot(*zip(*known, strict=True), line, markersize=3.0, label=str(series), **_color(series.backend))
    for target in targets:
        axes.axhline(target, color="0.7", linewidth=0.8)
    title = f"{result.cell.scene}, {result.cell.ibl}"
    axes.set(title=title, xlabel="seconds", ylabel="relMSE", xscale="log", yscale="log")
    _rule(axes.xaxis)
    _rule(axes.yaxis)
    axes.grid(alpha=0.3)


def _rule(axis: Any) -> None:
    """Mark few round numbers on a logarithmic axis."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0,) if high > 100.0 * low else (1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def _color(backend: str) -> dict[str, str]:
    return {"color": COLORS.get(backend, "black")}


def _panels(title: str, count: int, columns: int) -> tuple[Figure, list[Any]]:
    columns = min(columns, count)
    rows = math.ceil(count / columns)
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(3.4 * columns, 2.6 * rows + 0.5), layout="constrained")
        figure.suptitle(title)
        return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())[:count]


def _save(figure: Figure, panels: Sequence[Any], file: Path) -> Path:
    for axes in set(figure.axes) - set(panels):
        axes.set_visible(False)
    # One legend for all panels, whose curves have the same names.
    named = {label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    if named:
        figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=3, frameon=False)
    with mpl.rc_context(_STYLE), atomic_path(file) as path:
        figure.savefig(path, format="svg", metadata={"Date": None})
    return file
