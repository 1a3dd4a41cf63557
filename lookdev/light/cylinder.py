"""Cylinder light: `UsdLuxCylinderLight`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lookdev.light.placed import PlacedLight

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CylinderLight(PlacedLight):
    """A cylinder of `length` along its x and a `radius`, in metres, whose side emits outwards; it has no caps."""

    kind: ClassVar[str] = "cylinder"

    length: float
    radius: float
