"""A light that has a place: what the kinds of finite size share.

A light's own space is that of UsdLux: its shape is centered at the origin, and what emits from one side emits along -z,
which is also the axis of its `Shaping`. Its size is in metres of the world: there is no scale besides.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lookdev.light.emission import WHITE, Emission, check_number
from lookdev.light.placement import WORLD_AXES, Axes, Vector, checked_axes, to_local, to_world
from lookdev.light.shape import FAR, Shape

Floats = NDArray[np.float64]

VERSION = 1
"""Part of every digest: raised when the same fields give other light or other samples."""

EXAMPLE_AXES: Axes = ((1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, -0.6, 0.8))
EXAMPLE_EMISSION = Emission((3.0, 2.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class PlacedLight(ABC):
    """A shape at `position`, in metres, turned by `axes`.

    Methods with an underscore are in the light's own space.
    """

    kind: ClassVar[str]
    constant: ClassVar[bool] = False

    position: Vector = (0.0, 0.0, 0.0)
    axes: Axes = WORLD_AXES
    emission: Emission = WHITE

    def __post_init__(self) -> None:
        for value in self.position:
            check_number("position", value)
        checked_axes(self.axes)

    @property
    def digest(self) -> str:
        return hashlib.sha256(
            f"{self.kind} {VERSION} {replace(self, emission=self.emission.unnamed)!r}".encode()
        ).hexdigest()

    @property
    @abstractmethod
    def shape(self) -> Shape:
        """What is placed."""

    @property
    @abstractmethod
    def reach(self) -> float:
        """Metres from the position to the farthest point."""

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

    def _inside(self, place: Floats) -> Floats:
        return to_local(self.axes, place - np.array(self.position))

    def _sent(self, place: Floats, direction: Floats) -> Floats | float:
        """Return the share (..., 3) of the emission that is sent from what is met; 1 unless a kind has a texture."""
        return 1.0

    def _pdf(self, place: Floats, direction: Floats) -> Floats:
        return np.asarray(self.shape.pdf(place, direction))

    def _sample(self, place: Floats, u: Floats) -> Floats:
        return np.asarray(self.shape.sample(place, u))
