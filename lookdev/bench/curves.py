"""Time to an error, interpolated on a measured curve of error over time, linear in logarithms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

REACH = 4.0
"""The limit of extrapolation, as a factor of the last effort."""

Mark = Literal["", "~", "<", ">"]


@dataclass(frozen=True)
class Reached:
    """The effort at which a curve reaches an error, or a ratio of two such efforts.

    `mark` is "" within the measured range, "~" where the curve was extrapolated, "<" or ">" where the value is a bound,
    because the first point of a curve is below the error.
    """

    value: float
    mark: Mark = ""

    def __str__(self) -> str:
        return f"{self.mark}{self.value:.3g}"


def reach(
    effort: Sequence[float],
    error: Sequence[float],
    target: float,
    *,
    limit: float | None = REACH,
    slopes: tuple[float, float] = (0.0, math.inf),
) -> Reached | None:
    """Return the effort (seconds, or samples) at which a curve first reaches an error `target`.

    `effort` and `error` are its points by increasing samples, positive. Beyond them the curve falls, in logarithms, by
    the slope of its last two points, within `slopes`: 1 is that of independent samples. None where it does not fall, or
    does not reach the target within `limit` times its last effort.
    """
    if not error:
        return None
    if error[0] <= target:
        return Reached(effort[0], "" if error[0] == target else "<")
    points = list(zip(effort, error, strict=True))
    for start, end in pairwise(points):
        if end[1] <= target:
            return Reached(_along(start, end, target))
    slope = _slope(points[-2], points[-1]) if len(points) > 1 and effort[-1] > effort[-2] else 0.0
    slope = min(max(slope, slopes[0]), slopes[1])
    if slope <= 0.0:
        return None
    value = effort[-1] * (error[-1] / target) ** (1.0 / slope)
    return Reached(value, "~") if limit is None or value <= limit * effort[-1] else None


def ratio(one: Reached | None, other: Reached | None) -> Reached | None:
    """Return one effort over another; None where one is missing or both are bounds."""
    if one is None or other is None:
        return None
    value = one.value / other.value
    if one.mark == "<":
        return None if other.mark == "<" else Reached(value, "<")
    if other.mark == "<":
        return Reached(value, ">")
    return Reached(value, "~" if "~" in (one.mark, other.mark) else "")


def at(effort: Sequence[float], error: Sequence[float], where: float) -> float:
    """Return the error at an effort, interpolated between points, of which there are at least two, or extrapolated."""
    points = list(zip(effort, error, strict=True))
    for start, end in pairwise(points):
        if where <= end[0] or end == points[-1]:
            slope = math.log(end[1] / start[1]) / math.log(end[0] / start[0])
            return start[1] * math.exp(slope * math.log(where / start[0]))
    raise ValueError("a curve has two points or more")


def _slope(start: tuple[float, float], end: tuple[float, float]) -> float:
    """Return how fast the error falls between two points, in logarithms."""
    return math.log(start[1] / end[1]) / math.log(end[0] / start[0])


def _along(start: tuple[float, float], end: tuple[float, float], target: float) -> float:
    """Return the effort at which the line through two points, in logarithms, has the error `target`."""
    share = math.log(start[1] / target) / math.log(start[1] / end[1])
    return start[0] * math.exp(share * math.log(end[0] / start[0]))
