"""Sphere light: `UsdLuxSphereLight`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lookdev.light.placed import PlacedLight

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SphereLight(PlacedLight):
    """A sphere of a radius in metres that emits outwards; from inside it is dark, as UsdLux defines it."""

    kind: ClassVar[str] = "sphere"

    radius: float
