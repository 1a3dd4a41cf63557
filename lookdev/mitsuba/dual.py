"""Duals: lists of a colour or number, then its derivatives by the inputs of a fit.

For a frame, the list has the colour or number alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import drjit as dr

from lookdev.mitsuba.types import Bool, Color3f, Float

Dual = list[Color3f]
_Number = TypeVar("_Number", Float, Color3f)


def product(a: Dual, b: Dual) -> Dual:
    """Return the product of two duals."""
    return [a[0] * b[0], *(da * b[0] + a[0] * db for da, db in zip(a[1:], b[1:], strict=True))]


def sum_of(a: Sequence[_Number], b: Sequence[_Number]) -> list[_Number]:
    """Return the sums of the elements of two lists."""
    return [x + y for x, y in zip(a, b, strict=True)]


def difference(a: Sequence[_Number], b: Sequence[_Number]) -> list[_Number]:
    """Return the differences of the elements of two lists."""
    return [x - y for x, y in zip(a, b, strict=True)]


def where(mask: Bool, a: Dual) -> Dual:
    """Return the elements of a list where a mask is true, and 0 elsewhere."""
    return [dr.select(mask, element, 0.0) for element in a]


def path_weight(a: Dual) -> Float:
    """Return the weight that selects paths: the mean of the colour, without derivatives."""
    return dr.mean(a[0])
