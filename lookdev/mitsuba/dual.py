"""A colour or a number, and its derivatives by the inputs that are searched: of a frame, a list of it alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

Dual = list[Any]


def product(a: Dual, b: Dual) -> Dual:
    """Return the product of two."""
    return [a[0] * b[0], *(da * b[0] + a[0] * db for da, db in zip(a[1:], b[1:], strict=True))]


def summed(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Return the sums of what two lists have."""
    return [x + y for x, y in zip(a, b, strict=True)]


def less(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Return the differences of what two lists have."""
    return [x - y for x, y in zip(a, b, strict=True)]


def where(mask: Any, a: Sequence[Any]) -> list[Any]:
    """Return what a list has, 0 but where a mask is true."""
    return [dr.select(mask, each, 0.0) for each in a]


def size(a: Dual) -> Any:
    """Return by which paths are chosen: the colour's mean, no derivative."""
    return dr.mean(a[0])
