"""Sphere light: `UsdLuxSphereLight`. Sampling draws directions uniformly from the cone that the sphere subtends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.vectors import Real, cross, dot
from lookdev.light.base import LightKind
from lookdev.light.placed import PlacedLight
from lookdev.light.shape import FAR, LampShape, cone_about, draw_uniform, orient_to_axis, uniform_pdf
from lookdev.light.usd import PlacedPrim, UsdLight, UsdLightShape


@dataclass(frozen=True)
class Sphere:
    """The `LampShape` of a sphere, which emits outwards."""

    radius: Real

    def distance(self, point: Floats, direction: Floats) -> Floats:
        return intersect_sphere(point, direction, self.radius)

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        hits = self.distance(point, direction) < FAR
        return np.where(hits, uniform_pdf(sphere_versine(point, self.radius)), 0)

    def sample(self, point: Floats, u: Floats) -> Floats:
        axis, _ = self.cone(point)
        return orient_to_axis(axis, draw_uniform(sphere_versine(point, self.radius), u))

    def solid_angle(self, point: Floats) -> Floats:
        outside = dot(point, point) > self.radius * self.radius
        return np.where(outside, 2 * math.pi * sphere_versine(point, self.radius), 0)

    def cone(self, point: Floats) -> tuple[Floats, Floats]:
        return cone_about(point, self.radius)


@dataclass(frozen=True, kw_only=True)
class SphereLight(PlacedLight):
    """A sphere that emits outwards, of a `radius` in metres; it is dark inside, as UsdLux defines it."""

    kind = "sphere"
    shapes: ClassVar[Mapping[str, type[LampShape]]] = {"sphere": Sphere}
    example_sizes: ClassVar[Mapping[str, float]] = {"radius": 0.5}

    radius: float

    @property
    def reach(self) -> float:
        """Metres from the centre to the surface."""
        return self.radius

    @property
    def mitsuba_shape(self) -> tuple[str, Floats]:
        return "sphere", np.diag([self.radius, self.radius, self.radius, 1.0])

    @property
    def size_factor(self) -> float:
        """The area in square metres."""
        return 4.0 * math.pi * self.radius**2


def sphere_versine(point: Floats, radius: Real) -> Floats:
    """Return 1 - cos of half the angle that a sphere about the origin subtends at points (..., 3); 1 from inside."""
    squared = dot(point, point)
    squared_sine = np.minimum(radius * radius / np.maximum(squared, radius * radius), 1)
    # 1 - cos without cancellation.
    versine: Floats = squared_sine / (1 + np.sqrt(1 - squared_sine))
    return versine


def intersect_sphere(point: Floats, direction: Floats, radius: Real) -> Floats:
    """Return the distance (...) along directions (..., 3) to a sphere at the origin; `FAR` for misses, and from inside.

    The distance of the line from the centre is the length of a cross product, which is accurate from afar, too.
    """
    moment = cross(point, direction)
    discriminant = radius * radius - dot(moment, moment)
    approach = -dot(point, direction)
    outside = dot(point, point) > radius * radius
    hits = outside & (approach > 0) & (discriminant >= 0)
    return np.where(hits, approach - np.sqrt(np.maximum(discriminant, 0)), FAR)


def _read(prim: PlacedPrim) -> UsdLightShape:
    radius = prim.radius("treatAsPoint", "sphere", (0, 2))
    return UsdLightShape.without_image(SphereLight(radius=radius, position=prim.position, axes=prim.axes))


SPHERE = LightKind(SphereLight, SphereLight.example, {"SphereLight": UsdLight(_read)})
