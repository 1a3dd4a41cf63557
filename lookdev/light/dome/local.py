"""A dome light of finite size, for a part of a scene: not physical, nor part of UsdLux.

Burley, "Physically Based Shading at Disney", 2012, section 6.2, has image-based lights as a local fill. What a place
sees in a direction is the image where that ray meets the sphere (Lagarde, Zanuttini, "Local Image-Based Lighting with
Parallax-Corrected Cubemaps", 2012).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.brdf.frames import ZENITH
from lookdev.errors import EnvironmentMapError
from lookdev.light.base import Light
from lookdev.light.dome import Dome, example_dome
from lookdev.light.emission import Emission, check_number, smooth_step
from lookdev.light.placement import Axes, Vector, vector
from lookdev.space import Space

Floats = NDArray[np.float64]

_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class LocalDome(Light):
    """A dome light whose image is on a sphere about `position` of a `radius`, in metres, which it lights from inside.

    Places see it from where they are, and what is beyond the sphere casts no shadow of it. Its light fades over the
    outer part `edge` (0: none, 1: all) of the radius, and none arrives outside. Axes and emission are those of `dome`.
    """

    kind = "local_dome"
    far = False

    dome: Dome
    position: Vector = field()
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
    def axes(self) -> Axes:
        return self.dome.axes

    @property
    def map_dome(self) -> Dome:
        return self.dome

    @property
    def reach(self) -> float:
        return self.radius

    @property
    def sizes(self) -> dict[str, float]:
        return {"radius": self.radius, "edge": self.edge}

    @property
    def shape_numbers(self) -> tuple[float, ...]:
        return self.start, self.radius

    def with_emission(self, emission: Emission) -> LocalDome:
        return replace(self, dome=self.dome.with_emission(emission))

    def scaled(self, scale: float, origin: Vector) -> LocalDome:
        position = vector(scale * np.array(self.position) + np.array(origin))
        light = self.with_emission(self.emission.scaled(scale))
        return replace(light, position=position, radius=scale * self.radius)

    def _converted(self, space: Space) -> LocalDome:
        return replace(self, dome=self.dome.converted_map(space, local=True))

    def native_gap(self) -> str:
        return "a place and a radius of its image"

    @property
    def digest(self) -> str:
        fields = (self.dome.digest, self.position, self.radius, self.edge)
        return hashlib.sha256(f"{self.kind} {_VERSION} {fields!r}".encode()).hexdigest()

    @property
    def start(self) -> float:
        """Metres from the middle at which the light begins to fade."""
        return self.radius * (1.0 - self.edge)

    def radiance(self, place: Floats, direction: Floats) -> Floats:
        local = place - np.array(self.position)
        met, distance, _ = meet_ball(local, direction, self.radius)
        onto = local + distance[..., None] * direction
        seen = self.dome.radiance(place, np.where(met[..., None], onto, direction))
        return np.where(met[..., None], share_within(local, self.start, self.radius)[..., None] * seen, 0.0)

    def pdf(self, place: Floats, direction: Floats) -> Floats:
        local = place - np.array(self.position)
        met, distance, around = meet_ball(local, direction, self.radius)
        onto = np.where(met[..., None], local + distance[..., None] * direction, direction)
        return np.where(met, self.dome.pdf(place, onto) * around, 0.0)

    def sample(self, place: Floats, u: Floats) -> Floats:
        local = place - np.array(self.position)
        return np.asarray(towards_ball(local, self.dome.sample(place, u), self.radius))

    def distance(self, place: Floats, direction: Floats) -> Floats:
        met, distance, _ = meet_ball(place - np.array(self.position), direction, self.radius)
        return np.where(met, distance, np.inf)


# Generated code follows these functions, whose arrays may be symbolic.


def share_within(place: Any, start: Any, radius: Any) -> Any:
    """Return the share (...) of a dome's light that arrives at places (..., 3) about its middle."""
    rise: Any = np.where(radius > start, 1.0 / np.where(radius > start, radius - start, 1.0), 0.0)
    return 1.0 - smooth_step(np.sqrt((place * place).sum(axis=-1)), start, rise)


def meet_ball(place: Any, direction: Any, radius: Any) -> tuple[Any, Any, Any]:
    """Return whether places (..., 3) are inside a ball, (...), and where a direction (..., 3) leads out of it.

    That is the distance, and the solid angle at the middle over that at the place, 0 where neither is.
    """
    along = (place * direction).sum(axis=-1)
    left = radius * radius - (place * place).sum(axis=-1)
    # R times the cosine at which it is met.
    rise = np.sqrt(np.maximum(along * along + left, 0.0))
    # Of the two forms of the root the one without cancellation.
    distance = np.where(along < 0.0, rise - along, left / np.where(rise + along > 0.0, rise + along, 1.0))
    met = left > 0.0
    distance = np.where(met, distance, 0.0)
    # d^2 / (R^2 cos).
    return met, distance, distance * distance / (radius * np.where(met & (rise > 0.0), rise, 1.0))


def towards_ball(place: Any, onto: Any, radius: Any) -> Any:
    """Return directions (..., 3) from places to where directions (..., 3) from the middle of a ball meet it."""
    towards = radius * onto - place
    length = np.expand_dims(np.sqrt((towards * towards).sum(axis=-1)), -1)
    return np.where(length > 0.0, towards / np.where(length > 0.0, length, 1.0), ZENITH)


def example_local_dome() -> LocalDome:
    """Return the example of a dome light on a sphere of three metres."""
    return LocalDome(dome=example_dome(), position=(0.5, 0.0, 0.5), radius=3.0, edge=0.5)
