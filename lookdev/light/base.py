"""The interface of a light: radiance, pdf and sampling in NumPy, and the data that renderers and reports read.

A kind of light is a frozen dataclass that derives from `Light`, and has a `LightKind` in
`lookdev.light.kinds.LIGHT_KINDS`. Lamps have `shapes`, and domes have a map (`map_dome`); several lamps and domes
form a rig. A kind can also have OSL of its own (`LightKind.osl`), which renders a light that is the only one of its
scene. A kind that is neither a lamp nor a dome needs such OSL.
"""

from __future__ import annotations

import hashlib
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib.resources.abc import Traversable
from typing import TYPE_CHECKING, ClassVar, Protocol, Self

import numpy as np

from lookdev.arrays import Floats, Floats32
from lookdev.cache import Content
from lookdev.light.emission import Emission
from lookdev.light.mapping import rotate_z
from lookdev.light.placement import WORLD_AXES, Axes, Vector
from lookdev.light.shape import LampShape
from lookdev.space import REC709, Color, Space

if TYPE_CHECKING:
    from lookdev.light.dome import Dome
    from lookdev.light.usd import UsdLight


@dataclass(frozen=True)
class LightCode:
    """The values that the OSL of a light, or of a whole rig, reads.

    Parameters
    ----------
    constants
        Preprocessor lines at the start of the shader.
    parameters
        Values of scalar and string parameters by name; for a file, the parameter is its path.
    arrays
        ``.npy`` files of array parameters by name.
    numbers
        Values of the array parameters that have no file, by name.
    """

    constants: tuple[str, ...] = ()
    parameters: Mapping[str, Content | str | int | float] = field(default_factory=dict)
    arrays: Mapping[str, Content] = field(default_factory=dict)
    numbers: Mapping[str, Floats32] = field(default_factory=dict)


class Emitter(Protocol):
    """A source of light that arrives at shading points; all numbers are float64.

    Points (..., 3) are in metres, directions (..., 3) are unit vectors from the point towards the light. Both are in
    world space and broadcast with each other.
    """

    @abstractmethod
    def radiance(self, point: Floats, direction: Floats) -> Floats:
        """Return the radiance (..., 3) that arrives, linear Rec.709."""

    @abstractmethod
    def pdf(self, point: Floats, direction: Floats) -> Floats:
        """Return the density (...) per steradian with which `sample` draws the directions at `point`."""

    @abstractmethod
    def sample(self, point: Floats, u: Floats) -> Floats:
        """Map points `u` (N, 2) of the unit square to directions (N, 3) at shading points (N, 3)."""

    @abstractmethod
    def distance(self, point: Floats, direction: Floats) -> Floats:
        """Return metres (...) to the light; inf where the light is infinitely far, or not in that direction."""


class Light(Emitter):
    """An emitter of a registered kind: a frozen dataclass of plain data, in which files are `Content` of the cache.

    The defaults of its members describe a light that is infinitely far, and that neither Blender nor Mitsuba has.
    """

    kind: ClassVar[str]
    """The key of its `LightKind` in `LIGHT_KINDS`."""

    version: ClassVar[int] = 1
    """The version of the kind's code, part of `digest`: raise it when equal fields give other radiance or samples."""

    is_infinitely_far: ClassVar[bool] = True
    """Whether it is infinitely far: its radiance depends on the direction alone."""

    one_sided: ClassVar[bool] = False
    """Whether it emits along its -z axis, not to all sides. Then its axes matter even without `Shaping`."""

    position: Vector | None = None
    """Its position in metres; None if it has none."""

    shapes: ClassVar[Mapping[str, type[LampShape]]] = {}
    """The shapes that lamps of this kind can have, by their names in generated code; empty for other lights."""

    @property
    @abstractmethod
    def emission(self) -> Emission:
        """Its emission. `radiance` includes colour, shaping and falloff; renderers apply the other fields."""

    @property
    def digest(self) -> str:
        """Digest of all that its radiance and its sampling depend on."""
        unnamed = self.with_emission(self.emission.without_names)
        return hashlib.sha256(f"{self.kind} {self.version} {unnamed!r}".encode()).hexdigest()

    def distance(self, point: Floats, direction: Floats) -> Floats:
        return np.full(np.broadcast_shapes(point.shape, direction.shape)[:-1], np.inf)

    @property
    def constant(self) -> bool:
        """Whether the radiance is the same from every direction at every point. Then it needs no samples."""
        return False

    @property
    def axes(self) -> Axes:
        """Its own x, y and z axes in world space."""
        return WORLD_AXES

    @property
    def reach(self) -> float:
        """Metres from its position to its farthest point."""
        return 0.0

    @property
    def sizes(self) -> Mapping[str, float]:
        """Its sizes in metres or degrees, by their names in a report."""
        return {}

    @property
    def irradiance_per_nit(self) -> float | None:
        """The irradiance in lux at normal incidence that radiance 1 gives; None if reports state the radiance."""
        return None

    @property
    def emitted_radiance(self) -> Color:
        """Its radiance in nits, before texture, `Shaping` and `Falloff`."""
        return self.emission.color

    @property
    def map_dome(self) -> Dome | None:
        """The `Dome` with the light's map, which can be the light itself; None if it has no map."""
        return None

    @property
    def world_dome(self) -> Dome | None:
        """Its `map_dome` if it is infinitely far, else None. Such a dome is a world in Blender or Mitsuba."""
        return self.map_dome if self.is_infinitely_far else None

    @property
    def shape_name(self) -> str:
        """The name in `shapes` of the lamp's shape; "" if the light is not a lamp."""
        return next(iter(self.shapes), "")

    @property
    def shape_numbers(self) -> tuple[float, ...]:
        """At most two numbers for generated code: sizes of a lamp's shape, or radii of a local dome's sphere."""
        return ()

    def with_emission(self, emission: Emission) -> Self:
        """Return the light with another emission."""
        return replace(self, emission=emission)  # type: ignore[type-var]

    def rescale(self, scale: float, origin: Vector) -> Self:
        """Return the light with all lengths multiplied by `scale`, and then moved by the vector `origin` in metres.

        A point that is scaled and moved in the same way receives the same radiance from the light.
        """
        return self.with_emission(self.emission.scale_lengths(scale))

    def in_space(self, space: Space) -> Self:
        """Return the light, whose values are linear Rec.709, in another colour space.

        A factor of the light, such as the colour of its shadow, is converted, too: the product of light and factor is
        the same colour in both spaces.
        """
        return self if space == REC709 else self._convert(space)

    def _convert(self, space: Space) -> Self:
        return self.with_emission(self.emission.in_space(space))

    def may_reach(self, center: Vector, radius: float) -> bool:
        """Return whether the light may reach a sphere, if nothing occludes it; False is certain, True is not."""
        return any(self.emission.color)

    def native_gap(self) -> str | None:
        """Return the features of the light that Cycles' own lights lack, as a phrase for a message; None without any.

        `lookdev.light.native.missing_features` finds the features of an emission.
        """
        return "a kind that Blender does not have"

    @property
    def native_images(self) -> tuple[Content, ...]:
        """The linear EXR files that Cycles' own lights read to render it."""
        return ()

    @property
    def mitsuba_shape(self) -> tuple[str, Floats] | None:
        """The name of the Mitsuba 3 shape that emits the light, and the matrix (4, 4) from its space to the light's.

        None if Mitsuba has no such shape.
        """
        return None


class CodedLight(Light):
    """A light of a kind that has OSL of its own."""

    @abstractmethod
    def code(self, *, sampled: bool) -> LightCode:
        """Return the values for the kind's OSL; without `sampled`, only those for looking up radiance."""


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
        The readers of its prims, by the USD type names of the prims.
    osl
        The file of the kind's OSL; `lookdev.codegen.osl.light` describes the sections of the file. The kind's lights
        are then `CodedLight`. None if the lights are always rendered as part of a rig (`lookdev.light.lamps`).
    """

    type: type[Light]
    example: Callable[[], Light]
    usd: Mapping[str, UsdLight] = field(default_factory=dict)
    osl: Traversable | None = None


@dataclass(frozen=True)
class PosedLight:
    """An `Emitter` rotated by `degrees` about the vertical `axis` (x, y), counter-clockwise seen from above."""

    light: Emitter
    degrees: float
    axis: tuple[float, float] = (0.0, 0.0)

    def radiance(self, point: Floats, direction: Floats) -> Floats:
        return self.light.radiance(self._unrotate(point), rotate_z(direction, -self.degrees))

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        return self.light.pdf(self._unrotate(point), rotate_z(direction, -self.degrees))

    def sample(self, point: Floats, u: Floats) -> Floats:
        return rotate_z(self.light.sample(self._unrotate(point), u), self.degrees)

    def distance(self, point: Floats, direction: Floats) -> Floats:
        return self.light.distance(self._unrotate(point), rotate_z(direction, -self.degrees))

    def _unrotate(self, point: Floats) -> Floats:
        axis = np.array((*self.axis, 0.0))
        return np.asarray(rotate_z(point - axis, -self.degrees) + axis)
