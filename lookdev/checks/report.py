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
from lookdev.errors import replace_controls

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; vertical-align: top; padding: .35rem .7rem .35rem 0; border-bottom: 1px solid #ddd; }
.agrees { color: #186a3b; } .disagrees { color: #b03a2e; font-weight: bold; } .skipped { color: #666; }
img { max-width: 100%; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; background: #f5f5f5; padding: .6rem; font-size: 12px; }
"""


def print_findings(findings: Sequence[Finding], console: Console) -> None:
    """Print findings as a table, then the worst cases of those that disagree, each as an unbroken line."""
    table = Table(box=box.SIMPLE_HEAD)
    for column in ("check", "of", "", "figures"):
        table.add_column(column, overflow="fold")
    for finding in findings:
        result = Text(_result(finding), style="green" if finding.passed else "bold red")
        table.add_row(
            finding.check, Text(replace_controls(finding.subject)), result, Text(replace_controls(_summary(finding)))
        )
    console.print(table)
    for finding in findings:
        if not finding.passed and finding.details:
            console.print(Text(replace_controls(f"{finding.check} of {finding.subject}, worst first:"), style="bold"))
            for line in finding.details:
                console.print(Text(replace_controls(line)), soft_wrap=True)


def verdict(findings: Sequence[Finding]) -> str:
    """Return one line with the result of all findings."""
    bad = sum(not finding.passed for finding in findings)
    return f"{bad} of {len(findings)} checks disagree" if bad else f"all {len(findings)} checks agree"


def write_html(findings: Sequence[Finding], file: Path, title: str) -> None:
    """Write an HTML page with all figures, worst cases and plots. It loads no files and runs no scripts."""
    rows = "".join(
        f'<tr><td>{_escape(finding.check)}</td><td><a href="#finding{number}">{_escape(finding.subject)}</a></td>'
        f"<td>{_badge(finding)}</td><td>{_escape(_summary(finding))}</td></tr>\n"
        for number, finding in enumerate(findings)
    )
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        # A browser loads nothing, whatever names and plots contain.
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
        "style-src 'unsafe-inline'\">\n"
        f"<title>{_escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n<h1>{_escape(title)}</h1>\n"
        f"<p>{_escape(verdict(findings))}.</p>\n"
        f"<table>\n<tr><th>check</th><th>of</th><th></th><th>figures</th></tr>\n{rows}</table>\n"
        + "".join(_format_section(number, finding) for number, finding in enumerate(findings))
        + "</body>\n</html>\n"
    )
    with atomic_path(file) as path:
        path.write_text(page, encoding="utf-8")


def _result(finding: Finding) -> str:
    return "agrees" if finding.passed else "DISAGREES"


def _summary(finding: Finding) -> str:
    if not finding.skipped:
        return finding.summary
    return f"{finding.summary}; skipped: {finding.skipped}" if finding.summary else f"skipped: {finding.skipped}"


def _escape(text: str) -> str:
    return html.escape(replace_controls(text))


def _badge(finding: Finding) -> str:
    return f'<span class="{_result(finding).lower()}">{_result(finding)}</span>'


def _format_section(number: int, finding: Finding) -> str:
    parts = [
        f'<h2 id="finding{number}">{_escape(finding.check)}: {_escape(finding.subject)}</h2>',
        f"<p>{_badge(finding)}: {_escape(_summary(finding))}</p>",
    ]
    for plot in finding.plots:
        image = base64.b64encode(draw_svg(plot)).decode("ascii")
        parts.append(f'<p><img alt="{_escape(plot.title)}" src="data:image/svg+xml;base64,{image}"></p>')
    if finding.details:
        lines = "\n".join(map(_escape, finding.details))
        open_attribute = "" if finding.passed else " open"
        parts.append(f"<details{open_attribute}><summary>Worst cases</summary><pre>{lines}</pre></details>")
    return "\n".join(parts) + "\n"


def draw_svg(plot: Plot) -> bytes:
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
    # Matplotlib reads text after a dollar sign as mathematics.
    return replace_controls(text).replace("$", r"\$")


def _draw_picture(figure: Figure, axes: Any, picture: Picture) -> None:
    image = axes.imshow(picture.pixels, vmin=picture.low, vmax=picture.high, interpolation="nearest")
    axes.set_title(_escape_dollars(picture.name))
    axes.set_axis_off()
    if picture.pixels.ndim == 2:
        figure.colorbar(image, ax=axes, shrink=0.8)


def _draw_series(axes: Any, plot: Plot) -> None:
    for number, series in enumerate(plot.series):
        _draw_curve(axes, series, f"C{number}")
    axes.set_xlabel(_escape_dollars(plot.x_label))
    axes.set_ylabel(_escape_dollars(plot.y_label))
    if plot.log_y:
        axes.set_yscale("log")
    axes.grid(alpha=0.3)
    if plot.series:
        axes.legend(frameon=False, fontsize=8.0)


def _draw_curve(axes: Any, series: Series, color: str) -> None:
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
