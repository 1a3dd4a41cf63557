"""Local dome: a dome light whose image is on a sphere of finite size; neither physical nor part of UsdLux.

It illuminates a part of a scene, as Burley, "Physically Based Shading at Disney", 2012, section 6.2, uses image-based
lights as a local fill. The radiance that arrives at a point from a direction is the radiance of the image where the ray
leaves the sphere (Lagarde, Zanuttini, "Local Image-Based Lighting with Parallax-Corrected Cubemaps", 2012).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.vectors import Real
from lookdev.errors import EnvironmentMapError
from lookdev.light.base import Light
from lookdev.light.dome import Dome, example_dome
from lookdev.light.emission import Emission, check_number, smooth_step
from lookdev.light.placement import Axes, Vector, vector
from lookdev.space import Space

_VERSION = 1  # part of the digest, as `Light.version`


@dataclass(frozen=True, kw_only=True)
class LocalDome(Light):
    """A dome light whose image is on a sphere of `radius` about `position`, in metres; it illuminates the inside.

    Parallax applies: a point sees the image from its own position. Objects outside the sphere do not occlude the light.
    The light fades to 0 over the outer fraction `edge` of the radius (0 for no fading, 1 for the whole radius). The
    light does not reach points outside. `dome` has the image, the axes and the emission.
    """

    kind = "local_dome"
    is_infinitely_far = False

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
        return self.fade_start, self.radius

    def with_emission(self, emission: Emission) -> LocalDome:
        return replace(self, dome=self.dome.with_emission(emission))

    def rescale(self, scale: float, origin: Vector) -> LocalDome:
        position = vector(scale * np.array(self.position) + np.array(origin))
        light = self.with_emission(self.emission.scale_lengths(scale))
        return replace(light, position=position, radius=scale * self.radius)

    def _convert(self, space: Space) -> LocalDome:
        return replace(self, dome=self.dome.convert_map(space, local=True))

    def native_gap(self) -> str:
        """Return the features of this light that Cycles' own lights lack, as a phrase for a message."""
        return "a position and a radius of its image"

    @property
    def digest(self) -> str:
        fields = (self.dome.digest, self.position, self.radius, self.edge)
        return hashlib.sha256(f"{self.kind} {_VERSION} {fields!r}".encode()).hexdigest()

    @property
    def fade_start(self) -> float:
        """The distance from the centre, in metres, at which the light begins to fade."""
        return self.radius * (1.0 - self.edge)

    def radiance(self, point: Floats, direction: Floats) -> Floats:
        local = point - np.array(self.position)
        inside, distance, _ = exit_ball(local, direction, self.radius)
        exit_point = local + distance[..., None] * direction
        radiance = self.dome.radiance(point, np.where(inside[..., None], exit_point, direction))
        return np.where(inside[..., None], fade_factor(local, self.fade_start, self.radius)[..., None] * radiance, 0.0)

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        local = point - np.array(self.position)
        inside, distance, solid_angle_ratio = exit_ball(local, direction, self.radius)
        map_direction = np.where(inside[..., None], local + distance[..., None] * direction, direction)
        return np.where(inside, self.dome.pdf(point, map_direction) * solid_angle_ratio, 0.0)

    def sample(self, point: Floats, u: Floats) -> Floats:
        local = point - np.array(self.position)
        return np.asarray(directions_to_ball(local, self.dome.sample(point, u), self.radius))

    def distance(self, point: Floats, direction: Floats) -> Floats:
        inside, distance, _ = exit_ball(point - np.array(self.position), direction, self.radius)
        return np.where(inside, distance, np.inf)


# Generated code is traced from the next three functions, whose arrays may be symbolic.


def fade_factor(point: Floats, start: Real, radius: Real) -> Floats:
    """Return the share (...) of a local dome's light that arrives at points (..., 3) relative to its centre.

    The light fades from the distance `start` to the `radius`, in metres.
    """
    rise: Real = np.where(radius > start, 1.0 / np.where(radius > start, radius - start, 1.0), 0.0)
    return 1.0 - smooth_step(np.sqrt((point * point).sum(axis=-1)), start, rise)


def exit_ball(point: Floats, direction: Floats, radius: Real) -> tuple[Floats, Floats, Floats]:
    """Intersect rays from points (..., 3) in directions (..., 3) with a ball about the origin, from inside.

    Returns
    -------
    inside : (...)
        Whether the point is in the ball.
    distance : (...)
        The distance along the ray to the ball's surface; 0 if the point is outside.
    ratio : (...)
        The solid angle of a small piece of the surface, where the ray leaves the ball, as seen from the centre, divided
        by the solid angle of this piece as seen from the point; 0 if the point is outside.
    """
    projection = (point * direction).sum(axis=-1)
    margin = radius * radius - (point * point).sum(axis=-1)
    # The radius times the cosine between the direction and the surface normal at the exit.
    exit_cosine = np.sqrt(np.maximum(projection * projection + margin, 0.0))
    # The distance is a root of a quadratic equation. The sign of `projection` selects the form without cancellation.
    distance = np.where(
        projection < 0.0,
        exit_cosine - projection,
        margin / np.where(exit_cosine + projection > 0.0, exit_cosine + projection, 1.0),
    )
    inside = margin > 0.0
    distance = np.where(inside, distance, 0.0)
    # The ratio is d^2 / (R^2 cos) for the distance d and the radius R; `exit_cosine` is R cos.
    return inside, distance, distance * distance / (radius * np.where(inside & (exit_cosine > 0.0), exit_cosine, 1.0))


def directions_to_ball(point: Floats, map_direction: Floats, radius: Real) -> Floats:
    """Return unit directions (..., 3) from points (..., 3) to the surface of a ball about the origin.

    `map_direction` (..., 3) is the unit direction from the centre of the ball to the same point of the surface.
    """
    towards = radius * map_direction - point
    length = np.expand_dims(np.sqrt((towards * towards).sum(axis=-1)), -1)
    return np.where(length > 0.0, towards / np.where(length > 0.0, length, 1.0), ZENITH)


def example_local_dome() -> LocalDome:
    """Return an example: a dome light on a sphere with a radius of three metres."""
    return LocalDome(dome=example_dome(), position=(0.5, 0.0, 0.5), radius=3.0, edge=0.5)
