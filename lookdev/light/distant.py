"""Distant light: `UsdLuxDistantLight`."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lookdev.errors import EnvironmentMapError
from lookdev.light.cone import draw_uniform, uniform_density
from lookdev.light.emission import WHITE, Emission, check_number
from lookdev.light.placed import EXAMPLE_AXES, EXAMPLE_EMISSION, VERSION
from lookdev.light.placement import WORLD_AXES, Axes, checked_axes, to_local, to_world
from lookdev.light.protocol import LightCode

Floats = NDArray[np.float64]

_NARROWEST = math.radians(0.005)  # half an angle that float32 can tell from 0


@dataclass(frozen=True, kw_only=True)
class DistantLight:
    """A cone of directions about its +z, of `angle` degrees from side to side, infinitely far: it emits along its -z.

    An angle of 0 is parallel light of irradiance `emission.color`.
    """

    kind: ClassVar[str] = "distant"
    constant: ClassVar[bool] = False

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
    def digest(self) -> str:
        return hashlib.sha256(f"{self.kind} {VERSION} {self!r}".encode()).hexdigest()

    @property
    def size_factor(self) -> float:
        """Steradians by which the radiance is divided where the power is normalized: `UsdLuxLightAPI`."""
        # sin^2 loses its digits near 180 degrees, where cos^2 keeps them, and both formulas of UsdLux are continuous.
        sine = math.sin(self._half) ** 2
        return math.pi * ((sine if self._half <= math.pi / 2.0 else 2.0 - sine) or 1.0 / math.pi)

    def radiance(self, place: Floats, direction: Floats) -> Floats:
        towards = to_local(self.axes, direction)
        lit = self._lit(towards)
        sent = np.where(lit[..., None], self._scale * self.emission.towards(towards), 0.0)
        return np.broadcast_to(sent, np.broadcast_shapes(sent.shape, place.shape))

    def pdf(self, place: Floats, direction: Floats) -> Floats:
        pdf = np.where(self._lit(to_local(self.axes, direction)), uniform_density(np.array(self._versine)), 0.0)
        return np.broadcast_to(pdf, np.broadcast_shapes(pdf.shape, place.shape[:-1]))

    def sample(self, place: Floats, u: Floats) -> Floats:
        return to_world(self.axes, draw_uniform(np.array(self._versine), u))

    def distance(self, place: Floats, direction: Floats) -> Floats:
        return np.full(np.broadcast_shapes(place.shape, direction.shape)[:-1], np.inf)

    def code(self, *, sampled: bool) -> LightCode:
        raise EnvironmentMapError(f"backend 'exact' cannot render a light of kind '{self.kind}' yet")

    def _lit(self, local: Floats) -> NDArray[np.bool_]:
        # By the chord, which keeps its digits where the cosine is near 1.
        chord = local - np.array((0.0, 0.0, 1.0))
        return np.asarray((chord * chord).sum(axis=-1) <= 2.0 * self._versine)

    @property
    def _half(self) -> float:
        return math.radians(min(self.angle, 360.0)) / 2.0

    @property
    def _versine(self) -> float:
        """1 - cos of half the angle of the cone that is drawn."""
        return 2.0 * math.sin(max(self._half, _NARROWEST) / 2.0) ** 2

    @property
    def _scale(self) -> float:
        """What the radiance is multiplied by: a cone that is too narrow is drawn wider, with the same irradiance."""
        wide = math.pi * math.sin(_NARROWEST) ** 2
        return 1.0 if self._half >= _NARROWEST else self.size_factor / wide
