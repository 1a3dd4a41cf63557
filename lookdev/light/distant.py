"""Distant light: `UsdLuxDistantLight`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lookdev.light.emission import Emission
from lookdev.light.placement import WORLD_AXES, Axes

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DistantLight:
    """A cone of directions about its +z, of `angle` degrees from side to side, infinitely far: it emits along its -z.

    An angle of 0 is parallel light of irradiance `emission.color`.
    """

    kind: ClassVar[str] = "distant"
    constant: ClassVar[bool] = False

    angle: float = 0.53
    axes: Axes = WORLD_AXES
    emission: Emission = Emission()
