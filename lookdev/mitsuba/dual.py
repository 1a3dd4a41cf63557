"""Duals: a dual is a list of a value and its derivatives with respect to the inputs of a fit.

A value is a colour or a number. The path tracer computes with duals (`lookdev.mitsuba.integrator`). When a frame is
rendered, a dual has only the value.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import drjit as dr

from lookdev.mitsuba.types import Bool, Color3f, Float

Dual = list[Color3f]
"""A colour, then its derivatives. For frames, such a list has the light, then the parts of it that passes record."""

_Number = TypeVar("_Number", Float, Color3f)


def product(a: Dual, b: Dual) -> Dual:
    """Return the product of two duals, by the product rule."""
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
    """Return the weight with which a path is selected: the mean of a dual's colour, without its derivatives."""
    return dr.mean(a[0])
