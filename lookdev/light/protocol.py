"""Lights: radiance, pdf and sampling in NumPy, and the values that the OSL of their kind takes.

A kind of light is a frozen dataclass of plain data that satisfies `Light`, a file of OSL sections, and a `LightKind` in
`lookdev.light.LIGHT_KINDS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.resources.abc import Traversable
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from lookdev.cache import Content
from lookdev.light.emission import Emission
from lookdev.light.mapping import rotate_z

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LightCode:
    """The values that the OSL of a kind takes for one light.

    `constants` are preprocessor lines at the start of the shader, `parameters` the values of shader parameters by name
    (of a file, its path), `arrays` the ``.npy`` files of array parameters by name, `numbers` the values of others.
    """

    constants: tuple[str, ...] = ()
    parameters: Mapping[str, Content | str | int | float] = field(default_factory=dict)
    arrays: Mapping[str, Content] = field(default_factory=dict)
    numbers: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)


class Emitter(Protocol):
    """Light that arrives at places of the world, float64.

    Places (..., 3) are in metres, directions (..., 3) are unit vectors from the place towards the light; both are in
    world space and broadcast with each other.
    """

    def radiance(self, place: Floats, direction: Floats) -> Floats:
        """Return the radiance (..., 3) that arrives, linear Rec.709."""

    def pdf(self, place: Floats, direction: Floats) -> Floats:
        """Return the density (...) per steradian with which `sample` draws the directions at `place`."""

    def sample(self, place: Floats, u: Floats) -> Floats:
        """Map points `u` (N, 2) of the unit square to directions (N, 3) at places (N, 3)."""

    def distance(self, place: Floats, direction: Floats) -> Floats:
        """Return metres (...) to the light: inf where it is infinitely far, or not in that direction."""


class Light(Emitter, Protocol):
    """A light of a registered kind: a frozen dataclass of plain data that names its files."""

    kind: ClassVar[str]
    """The name of its record in `lookdev.light.LIGHT_KINDS`."""

    @property
    def emission(self) -> Emission:
        """What it sends out. `radiance` has its colour, shaping and falloff; the rest is for whoever integrates."""

    @property
    def digest(self) -> str:
        """Digest of everything that the light's radiance and sampling depend on."""

    @property
    def constant(self) -> bool:
        """Whether the radiance is the same from every direction at every place: then it needs no samples."""


class CodedLight(Light, Protocol):
    """A light of a kind that has OSL of its own."""

    def code(self, *, sampled: bool) -> LightCode:
        """Return the values for the kind's OSL; without `sampled`, those to look radiance up."""


@dataclass(frozen=True)
class LightKind:
    """The record of a kind of light.

    Parameters
    ----------
    type
        The dataclass of its lights.
    osl
        The file of its OSL, by sections; `lookdev.codegen.osl.light` states the content of each: its lights are each a
        `CodedLight`. None: they are lights of a rig (`lookdev.light.lamps`).
    example
        Returns a small light of the kind that is not `constant`, for tests and documentation.
    native_gap
        Returns what of a light Cycles' own lights cannot show (`lookdev.light.native`); None: they show it.
    native_images
        Returns the linear EXR files that they read.
    """

    type: type[Light]
    osl: Traversable | None
    example: Callable[[], Light]
    native_gap: Callable[[Any], str | None] = lambda light: "a kind that Blender does not have"
    native_images: Callable[[Any], tuple[Content, ...]] = lambda light: ()


@dataclass(frozen=True)
class Turned:
    """An `Emitter` rotated about a vertical `axis`, x and y, by `degrees`, counter-clockwise seen from above."""

    light: Emitter
    degrees: float
    axis: tuple[float, float] = (0.0, 0.0)

    def radiance(self, place: Floats, direction: Floats) -> Floats:
        return self.light.radiance(self._back(place), rotate_z(direction, -self.degrees))

    def pdf(self, place: Floats, direction: Floats) -> Floats:
        return self.light.pdf(self._back(place), rotate_z(direction, -self.degrees))

    def sample(self, place: Floats, u: Floats) -> Floats:
        return rotate_z(self.light.sample(self._back(place), u), self.degrees)

    def distance(self, place: Floats, direction: Floats) -> Floats:
        return self.light.distance(self._back(place), rotate_z(direction, -self.degrees))

    def _back(self, place: Floats) -> Floats:
        axis = np.array((*self.axis, 0.0))
        return np.asarray(rotate_z(place - axis, -self.degrees) + axis)
