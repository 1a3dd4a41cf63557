"""Lights: radiance, pdf and sampling in NumPy, and what renderers, readers and reports need of each.

A kind of light is a frozen dataclass of plain data that derives from `Light`, and a `LightKind` in
`lookdev.light.kinds.LIGHT_KINDS`. Its lights are lamps, which have `shapes`, or show the map of a dome light, or shine
alone, by a file of OSL sections.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib.resources.abc import Traversable
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from lookdev.cache import Content
from lookdev.light.emission import Color, Emission
from lookdev.light.mapping import rotate_z
from lookdev.light.placement import WORLD_AXES, Axes, Vector
from lookdev.space import REC709, Space

if TYPE_CHECKING:
    from lookdev.light.dome import Dome
    from lookdev.light.usd import UsdLight

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


class Light(ABC):
    """An `Emitter` of a registered kind: a frozen dataclass of plain data that names its files.

    The defaults are those of light that arrives from infinitely far, and that neither Blender nor Mitsuba has.
    """

    kind: ClassVar[str]
    """The name of its record in `LIGHT_KINDS`."""

    version: ClassVar[int] = 1
    """Part of its digest: raised when the same fields give other light or other samples."""

    far: ClassVar[bool] = True
    """Whether it is infinitely far: all places see the same."""

    one_sided: ClassVar[bool] = False
    """Whether it sends along its -z alone, so that its axes matter whatever its `Shaping`."""

    position: Vector | None = None
    """Where it stands, in metres; None where it stands nowhere."""

    shapes: ClassVar[Mapping[str, type[Any]]] = {}
    """The types of a lamp's `lookdev.light.shape.Shape`, by the names of their functions in generated code."""

    @property
    @abstractmethod
    def emission(self) -> Emission:
        """What it sends out. `radiance` has its colour, shaping and falloff; the rest is for whoever integrates."""

    @property
    def digest(self) -> str:
        """Digest of everything that the light's radiance and sampling depend on."""
        return hashlib.sha256(
            f"{self.kind} {self.version} {self.with_emission(self.emission.unnamed)!r}".encode()
        ).hexdigest()

    @abstractmethod
    def radiance(self, place: Floats, direction: Floats) -> Floats: ...

    @abstractmethod
    def pdf(self, place: Floats, direction: Floats) -> Floats: ...

    @abstractmethod
    def sample(self, place: Floats, u: Floats) -> Floats: ...

    @abstractmethod
    def distance(self, place: Floats, direction: Floats) -> Floats: ...

    @property
    def constant(self) -> bool:
        """Whether the radiance is the same from every direction at every place: then it needs no samples."""
        return False

    @property
    def axes(self) -> Axes:
        """Its own x, y and z in the world."""
        return WORLD_AXES

    @property
    def reach(self) -> float:
        """Metres from its position to its farthest point."""
        return 0.0

    @property
    def sizes(self) -> Mapping[str, float]:
        """Its sizes by their names for a report, in metres or degrees."""
        return {}

    @property
    def irradiance_per_nit(self) -> float | None:
        """The irradiance in lux of radiance 1 at right angles; None where the value of a light is its radiance."""
        return None

    @property
    def sent(self) -> Color:
        """The radiance in nits, before its texture, `Shaping` and `Falloff`."""
        return self.emission.color

    @property
    def map_dome(self) -> Dome | None:
        """The dome light whose map it shows, if it shows one."""
        return None

    @property
    def shape_name(self) -> str:
        """The name of a lamp's shape in `shapes`; "" where it is no lamp."""
        return next(iter(self.shapes), "")

    @property
    def shape_numbers(self) -> tuple[float, ...]:
        """The numbers, at most two, by which generated code has the shape of a lamp or the ball of a dome."""
        return ()

    def with_emission(self, emission: Emission) -> Self:
        """Return a light that sends something else."""
        return replace(self, emission=emission)  # type: ignore[type-var]

    def scaled(self, scale: float, origin: Vector) -> Self:
        """Return a light whose lengths are `scale` times as long, moved from the world's origin to `origin`, in metres.

        What it lights is scaled and moved along: places at `scale` times their distance see the same radiance from it.
        """
        return self.with_emission(self.emission.scaled(scale))

    def in_space(self, space: Space) -> Self:
        """Return a light of linear Rec.709 as it is in a space.

        What filters its light, as the colour of its shadow does, leaves there what it leaves of this light in Rec.709.
        """
        return self if space == REC709 else self._converted(space)

    def _converted(self, space: Space) -> Self:
        return self.with_emission(self.emission.in_space(space))

    def may_reach(self, center: Vector, radius: float) -> bool:
        """Return whether light may arrive in a sphere, whatever occludes it; False is certain."""
        return any(self.emission.color)

    def native_gap(self) -> str | None:
        """Return what of the light Cycles' own lights cannot show (`lookdev.light.native`); None: they show it."""
        return "a kind that Blender does not have"

    @property
    def native_images(self) -> tuple[Content, ...]:
        """The linear EXR files that Cycles' own lights read to show it."""
        return ()

    @property
    def mitsuba_shape(self) -> tuple[str, NDArray[np.float64]] | None:
        """The name of the shape of Mitsuba 3 that sends its light, and the matrix (4, 4) to the light's own space.

        None: Mitsuba's own emitters have none.
        """
        return None


class CodedLight(Light):
    """A light of a kind that has OSL of its own."""

    @abstractmethod
    def code(self, *, sampled: bool) -> LightCode:
        """Return the values for the kind's OSL; without `sampled`, those to look radiance up."""


@dataclass(frozen=True)
class LightKind:
    """The record of a kind of light.

    Parameters
    ----------
    type
        The dataclass of its lights.
    example
        Returns a small light of the kind that is not `constant`, for tests and documentation.
    usd
        The readers of its prims, by their types in USD.
    osl
        The file of its OSL, by sections; `lookdev.codegen.osl.light` states the content of each: its lights are each a
        `CodedLight`. None: they are lights of a rig (`lookdev.light.lamps`).
    """

    type: type[Light]
    example: Callable[[], Light]
    usd: Mapping[str, UsdLight] = field(default_factory=dict)
    osl: Traversable | None = None


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
