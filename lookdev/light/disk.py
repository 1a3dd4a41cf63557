"""Disk light: `UsdLuxDiskLight`.

Directions are drawn to the rectangle around it; those that miss the disk bring no light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lookdev.light.emission import check_number
from lookdev.light.placed import EXAMPLE_AXES, EXAMPLE_EMISSION, PlacedLight
from lookdev.light.plane import meet_plane, seen_part, towards_plane
from lookdev.light.spherical_rectangle import density, draw

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DiskLight(PlacedLight):
    """An ellipse of radii along its x and y, in metres, that emits along its -z."""

    kind: ClassVar[str] = "disk"

    radii: tuple[float, float]

    @classmethod
    def example(cls) -> DiskLight:
        """Return a warm light above, to a side."""
        return cls(radii=(0.7, 0.5), position=(0.4, -1.0, 1.6), axes=EXAMPLE_AXES, emission=EXAMPLE_EMISSION)

    def __post_init__(self) -> None:
        super().__post_init__()
        for radius in self.radii:
            check_number("radius", radius, above=0.0)

    @property
    def size_factor(self) -> float:
        return math.pi * self.radii[0] * self.radii[1]

    def _distance(self, place: Floats, direction: Floats) -> Floats:
        distance, point = meet_plane(place, direction, *self._sides)
        return np.where(np.hypot(point.s - 0.5, point.t - 0.5) <= 0.5, distance, np.inf)

    def _pdf(self, place: Floats, direction: Floats) -> Floats:
        distance, point = meet_plane(place, direction, *self._sides)
        return np.where(np.isfinite(distance), density(seen_part(place, *self._sides), point), 0.0)

    def _sample(self, place: Floats, u: Floats) -> Floats:
        return towards_plane(place, draw(seen_part(place, *self._sides), u))

    @property
    def _sides(self) -> tuple[float, float]:
        return 2.0 * self.radii[0], 2.0 * self.radii[1]
