"""Sphere light: `UsdLuxSphereLight`. Directions are uniform over the cone in which a place sees it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lookdev.light.cone import about, draw_uniform, uniform_density
from lookdev.light.emission import check_number
from lookdev.light.placed import EXAMPLE_AXES, EXAMPLE_EMISSION, PlacedLight

Floats = NDArray[Any]


@dataclass(frozen=True, kw_only=True)
class SphereLight(PlacedLight):
    """A sphere of a radius in metres that emits outwards; from inside it is dark, as UsdLux defines it."""

    kind: ClassVar[str] = "sphere"

    radius: float

    @classmethod
    def example(cls) -> SphereLight:
        """Return a warm light above, to a side."""
        return cls(radius=0.5, position=(0.4, -1.0, 1.6), axes=EXAMPLE_AXES, emission=EXAMPLE_EMISSION)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("radius", self.radius, above=0.0)

    @property
    def size_factor(self) -> float:
        return 4.0 * math.pi * self.radius**2

    def _distance(self, place: Floats, direction: Floats) -> Floats:
        return meet_sphere(place, direction, self.radius)

    def _pdf(self, place: Floats, direction: Floats) -> Floats:
        met = np.isfinite(self._distance(place, direction))
        return np.where(met, uniform_density(sphere_versine(place, self.radius)), 0.0)

    def _sample(self, place: Floats, u: Floats) -> Floats:
        away = np.linalg.norm(place, axis=-1, keepdims=True)
        axis = np.where(away > 0.0, -place / np.where(away > 0.0, away, 1.0), np.array((0.0, 0.0, 1.0)))
        return about(axis, draw_uniform(sphere_versine(place, self.radius), u))


def sphere_versine(place: Floats, radius: Any) -> Floats:
    """Return 1 - cos of half the angle at which places (..., 3) see a sphere about the origin; 1 from inside."""
    squared = (place * place).sum(axis=-1)
    sine = np.minimum(radius * radius / np.maximum(squared, radius * radius), 1)
    return np.asarray(sine / (1 + np.sqrt(1 - sine)))


def meet_sphere(place: Floats, direction: Floats, radius: Any) -> Floats:
    """Return the distance (...) along directions (..., 3) to a sphere about the origin; inf if missed, or from inside.

    The distance of the line to the middle is the length of a cross product, which keeps its digits from afar.
    """
    across = np.cross(place, direction)
    squared = radius * radius - (across * across).sum(axis=-1)
    towards = -(place * direction).sum(axis=-1)
    outside = (place * place).sum(axis=-1) > radius * radius
    met = outside & (towards > 0) & (squared >= 0)
    return np.where(met, towards - np.sqrt(np.maximum(squared, 0)), np.inf)
