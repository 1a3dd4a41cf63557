"""Unit and up axis of a stage, and their conversion to metres and z up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Usd, UsdGeom

MAX_UNIT = 1e18
"""The largest unit, in metres, and the inverse of the smallest."""

Z_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""Matrix (4, 4) that maps column vectors from y up to z up."""


def is_y_up(stage: Usd.Stage) -> bool:
    """Return whether the y axis of a stage points up."""
    return bool(UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y)


def unit_faults(stage: Usd.Stage, unit: float | None = None) -> Iterator[tuple[str, str]]:
    """Yield (problem, what is right) for the unit and the up axis of a stage; `unit` replaces the stage's own."""
    unit = UsdGeom.GetStageMetersPerUnit(stage) if unit is None else unit
    if not 1.0 / MAX_UNIT <= unit <= MAX_UNIT:
        yield f"metersPerUnit is {unit:g}", f"a positive number, at most {MAX_UNIT:g}"
    axis = UsdGeom.GetStageUpAxis(stage)
    if axis not in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
        yield f"upAxis is {axis!r:.60}", "Y or Z"
