"""Disk light: `UsdLuxDiskLight`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lookdev.light.placed import PlacedLight

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DiskLight(PlacedLight):
    """An ellipse of radii along its x and y, in metres, that emits along its -z."""

    kind: ClassVar[str] = "disk"

    radii: tuple[float, float]
