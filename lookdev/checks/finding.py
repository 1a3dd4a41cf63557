"""What a check found, as plain data: every check makes these, `lookdev.checks.report` shows them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Series:
    """One curve of a plot, or with `low` and `high` its confidence band.

    Parameters
    ----------
    name
        What the legend calls it.
    x, y
        Abscissae and values, shape (N,).
    low, high
        The band's bounds, shape (N,); both or neither.
    style
        "line", "points" (markers, with the band as error bars) or "bars" (a histogram: x are the N + 1 edges).
    """

    name: str
    x: Array
    y: Array
    low: Array | None = None
    high: Array | None = None
    style: str = "line"


@dataclass(frozen=True, eq=False)
class Picture:
    """One image of a plot.

    Parameters
    ----------
    name
        Its caption.
    pixels
        Shape (H, W, 3) for display-referred colours in [0, 1], or (H, W) for values drawn with a colour bar.
    low, high
        The values at both ends of the colour bar; of (H, W) only.
    """

    name: str
    pixels: Array
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, eq=False)
class Plot:
    """A figure of the report: curves over one pair of axes, or images side by side.

    Parameters
    ----------
    title
        Its heading.
    x_label, y_label
        Axis labels with units; of curves only.
    series
        The curves.
    pictures
        The images, drawn in a row; a plot has series or pictures.
    log_y
        A logarithmic y axis.
    """

    title: str
    x_label: str = ""
    y_label: str = ""
    series: tuple[Series, ...] = ()
    pictures: tuple[Picture, ...] = ()
    log_y: bool = False


@dataclass(frozen=True, eq=False)
class Finding:
    """The result of one check of one subject.

    Parameters
    ----------
    check
        "points", "albedo", "image" or "stability".
    subject
        What was checked: a look, a model, or a look and a light.
    passed
        Whether the two sides agree; True where the check was skipped.
    summary
        One line with the figures.
    figures
        The same figures by name, for machines.
    details
        The worst cases, one a line, each of which can be replayed.
    plots
        What the report draws.
    skipped
        Why the check, or a part of it, was not run; empty when all of it was.
    """

    check: str
    subject: str
    passed: bool
    summary: str
    figures: dict[str, float] = field(default_factory=dict)
    details: tuple[str, ...] = ()
    plots: tuple[Plot, ...] = ()
    skipped: str = ""

    @property
    def headline(self) -> str:
        """One line: what was checked, and whether it agrees."""
        return f"{self.check}: {self.subject}: {'agrees' if self.passed else 'DISAGREES'}"
