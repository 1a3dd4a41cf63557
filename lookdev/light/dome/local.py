"""A dome light of finite size, for a part of a scene: not physical, nor part of UsdLux.

Burley, "Physically Based Shading at Disney", 2012, section 6.2, has image-based lights as a local fill. What a place
sees in a direction is the image where that ray meets the sphere (Lagarde, Zanuttini, "Local Image-Based Lighting with
Parallax-Corrected Cubemaps", 2012).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lookdev.errors import EnvironmentMapError
from lookdev.light.dome import Dome, example_dome
from lookdev.light.emission import Emission, check_number, slope, smooth_step
from lookdev.light.placement import Vector

Floats = NDArray[np.float64]

_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class LocalDome:
    """A dome light whose image is on a sphere about `position` of a `radius`, in metres, which it lights from inside.

    Places see it from where they are, and what is beyond the sphere casts no shadow of it. Its light fades over the
    outer part `edge` (0: none, 1: all) of the radius, and none arrives outside. Axes and emission are those of `dome`.
    """

    kind: ClassVar[str] = "local_dome"
    constant: ClassVar[bool] = False

    dome: Dome
    position: Vector
    radius: float
    edge: float = 0.0

    def __post_init__(self) -> None:
        for value in self.position:
            check_number("position", value)
        check_number("radius", self.radius, above=0.0)
        if not 0.0 <= self.edge <= 1.0:
            raise EnvironmentMapError(f"edge {self.edge:g}: a part of the radius, from 0 to 1, would be right")

    @property
    def emission(self) -> Emission:
        return self.dome.emission

    @property
    def digest(self) -> str:
        fields = (self.dome.digest, self.position, self.radius, self.edge)
        return hashlib.sha256(f"{self.kind} {_VERSION} {fields!r}".encode()).hexdigest()

    def radiance(self, place: Floats, direction: Floats) -> Floats:
        local = place - np.array(self.position)
        distance, _ = self._met(local, direction)
        met = np.isfinite(distance)
        onto = local + np.where(met, distance, 0.0)[..., None] * direction
        from_middle = np.linalg.norm(local, axis=-1)
        start = self.radius * (1.0 - self.edge)
        share = 1.0 - smooth_step(from_middle, start, slope(start, self.radius))
        seen = self.dome.radiance(place, np.where(met[..., None], onto, direction))
        return np.where(met[..., None], share[..., None] * seen, 0.0)

    def pdf(self, place: Floats, direction: Floats) -> Floats:
        local = place - np.array(self.position)
        distance, rise = self._met(local, direction)
        met = np.isfinite(distance) & (rise > 0.0)
        distance = np.where(met, distance, 0.0)
        # The solid angle at the middle over that at the place: d^2 / (R^2 cos), R cos being the rise.
        around = distance**2 / (self.radius * np.where(met, rise, 1.0))
        onto = np.where(met[..., None], local + distance[..., None] * direction, direction)
        return np.where(met, self.dome.pdf(place, onto) * around, 0.0)

    def sample(self, place: Floats, u: Floats) -> Floats:
        local = place - np.array(self.position)
        towards = self.radius * self.dome.sample(place, u) - local
        length = np.linalg.norm(towards, axis=-1, keepdims=True)
        return np.where(length > 0.0, towards / np.where(length > 0.0, length, 1.0), np.array((0.0, 0.0, 1.0)))

    def distance(self, place: Floats, direction: Floats) -> Floats:
        return self._met(place - np.array(self.position), direction)[0]

    def _met(self, local: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """Return the distance (...) to the sphere from inside, else inf, and R times the cosine at which it is met."""
        along = (local * direction).sum(axis=-1)
        left = self.radius**2 - (local * local).sum(axis=-1)
        rise = np.sqrt(np.maximum(along * along + left, 0.0))
        # Of the two forms of the root the one without cancellation.
        distance = np.where(along < 0.0, rise - along, left / np.where(rise + along > 0.0, rise + along, 1.0))
        return np.where(left > 0.0, distance, np.inf), rise


def example_local_dome() -> LocalDome:
    """Return the example of a dome light on a sphere of three metres."""
    return LocalDome(dome=example_dome(), position=(0.5, 0.0, 0.5), radius=3.0, edge=0.5)
