"""Shows the findings of `lookdev check`: as a table in the terminal, and as one self-contained HTML page."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lookdev.checks.finding import CheckFinding, FindingPlot, PlotCurve, PlotImage
from lookdev.errors import replace_controls
from lookdev.html_page import write_html_page


def print_findings(findings: Sequence[CheckFinding], console: Console) -> None:
    """Print findings as a table, then the worst cases of each finding that disagrees, each case as an unbroken line."""
    table = Table(box=box.SIMPLE_HEAD)
    for column in ("check", "of", "", "figures"):
        table.add_column(column, overflow="fold")
    for finding in findings:
        result = Text(finding.result, style="green" if finding.passed else "bold red")
        table.add_row(
            finding.check, Text(replace_controls(finding.subject)), result, Text(replace_controls(_summary(finding)))
        )
    console.print(table)
    for finding in findings:
        if not finding.passed and finding.details:
            console.print(Text(replace_controls(f"{finding.check} of {finding.subject}, worst first:"), style="bold"))
            for line in finding.details:
                console.print(Text(replace_controls(line)), soft_wrap=True)


def verdict(findings: Sequence[CheckFinding]) -> str:
    """Return one line with the result of all findings."""
    bad = sum(not finding.passed for finding in findings)
    return f"{bad} of {len(findings)} checks disagree" if bad else f"all {len(findings)} checks agree"


def write_html(findings: Sequence[CheckFinding], file: Path, title: str) -> None:
    """Write an HTML page with all figures, worst cases and plots. It loads no files and runs no scripts."""
    template = Path(__file__).with_suffix(".html")
    write_html_page(file, template, title, findings=findings, verdict=verdict, summary=_summary, draw_svg=draw_svg)


def _summary(finding: CheckFinding) -> str:
    """Return the summary of a finding, with the reason why the check or a part of it was skipped."""
    if not finding.skipped:
        return finding.summary
    return f"{finding.summary}; skipped: {finding.skipped}" if finding.summary else f"skipped: {finding.skipped}"


def draw_svg(plot: FindingPlot) -> bytes:
    """Draw a plot as an SVG document."""
    with mpl.rc_context({"svg.hashsalt": "lookdev", "font.size": 9.0}):
        figure = Figure(figsize=(7.2, 3.4), layout="constrained")
        figure.suptitle(_escape_dollars(plot.title))
        if plot.pictures:
            row = figure.subplots(1, len(plot.pictures), squeeze=False)[0]
            for axes, picture in zip(row, plot.pictures, strict=True):
                _draw_picture(figure, axes, picture)
        else:
            _draw_series(figure.add_subplot(), plot)
        buffer = io.BytesIO()
        # Without a date, equal findings give equal files.
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def _escape_dollars(text: str) -> str:
    """Return text for a plot, with escaped dollar signs: Matplotlib would read text after them as mathematics."""
    return replace_controls(text).replace("$", r"\$")


def _draw_picture(figure: Figure, axes: Any, picture: PlotImage) -> None:
    image = axes.imshow(picture.pixels, vmin=picture.low, vmax=picture.high, interpolation="nearest")
    axes.set_title(_escape_dollars(picture.name))
    axes.set_axis_off()
    if picture.pixels.ndim == 2:
        figure.colorbar(image, ax=axes, shrink=0.8)


def _draw_series(axes: Any, plot: FindingPlot) -> None:
    for number, series in enumerate(plot.series):
        _draw_curve(axes, series, f"C{number}")
    axes.set_xlabel(_escape_dollars(plot.x_label))
    axes.set_ylabel(_escape_dollars(plot.y_label))
    if plot.log_y:
        axes.set_yscale("log")
    axes.grid(alpha=0.3)
    if plot.series:
        axes.legend(frameon=False, fontsize=8.0)


def _draw_curve(axes: Any, series: PlotCurve, color: str) -> None:
    label = _escape_dollars(series.name)
    band = None if series.low is None or series.high is None else (series.low, series.high)
    if series.style == "bars":
        axes.stairs(series.y, series.x, label=label, color=color, fill=True, alpha=0.5)
    elif series.style == "points":
        bars = (series.y - band[0], band[1] - series.y) if band else None
        axes.errorbar(series.x, series.y, bars, label=label, color=color, fmt="o", markersize=3.0, capsize=2.0)
    else:
        axes.plot(series.x, series.y, label=label, color=color)
        if band:
            axes.fill_between(series.x, *band, color=color, alpha=0.25, linewidth=0.0)
