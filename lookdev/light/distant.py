"""Distant light: `UsdLuxDistantLight`, an infinitely far light from a cone of directions, such as the sun."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.vectors import dot
from lookdev.errors import EnvironmentMapError
from lookdev.light import native
from lookdev.light.base import LightKind
from lookdev.light.emission import WHITE, Emission, check_number
from lookdev.light.placed import EXAMPLE_AXES, EXAMPLE_EMISSION, Lamp
from lookdev.light.placement import WORLD_AXES, Axes, checked_axes
from lookdev.light.shape import FAR, INFINITE_DISTANCE, LampShape, draw_uniform, uniform_pdf
from lookdev.light.usd import LIGHT_ATTRIBUTES, PlacedPrim, UsdLight, UsdLightShape
from lookdev.space import Color

_MIN_HALF_ANGLE = math.radians(0.005)  # radians: the smallest half angle that float32 distinguishes from 0


@dataclass(frozen=True)
class Cone:
    """The `LampShape` of a cone of directions about z; `versine` is 1 - cos of half its angle."""

    versine: Floats | float

    def distance(self, point: Floats, direction: Floats) -> Floats:
        # The squared chord is 2 (1 - cos). Unlike the cosine, it keeps its digits near the axis.
        chord = direction - ZENITH
        return np.where(dot(chord, chord) <= 2 * self.versine, INFINITE_DISTANCE, FAR)

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        return np.where(self.distance(point, direction) < FAR, uniform_pdf(self.versine), 0)

    def sample(self, point: Floats, u: Floats) -> Floats:
        return draw_uniform(self.versine, u)

    def solid_angle(self, point: Floats) -> Floats | float:
        return 2 * math.pi * self.versine

    def cone(self, point: Floats) -> tuple[Floats, Floats]:
        return ZENITH, np.where(self.versine < 1, self.versine * (2 - self.versine), 1)


@dataclass(frozen=True, kw_only=True)
class DistantLight(Lamp):
    """An infinitely far light that is seen in a cone of directions about its +z; it emits along its -z.

    `angle` is the cone's full angle in degrees. An angle of 0 is parallel light of irradiance `emission.color`.
    """

    kind = "distant"
    one_sided = True
    shapes: ClassVar[Mapping[str, type[LampShape]]] = {"distant": Cone}

    angle: float = 0.53
    axes: Axes = WORLD_AXES
    emission: Emission = WHITE

    @classmethod
    def example(cls) -> DistantLight:
        """Return a warm light above, to a side."""
        return cls(angle=60.0, axes=EXAMPLE_AXES, emission=EXAMPLE_EMISSION)

    def __post_init__(self) -> None:
        check_number("angle", self.angle, least=0.0)
        checked_axes(self.axes)
        if self.emission.falloff is not None:
            raise EnvironmentMapError("a distant light has no falloff: it is infinitely far")

    @property
    def size_factor(self) -> float:
        # UsdLux's formulas: 1 for an angle of 0, pi sin^2 of half the angle up to 180 degrees, pi (2 - sin^2) beyond.
        # The last two agree at 180 degrees.
        sine = math.sin(self._half_angle) ** 2
        return math.pi * ((sine if self._half_angle <= math.pi / 2.0 else 2.0 - sine) or 1.0 / math.pi)

    @property
    def versine(self) -> float:
        """1 - cos of the half angle of the cone `shape`."""
        return 2.0 * math.sin(max(self._half_angle, _MIN_HALF_ANGLE) / 2.0) ** 2

    @property
    def shape_numbers(self) -> tuple[float, ...]:
        return (self.versine,)

    @property
    def sizes(self) -> dict[str, float]:
        return {"angle": self.angle}

    @property
    def irradiance_per_nit(self) -> float:
        # The irradiance from a cone is pi sin^2 of half the angle. The colour of parallel light is an irradiance
        # already.
        return math.pi * math.sin(math.radians(min(self.angle, 180.0)) / 2.0) ** 2 if self.angle else 1.0

    def native_gap(self) -> str | None:
        too_wide = [f"an angle of {self.angle:g} degrees, more than 180"] if self.angle > 180.0 else []
        gaps = (*too_wide, *native.missing_shadow_features(self.emission))
        return native.missing_features(self.emission, "shadow", first=gaps)

    @property
    def emitted_radiance(self) -> Color:
        """The radiance in nits within the cone of `shape`, before `Shaping`."""
        r, g, b = (self._radiance_scale * channel for channel in self.emission.color)
        return r, g, b

    def _radiance_factor(self, point: Floats, direction: Floats) -> float:
        return self._radiance_scale

    @property
    def _half_angle(self) -> float:
        return math.radians(min(self.angle, 360.0)) / 2.0

    @property
    def _radiance_scale(self) -> float:
        """The factor of the radiance that keeps the irradiance if `shape` has widened a cone that was too narrow."""
        projected = math.pi * math.sin(_MIN_HALF_ANGLE) ** 2
        return 1.0 if self._half_angle >= _MIN_HALF_ANGLE else self.size_factor / projected


def _read(prim: PlacedPrim) -> UsdLightShape:
    light = DistantLight(angle=prim.light.number("inputs:angle", least=0.0), axes=prim.axes)
    return UsdLightShape(lambda _: light, size=light.size_factor)


DISTANT = LightKind(DistantLight, DistantLight.example, {"DistantLight": UsdLight(_read, LIGHT_ATTRIBUTES)})
