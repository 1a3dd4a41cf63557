"""Time to an error: a measured curve of error over time, read off on the log-log plot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

REACH = 4.0
"""How far beyond the last measured point a curve is continued, as a factor of its time (or samples)."""

Mark = Literal["", "~", "<", ">"]


@dataclass(frozen=True)
class Reached:
    """Where a curve meets an error, or a ratio of two such places.

    `mark` is "" within the measured range, "~" where the curve was continued, "<" or ">" where the value is only a
    bound: the curve's first point is good enough already.
    """

    value: float
    mark: Mark = ""

    def __str__(self) -> str:
        return f"{self.mark}{self.value:.3g}"


def reach(effort: Sequence[float], error: Sequence[float], target: float) -> Reached | None:
    """Return the effort (seconds, or samples) at which a curve first meets `target`.

    Parameters
    ----------
    effort, error
        Points of the curve by growing samples, positive; piecewise linear on the log-log plot.
    target
        The error to reach.

    Returns
    -------
    Reached or None
        None where the curve does not get there within `REACH` times its last point, continued by the slope of its
        last two.
    """
    if not error:
        return None
    if error[0] <= target:
        return Reached(effort[0], "" if error[0] == target else "<")
    points = list(zip(effort, error, strict=True))
    for start, end in pairwise(points):
        if end[1] <= target:
            return Reached(_along(start, end, target))
    if len(points) < 2 or not (error[-1] < error[-2] and effort[-1] > effort[-2]):
        return None
    value = _along(points[-2], points[-1], target)
    return Reached(value, "~") if value <= REACH * effort[-1] else None


def ratio(one: Reached | None, other: Reached | None) -> Reached | None:
    """Divide where one curve meets an error by where the other does; None where there is no such ratio."""
    if one is None or other is None:
        return None
    value = one.value / other.value
    if one.mark == "<":
        return None if other.mark == "<" else Reached(value, "<")
    if other.mark == "<":
        return Reached(value, ">")
    return Reached(value, "~" if "~" in (one.mark, other.mark) else "")


def at(effort: Sequence[float], error: Sequence[float], where: float) -> float:
    """Return the error at an effort: between points, or beyond them by the slope of the nearest two.

    There must be two points or more.
    """
    points = list(zip(effort, error, strict=True))
    for start, end in pairwise(points):
        if where <= end[0] or end == points[-1]:
            slope = math.log(end[1] / start[1]) / math.log(end[0] / start[0])
            return start[1] * math.exp(slope * math.log(where / start[0]))
    raise ValueError("a curve has two points or more")


def _along(start: tuple[float, float], end: tuple[float, float], target: float) -> float:
    """Return the effort at which the straight line through two points, on the log-log plot, meets `target`."""
    share = math.log(start[1] / target) / math.log(start[1] / end[1])
    return start[0] * math.exp(share * math.log(end[0] / start[0]))
