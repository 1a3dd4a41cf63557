"""A light that has a place: what the kinds of finite size share.

A light's own space is that of UsdLux: its shape is centered at the origin, and what emits from one side emits along -z,
which is also the axis of its `Shaping`. Its size is in metres of the world: there is no scale besides.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from lookdev.light import native
from lookdev.light.base import Light
from lookdev.light.emission import WHITE, Emission, check_number
from lookdev.light.placement import WORLD_AXES, Axes, Vector, checked_axes, to_local, to_world, vector
from lookdev.light.shape import FAR, Shape

Floats = NDArray[np.float64]

EXAMPLE_AXES: Axes = ((1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, -0.6, 0.8))
EXAMPLE_EMISSION = Emission((3.0, 2.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class PlacedLight(Light):
    """A shape at `position`, in metres, turned by `axes`.

    Methods with an underscore are in the light's own space.
    """

    far = False

    position: Vector = (0.0, 0.0, 0.0)
    axes: Axes = WORLD_AXES
    emission: Emission = WHITE

    def __post_init__(self) -> None:
        for value in self.position:
            check_number("position", value)
        checked_axes(self.axes)

    @property
    @abstractmethod
    def shape(self) -> Shape:
        """What is placed."""

    @abstractmethod
    def resized(self, scale: float) -> Self:
        """Return the light with sizes `scale` times as large, where it stands."""

    @property
    @abstractmethod
    def size_factor(self) -> float:
        """Square metres by which the radiance is divided where the power is normalized: `UsdLuxLightAPI`."""

    def radiance(self, place: Floats, direction: Floats) -> Floats:
        local, towards = self._inside(place), to_local(self.axes, direction)
        met = (self.shape.distance(local, towards) < FAR)[..., None]
        faded = self.emission.faded(np.linalg.norm(local, axis=-1))[..., None]
        return np.where(met, self._sent(local, towards) * self.emission.towards(towards) * faded, 0.0)

    def pdf(self, place: Floats, direction: Floats) -> Floats:
        return self._pdf(self._inside(place), to_local(self.axes, direction))

    def sample(self, place: Floats, u: Floats) -> Floats:
        return to_world(self.axes, self._sample(self._inside(place), u))

    def distance(self, place: Floats, direction: Floats) -> Floats:
        distance = self.shape.distance(self._inside(place), to_local(self.axes, direction))
        return np.where(distance < FAR, distance, np.inf)

    @property
    def shape_numbers(self) -> tuple[float, ...]:
        shape: Any = self.shape  # a dataclass
        return tuple(getattr(shape, each.name) for each in fields(shape))

    def scaled(self, scale: float, origin: Vector) -> Self:
        position = vector(scale * np.array(self.position) + np.array(origin))
        return replace(self.resized(scale), position=position, emission=self.emission.scaled(scale))

    def may_reach(self, center: Vector, radius: float) -> bool:
        """Return whether light may arrive in a sphere, whatever occludes it; False is certain.

        A light of no colour, one of one side whose front is turned away, a cone that passes by, and a falloff that ends
        before the sphere send none.
        """
        if not super().may_reach(center, radius):
            return False
        local = self._inside(np.array(center))
        if self.one_sided and local[2] >= radius:
            return False
        distance, wide = float(np.linalg.norm(local)), radius + self.reach
        falloff, shaping = self.emission.falloff, self.emission.shaping
        if falloff and falloff.end is not None and distance - radius >= falloff.end:
            return False
        if shaping is None or distance <= wide:
            return True
        # From any point of the light, the sphere is in a cone of half angle asin(wide / distance) about its center.
        off_axis = math.acos(np.clip(-local[2] / distance, -1.0, 1.0))
        return off_axis - math.asin(wide / distance) <= shaping.cone[0]

    def native_gap(self) -> str | None:
        profile = ["an IES profile"] if self.emission.shaping and self.emission.shaping.profile else []
        return native.gap(self.emission, "shadow", "shaping", besides=(*profile, *native.shadow_gap(self.emission)))

    def _inside(self, place: Floats) -> Floats:
        return to_local(self.axes, place - np.array(self.position))

    def _sent(self, place: Floats, direction: Floats) -> Floats | float:
        """Return the share (..., 3) of the emission that is sent from what is met; 1 unless a kind has a texture."""
        return 1.0

    def _pdf(self, place: Floats, direction: Floats) -> Floats:
        return np.asarray(self.shape.pdf(place, direction))

    def _sample(self, place: Floats, u: Floats) -> Floats:
        return np.asarray(self.shape.sample(place, u))
