"""Base classes of lights with a shape: `Lamp`, and `PlacedLight` for lamps with a position and a finite size.

A light's own space is that of UsdLux: the shape is centred at the origin. A one-sided light emits along -z, which is
also the axis of its `Shaping`. Lengths in this space are metres of the world, without a further scale.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from lookdev.arrays import Floats
from lookdev.light import native
from lookdev.light.base import Light
from lookdev.light.emission import WHITE, Emission, check_number
from lookdev.light.placement import WORLD_AXES, Axes, Vector, checked_axes, to_local, to_world, vector
from lookdev.light.shape import FAR, LampShape

EXAMPLE_AXES: Axes = ((1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, -0.6, 0.8))  # example lights point down and to +y
EXAMPLE_EMISSION = Emission((3.0, 2.0, 1.0))


class Lamp(Light):
    """A light with a shape; its methods transform to the light's own space and call the methods of the shape."""

    @property
    def shape(self) -> LampShape:
        """Its shape, in its own space."""
        return self.shapes[self.shape_name](*self.shape_numbers)

    @property
    @abstractmethod
    def size_factor(self) -> float:
        """The divisor of the radiance if the power is normalized (`UsdLuxLightAPI`), in square metres or steradians."""

    def radiance(self, point: Floats, direction: Floats) -> Floats:
        local_point, local_direction = self._to_own_space(point), to_local(self.axes, direction)
        hits = (self.shape.distance(local_point, local_direction) < FAR)[..., None]
        falloff = self.emission.falloff_factor(np.linalg.norm(local_point, axis=-1))[..., None]
        factor = self._radiance_factor(local_point, local_direction)
        return np.where(hits, factor * self.emission.radiance_towards(local_direction) * falloff, 0.0)

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        pdf = self.shape.pdf(self._to_own_space(point), to_local(self.axes, direction))
        return np.broadcast_to(pdf, np.broadcast_shapes(point.shape, direction.shape)[:-1])

    def sample(self, point: Floats, u: Floats) -> Floats:
        return to_world(self.axes, self.shape.sample(self._to_own_space(point), u))

    def _to_own_space(self, point: Floats) -> Floats:
        return to_local(self.axes, point - np.array(self.position or (0.0, 0.0, 0.0)))

    def _radiance_factor(self, point: Floats, direction: Floats) -> Floats | float:
        """Return a factor (..., 1 or 3) of the emission where the ray hits; arguments are in the light's own space."""
        return 1.0


@dataclass(frozen=True, kw_only=True)
class PlacedLight(Lamp):
    """A lamp at `position`, in metres, whose `shape_numbers` are its sizes in metres."""

    is_infinitely_far = False

    example_sizes: ClassVar[Mapping[str, Any]]
    """The sizes of `example`, by the names of their fields in the order of `shape_numbers`."""

    position: Vector = (0.0, 0.0, 0.0)
    axes: Axes = WORLD_AXES
    emission: Emission = WHITE

    @classmethod
    def example(cls) -> Self:
        """Return a warm light above, to a side."""
        return cls(position=(0.4, -1.0, 1.6), axes=EXAMPLE_AXES, emission=EXAMPLE_EMISSION, **cls.example_sizes)

    def __post_init__(self) -> None:
        for value in self.position:
            check_number("position", value)
        checked_axes(self.axes)
        for name, size in self.sizes.items():
            check_number(name.split()[0], size, above=0.0)  # "radius x" is called "radius" in the message

    @property
    def sizes(self) -> Mapping[str, float]:
        return {name: getattr(self, name) for name in self.example_sizes}

    @property
    def shape_numbers(self) -> tuple[float, ...]:
        return tuple(self.sizes.values())

    def resize(self, scale: float) -> Self:
        """Return the light with sizes `scale` times as large, at the same position."""
        return replace(self, **{name: scale * getattr(self, name) for name in self.example_sizes})

    def distance(self, point: Floats, direction: Floats) -> Floats:
        distance = self.shape.distance(self._to_own_space(point), to_local(self.axes, direction))
        return np.where(distance < FAR, distance, np.inf)

    def rescale(self, scale: float, origin: Vector) -> Self:
        position = vector(scale * np.array(self.position) + np.array(origin))
        return replace(self.resize(scale), position=position, emission=self.emission.scale_lengths(scale))

    def may_reach(self, center: Vector, radius: float) -> bool:
        """Return whether the light may reach a sphere, if nothing occludes it; False is certain, True is not.

        A black light does not reach it, nor does a one-sided light that faces away, a light whose cone misses the
        sphere, or a light whose falloff ends before the sphere.
        """
        if not super().may_reach(center, radius):
            return False
        local = self._to_own_space(np.array(center))
        if self.one_sided and local[2] >= radius:
            return False
        distance, total_radius = float(np.linalg.norm(local)), radius + self.reach
        falloff, shaping = self.emission.falloff, self.emission.shaping
        if falloff and falloff.end is not None and distance - radius >= falloff.end:
            return False
        if shaping is None or distance <= total_radius:
            return True
        # A ray from the light to the sphere deviates from the line between the centres of both by at most
        # asin(total_radius / distance).
        off_axis = math.acos(np.clip(-local[2] / distance, -1.0, 1.0))
        return off_axis - math.asin(total_radius / distance) <= shaping.cone[0]

    def native_gap(self) -> str | None:
        profile = ["an IES profile"] if self.emission.shaping and self.emission.shaping.profile else []
        gaps = (*profile, *native.missing_shadow_features(self.emission))
        return native.missing_features(self.emission, "shadow", "shaping", first=gaps)
