"""What lengths and directions of a stage are, in metres and with z up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Usd, UsdGeom

MOST_UNIT = 1e18
"""Most metres of a unit, and units of a metre."""

Z_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""Turns column vectors (4,) with y up to z up."""


def is_y_up(stage: Usd.Stage) -> bool:
    """Return whether y is up."""
    return bool(UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y)


def faults(stage: Usd.Stage, unit: float | None = None) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with unit and axis of a stage, and what would be right; `unit` stands for its own."""
    unit = UsdGeom.GetStageMetersPerUnit(stage) if unit is None else unit
    if not 1.0 / MOST_UNIT <= unit <= MOST_UNIT:
        yield f"metersPerUnit is {unit:g}", f"a positive number, at most {MOST_UNIT:g}"
    axis = UsdGeom.GetStageUpAxis(stage)
    if axis not in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
        yield f"upAxis is {axis!r:.60}", "Y or Z"
