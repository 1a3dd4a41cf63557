"""The interface of the path tracer to the lights of a scene: one dome, or a rig of lamps and domes.

The class for one dome is here. The class for a rig is in `lookdev.mitsuba.rig`. Points are relative to the geometry's
centre; directions are in world space.

`turns` is a pair of rotations about z, in radians (`lookdev.mitsuba.view.KernelView`). `turns.x` rotates lights that
turn with the rig, and `turns.y` rotates all other lights. The other lights rotate, too, because the asset is fixed
here: the camera and the lights turn backwards instead.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

import drjit as dr

from lookdev.codegen.program.lamps import SHADOW_FIELDS, shadow_operations
from lookdev.light.dome import Dome
from lookdev.light.lamps import CodedRig
from lookdev.light.shape import FAR, INFINITE_DISTANCE
from lookdev.mitsuba import sobol
from lookdev.mitsuba.dome import DomeLight, NormalBin
from lookdev.mitsuba.lamps import LampRows
from lookdev.mitsuba.programs import Evaluation, Program
from lookdev.mitsuba.surface import Arriving, SurfacePoints
from lookdev.mitsuba.types import Bool, Color3f, Float, Mitsuba, Point3f, UInt, Vector2f, Vector3f

_SPLIT = ("diffuse", "specular")  # the controls that are factors of the light that these lobes reflect

LightSample = tuple[Vector3f, Color3f, Float, Float, tuple[Float, ...]]
"""A direction drawn from a light: direction, radiance, distance of the light, density, controls of the light.

`Lighting.draw` defines the radiance and the density. `SceneLights` defines the controls.
"""


class Direction:
    """Directions from which light arrives at a surface, drawn from the BSDF there.

    Parameters
    ----------
    w
        The directions.
    own_density
        The number of directions that are drawn from the BSDF, times their pdf. For a delta direction it is 1.
    weighed
        1, or 0 for delta directions, which are never drawn from lights. `Lighting.arriving` divides the radiance by
        ``own_density + weighed * d``, where d is the density of directions drawn from the lights. With 1, the result
        has the weight of the balance heuristic.
    occluders
        The distance of the first part that casts a shadow, for each set in `SceneLights.shadow_excluded`.
    active
        A mask; where it is false, no light arrives.
    is_straight
        Whether the light passes straight through a surface that is absent there, without reflection.

    The class is not a dataclass: Dr.Jit makes dataclasses part of the state of its loops.
    """

    def __init__(
        self,
        w: Vector3f,
        own_density: Float,
        weighed: float,
        occluders: list[Float],
        active: Bool,
        is_straight: bool = False,
    ) -> None:
        self.w, self.own_density, self.weighed = w, own_density, weighed
        self.occluders, self.active, self.is_straight = occluders, active, is_straight


class Lighting(Protocol):
    """The light at points of a surface, from which a given number of directions is drawn."""

    def arriving(self, direction: Direction) -> list[Arriving]:
        """Return the radiance that passes the occluders, divided by the density that `Direction` describes.

        The list is as in `SceneLights.split_by_group`: the sum over all lights, then over each recorded group.
        """

    def draw(self, index: UInt, number: UInt, seed: UInt, active: Bool) -> LightSample:
        """Draw direction `number` of sample `index` of a pixel from the lights.

        The density is the sum of the densities of all directions that are drawn from the lights at the point. The
        radiance is multiplied by q / p. Here, q is the light's pdf in that sum, and p is the pdf with which the
        direction is really drawn: a dome draws from a table, whose pdf p only approximates q.
        """


class SceneLights(ABC):
    """All lights of a scene.

    The controls of a light are a tuple of numbers that determine its shadows, its effect on lobes, and its recording. A
    control that no light of the scene needs is left out. In order:

    - ``spares``: the index in `shadow_excluded` of the set of groups of parts that cast no shadow of the light;
    - `SHADOW_FIELDS`: whether the light casts shadows; the distance in metres at which shadows end; the width of the
      zone before this distance, where shadows fade; the exponent of the fading; the colour of shadows;
    - ``diffuse`` and ``specular`` (`_SPLIT`): the factors of the light that these lobes reflect;
    - ``group``: the index of the group of lights in which the light is recorded.

    Attributes
    ----------
    sampled
        Whether directions are drawn from lights.
    visible
        Whether the camera sees some lights.
    groups
        The number of groups of lights whose light is recorded separately.
    shadow_excluded
        The distinct sets of parts that lights exclude from their shadows. A set has the indices of groups of parts. If
        no light excludes any part, there is a single set, which is empty.
    shadowed
        Whether the shadow of some light differs from the default, which is black and has no end. Only then does the
        share of light that passes an occluder depend on the distance from the shading point to the occluder.
    split
        Whether the factors of some light for diffuse and specular lobes are not 1.
    """

    sampled = True
    visible = False

    def __init__(self, mi: Mitsuba, rig: CodedRig, groups: int = 0) -> None:
        self._mi = mi
        self.groups = groups
        self.shadow_excluded = rig.shadow_excluded or ((),)
        self.shadowed, self.split = rig.needs("shadowed"), rig.needs("split")
        self._control_names = (
            *["spares"] * bool(rig.shadow_excluded),
            *(SHADOW_FIELDS * self.shadowed),
            *(_SPLIT * self.split),
        )
        self._control_names += ("group",) * bool(groups)
        self._shadow_program = Program(*shadow_operations(), mi.Float)

    @abstractmethod
    def at(self, surface: SurfacePoints, turns: Vector2f, count: UInt, both_sides: bool) -> Lighting:
        """Return the light at a surface. From it, `count` directions are drawn: in front, or on `both_sides`."""

    def camera_radiance(
        self, start: Point3f, w: Vector3f, turns: Vector2f, distance: Float
    ) -> tuple[list[Color3f], Bool]:
        """Return the radiance of the visible lights along rays of the camera, and a mask of rays that hit one.

        Only lights nearer than `distance` count. The radiance is a list: the sum over all lights, then over each
        recorded group.
        """
        return [self._mi.Color3f(0.0)], self._mi.Bool(False)

    def controls(self, rows: LampRows, lamp: UInt) -> tuple[Float, ...]:
        """Return the controls of lamps, an argument of `shadow_shares`."""
        return tuple(rows.field(lamp, name) for name in self._control_names)

    @property
    def no_controls(self) -> tuple[Float, ...]:
        """The controls, all 0, of a sample for which no light was selected."""
        return tuple(self._mi.Float(0.0) for _ in self._control_names)

    def split_by_group(self, controls: tuple[Float, ...], arriving: Arriving) -> list[Arriving]:
        """Return a list of the light from one light: all of it, then all of it or 0 for each recorded group."""
        specular, diffuse = arriving
        masks = [controls[-1] == number for number in range(self.groups)]
        return [
            arriving,
            *((dr.select(in_group, specular, 0.0), dr.select(in_group, diffuse, 0.0)) for in_group in masks),
        ]

    def excludes(self, controls: tuple[Float, ...], number: int) -> Bool:
        """Return where lights exclude the set of parts `number` of `shadow_excluded` from their shadows."""
        return controls[0] == number if len(self.shadow_excluded) > 1 else self._mi.Bool(True)

    def shadow_shares(
        self, controls: tuple[Float, ...], distance: Float, occluders: list[Float], is_straight: bool = False
    ) -> Arriving:
        """Return the shares of a light that pass the occluders and reach the specular and the diffuse lobes.

        distance : the distance of the light; occluders : the distance of the first occluder for each set in
        `shadow_excluded`; is_straight : whether the light passes straight through the surface. It then meets no lobe,
        and the factors of lobes do not apply.
        """
        mi = self._mi
        values = dict(zip(self._control_names, controls, strict=True))
        occluder = occluders[0]
        for number in range(1, len(self.shadow_excluded)):
            occluder = dr.select(values["spares"] == number, occluders[number], occluder)
        occluded = distance > occluder
        transmitted = mi.Color3f(0.0)
        if self.shadowed:

            def value(name: str) -> Float:
                """Return the value of a symbol of the shadow's program."""
                return dr.select(occluded, occluder, 0.0) if name == "distance" else values[name]

            transmitted = mi.Color3f(*Evaluation(self._shadow_program, value).values("passed"))
        share = dr.select(occluded, transmitted, mi.Color3f(1.0))
        if is_straight or not self.split:
            return share, share
        return share * values["specular"], share * values["diffuse"]


def split_count(count: UInt) -> tuple[UInt, UInt]:
    """Return how many of `count` directions are drawn in front of a surface, and behind it, as in the OSL shader."""
    return count - count // 2, count // 2


def rotate_z(v: Vector3f, angle: Float) -> Vector3f:
    """Return vectors rotated about z, counter-clockwise seen from above."""
    s, c = dr.sincos(angle)
    return type(v)(c * v.x - s * v.y, s * v.x + c * v.y, v.z)


class OneDome(SceneLights):
    """A single dome in world axes, which `turns.x` rotates.

    The directions of all samples of a pixel are stratified over the slots of the dome's table. A slot is a piece of the
    curve through the dome's points (`lookdev.light.dome.slots`).
    """

    def __init__(self, mi: Mitsuba, dome: Dome) -> None:
        super().__init__(mi, CodedRig.from_lights((dome,)))
        self._dome = DomeLight(mi, dome)
        self.sampled = self._dome.sampled

    def at(self, surface: SurfacePoints, turns: Vector2f, count: UInt, both_sides: bool) -> Lighting:
        """Return the light of the dome at a surface, as `SceneLights.at`."""
        return _DomeLighting(self._mi, self._dome, surface, turns.x, count, both_sides and self.sampled)


class _DomeLighting:
    """The light of a dome at points of a surface. `turn` is the rotation of the dome."""

    def __init__(
        self, mi: Mitsuba, dome: DomeLight, surface: SurfacePoints, turn: Float, drawn_count: UInt, both_sides: bool
    ) -> None:
        self._mi, self._dome, self._turn = mi, dome, turn
        self._bins: list[tuple[UInt, NormalBin]] = []
        if dome.sampled:
            counts = split_count(drawn_count) if both_sides else (drawn_count,)
            normals = (surface.normal, -surface.normal)
            self._bins = [(count, dome.bin(rotate_z(n, -turn))) for count, n in zip(counts, normals, strict=False)]

    def arriving(self, direction: Direction) -> list[Arriving]:
        """Return the light from the dome, as `Lighting.arriving`."""
        active = direction.active & (direction.occluders[0] >= FAR)
        local = rotate_z(direction.w, -self._turn)
        radiance = self._dome.radiance(local, active)
        density = direction.own_density + direction.weighed * self._density(local, radiance)
        arriving_light = dr.select(active, radiance / density, 0.0)
        return [(arriving_light, arriving_light)]

    def draw(self, index: UInt, number: UInt, seed: UInt, active: Bool) -> LightSample:
        """Draw a direction, as `Lighting.draw`. The first directions are in front of the surface, the others behind."""
        start = sobol.hash_integers(seed ^ 0x2545F491)  # an arbitrary constant, so that other uses of the seed differ
        front, bin = self._bins[0]
        back = number >= front
        sample = bin.draw_numbered(start ^ (index * front + number), seed, active)
        if len(self._bins) > 1:
            behind, other = self._bins[1]
            back_sample = other.draw_numbered(start ^ (index * behind + number - front), seed + 1, active)
            sample = dr.select(back, back_sample, sample)
        local, radiance, ratio = sample
        density = self._density(local, radiance)
        return rotate_z(local, self._turn), ratio * radiance, self._mi.Float(INFINITE_DISTANCE), density, ()

    def _density(self, local: Vector3f, radiance: Color3f) -> Float:
        """Return the density of all directions drawn from the dome; `local` is a direction in the dome's axes."""
        total = self._mi.Float(0.0)
        for count, bin in self._bins:
            total += self._mi.Float(count) * bin.pdf(local, radiance)
        return total
