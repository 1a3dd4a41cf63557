"""Checks the unit and the up axis of a stage, and has the matrix from y up to z up, for all readers of stages."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Usd, UsdGeom

MAX_UNIT = 1e18
"""The largest unit of a stage in metres; the smallest is its inverse."""

Z_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""The matrix (4, 4) that maps column vectors from a stage with y up to world space with z up."""


def is_y_up(stage: Usd.Stage) -> bool:
    """Return whether the y axis of a stage points up."""
    return bool(UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y)


def unit_faults(stage: Usd.Stage, unit: float | None = None) -> Iterator[tuple[str, str]]:
    """Yield the faults of a stage's unit and up axis, as pairs of texts: the problem, and the right value.

    `unit`, in metres, replaces the stage's own.
    """
    unit = UsdGeom.GetStageMetersPerUnit(stage) if unit is None else unit
    if not 1.0 / MAX_UNIT <= unit <= MAX_UNIT:
        yield f"metersPerUnit is {unit:g}", f"a positive number, at most {MAX_UNIT:g}"
    axis = UsdGeom.GetStageUpAxis(stage)
    if axis not in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
        yield f"upAxis is {axis!r:.60}", "Y or Z"
