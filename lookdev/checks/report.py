"""Findings as a table in a terminal and as one self-contained HTML page."""

from __future__ import annotations

import base64
import html
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

from lookdev.cache import atomic_path
from lookdev.checks.finding import Finding, Picture, Plot, Series
from lookdev.errors import printable

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; vertical-align: top; padding: .35rem .7rem .35rem 0; border-bottom: 1px solid #ddd; }
.agrees { color: #186a3b; } .disagrees { color: #b03a2e; font-weight: bold; } .skipped { color: #666; }
img { max-width: 100%; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; background: #f5f5f5; padding: .6rem; font-size: 12px; }
"""


def print_findings(findings: Sequence[Finding], console: Console) -> None:
    """Print a table, then the worst cases of what disagrees, an unbroken line each."""
    table = Table(box=box.SIMPLE_HEAD)
    for column in ("check", "of", "", "figures"):
        table.add_column(column, overflow="fold")
    for finding in findings:
        result = Text(_result(finding), style="green" if finding.passed else "bold red")
        table.add_row(finding.check, Text(printable(finding.subject)), result, Text(printable(_words(finding))))
    console.print(table)
    for finding in findings:
        if not finding.passed and finding.details:
            console.print(Text(printable(f"{finding.check} of {finding.subject}, worst first:"), style="bold"))
            for line in finding.details:
                console.print(Text(printable(line)), soft_wrap=True)


def verdict(findings: Sequence[Finding]) -> str:
    """Return one line with the result of all."""
    bad = sum(not finding.passed for finding in findings)
    return f"{bad} of {len(findings)} checks disagree" if bad else f"all {len(findings)} checks agree"


def write_html(findings: Sequence[Finding], file: Path, title: str) -> None:
    """Write a page with all figures, worst cases and plots, which loads and runs nothing; OSError where that fails."""
    rows = "".join(
        f'<tr><td>{_text(each.check)}</td><td><a href="#finding{number}">{_text(each.subject)}</a></td>'
        f"<td>{_badge(each)}</td><td>{_text(_words(each))}</td></tr>\n"
        for number, each in enumerate(findings)
    )
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        # A browser loads nothing, whatever names and plots contain.
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
        "style-src 'unsafe-inline'\">\n"
        f"<title>{_text(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n<h1>{_text(title)}</h1>\n"
        f"<p>{_text(verdict(findings))}.</p>\n"
        f"<table>\n<tr><th>check</th><th>of</th><th></th><th>figures</th></tr>\n{rows}</table>\n"
        + "".join(_section(number, each) for number, each in enumerate(findings))
        + "</body>\n</html>\n"
    )
    with atomic_path(file) as path:
        path.write_text(page, encoding="utf-8")


def _result(finding: Finding) -> str:
    return "agrees" if finding.passed else "DISAGREES"


def _words(finding: Finding) -> str:
    if not finding.skipped:
        return finding.summary
    return f"{finding.summary}; skipped: {finding.skipped}" if finding.summary else f"skipped: {finding.skipped}"


def _text(text: str) -> str:
    return html.escape(printable(text))


def _badge(finding: Finding) -> str:
    return f'<span class="{_result(finding).lower()}">{_result(finding)}</span>'


def _section(number: int, finding: Finding) -> str:
    parts = [
        f'<h2 id="finding{number}">{_text(finding.check)}: {_text(finding.subject)}</h2>',
        f"<p>{_badge(finding)}: {_text(_words(finding))}</p>",
    ]
    for plot in finding.plots:
        image = base64.b64encode(draw_svg(plot)).decode("ascii")
        parts.append(f'<p><img alt="{_text(plot.title)}" src="data:image/svg+xml;base64,{image}"></p>')
    if finding.details:
        lines = "\n".join(map(_text, finding.details))
        shown = "" if finding.passed else " open"
        parts.append(f"<details{shown}><summary>Worst cases</summary><pre>{lines}</pre></details>")
    return "\n".join(parts) + "\n"


def draw_svg(plot: Plot) -> bytes:
    """Draw a plot as an SVG document."""
    with mpl.rc_context({"svg.hashsalt": "lookdev", "font.size": 9.0}):
        figure = Figure(figsize=(7.2, 3.4), layout="constrained")
        figure.suptitle(_plain(plot.title))
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


def _plain(text: str) -> str:
    # Matplotlib reads text after a dollar sign as mathematics.
    return printable(text).replace("$", r"\$")


def _draw_picture(figure: Figure, axes: Any, picture: Picture) -> None:
    shown = axes.imshow(picture.pixels, vmin=picture.low, vmax=picture.high, interpolation="nearest")
    axes.set_title(_plain(picture.name))
    axes.set_axis_off()
    if picture.pixels.ndim == 2:
        figure.colorbar(shown, ax=axes, shrink=0.8)


def _draw_series(axes: Any, plot: Plot) -> None:
    for number, series in enumerate(plot.series):
        _draw_one(axes, series, f"C{number}")
    axes.set_xlabel(_plain(plot.x_label))
    axes.set_ylabel(_plain(plot.y_label))
    if plot.log_y:
        axes.set_yscale("log")
    axes.grid(alpha=0.3)
    if plot.series:
        axes.legend(frameon=False, fontsize=8.0)


def _draw_one(axes: Any, series: Series, color: str) -> None:
    label = _plain(series.name)
    band = None if series.low is None or series.high is None else (series.low, series.high)
    if series.style == "bars":
        axes.stairs(series.y, series.x, label=label, color=color, fill=True, alpha=0.5)
    elif series.style == "points":
        around = (series.y - band[0], band[1] - series.y) if band else None
        axes.errorbar(series.x, series.y, around, label=label, color=color, fmt="o", markersize=3.0, capsize=2.0)
    else:
        axes.plot(series.x, series.y, label=label, color=color)
        if band:
            axes.fill_between(series.x, *band, color=color, alpha=0.25, linewidth=0.0)
