"""A light that has a place: what the kinds of finite size share.

A light's own space is that of UsdLux: its shape is centered at the origin, and what emits from one side emits along -z,
which is also the axis of its `Shaping`. Its size is in metres of the world: there is no scale besides.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lookdev.errors import EnvironmentMapError
from lookdev.light.emission import Emission, check_number
from lookdev.light.placement import WORLD_AXES, Axes, Vector, checked_axes, to_local, to_world
from lookdev.light.protocol import LightCode

Floats = NDArray[np.float64]

VERSION = 1
"""Part of every digest: raised when the same fields give other light or other samples."""


@dataclass(frozen=True, kw_only=True)
class PlacedLight(ABC):
    """A shape at `position`, in metres, turned by `axes`.

    Kinds implement the methods with an underscore, in the light's own space.
    """

    kind: ClassVar[str]
    constant: ClassVar[bool] = False

    position: Vector = (0.0, 0.0, 0.0)
    axes: Axes = WORLD_AXES
    emission: Emission = Emission()

    def __post_init__(self) -> None:
        for value in self.position:
            check_number("position", value)
        checked_axes(self.axes)

    @property
    def digest(self) -> str:
        return hashlib.sha256(f"{self.kind} {VERSION} {self!r}".encode()).hexdigest()

    @property
    @abstractmethod
    def size_factor(self) -> float:
        """Square metres by which the radiance is divided where the power is normalized: `UsdLuxLightAPI`."""

    def radiance(self, place: Floats, direction: Floats) -> Floats:
        local, towards = self._inside(place), to_local(self.axes, direction)
        distance = self._distance(local, towards)
        met = np.isfinite(distance)
        sent = self._sent(local, towards, np.where(met, distance, 0.0))
        arriving = sent * self.emission.towards(towards) * self.emission.faded(np.linalg.norm(local, axis=-1))[..., None]
        return np.where(met[..., None], arriving, 0.0)

    def pdf(self, place: Floats, direction: Floats) -> Floats:
        return self._pdf(self._inside(place), to_local(self.axes, direction))

    def sample(self, place: Floats, u: Floats) -> Floats:
        return to_world(self.axes, self._sample(self._inside(place), u))

    def distance(self, place: Floats, direction: Floats) -> Floats:
        return self._distance(self._inside(place), to_local(self.axes, direction))

    def code(self, *, sampled: bool) -> LightCode:
        raise EnvironmentMapError(f"backend 'exact' cannot render a light of kind '{self.kind}' yet")

    def _inside(self, place: Floats) -> Floats:
        return to_local(self.axes, place - np.array(self.position))

    def _sent(self, place: Floats, direction: Floats, distance: Floats) -> Floats | float:
        """Return the share of the emission (..., 3) that what is met at a distance sends; 1 unless overridden."""
        return 1.0

    @abstractmethod
    def _distance(self, place: Floats, direction: Floats) -> Floats: ...

    @abstractmethod
    def _pdf(self, place: Floats, direction: Floats) -> Floats: ...

    @abstractmethod
    def _sample(self, place: Floats, u: Floats) -> Floats: ...
