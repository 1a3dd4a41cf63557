"""Findings, which are the results of checks: plain data that `lookdev.checks.report` prints, and writes as HTML."""

from __future__ import annotations

from dataclasses import dataclass, field

from lookdev.arrays import Floats


@dataclass(frozen=True, eq=False)
class PlotCurve:
    """One curve of a plot. All arrays have the shape (N,); with the style "bars", x has the shape (N + 1,)."""

    name: str  # in the legend
    x: Floats
    y: Floats
    low: Floats | None = None  # the confidence band is from `low` to `high`; if they are None, there is no band
    high: Floats | None = None
    # "line"; "points" with the band as error bars; or "bars", a histogram of heights `y` whose bins have the edges `x`.
    style: str = "line"


@dataclass(frozen=True, eq=False)
class PlotImage:
    """One image of a plot: display-referred colours (H, W, 3) in [0, 1], or values (H, W) with a colour bar."""

    name: str  # the caption
    pixels: Floats
    low: float | None = None  # the values at the ends of the colour bar; None takes them from the pixels
    high: float | None = None


@dataclass(frozen=True, eq=False)
class FindingPlot:
    """A figure of the report: curves over one pair of axes, or images side by side."""

    title: str
    x_label: str = ""  # with its unit
    y_label: str = ""
    series: tuple[PlotCurve, ...] = ()
    pictures: tuple[PlotImage, ...] = ()
    log_y: bool = False


@dataclass(frozen=True, eq=False)
class CheckFinding:
    """The result of one check of one subject: a look, a model, or a look and a light."""

    check: str  # "points", "albedo", "image" or "stability"
    subject: str
    passed: bool  # the two sides agree, or the check was skipped
    summary: str  # one line with the figures
    figures: dict[str, float] = field(default_factory=dict)
    details: tuple[str, ...] = ()  # the worst cases, one a line; `lookdev eval` reads lines of "points" and "stability"
    plots: tuple[FindingPlot, ...] = ()
    skipped: str = ""  # the reason why the check, or a part of it, was not run

    @property
    def result(self) -> str:
        """A word for the report: "agrees" if the check passed, else "DISAGREES"."""
        return "agrees" if self.passed else "DISAGREES"

    @property
    def headline(self) -> str:
        """One line with the check, the subject, and whether it agrees."""
        return f"{self.check}: {self.subject}: {self.result}"
