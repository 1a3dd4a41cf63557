"""The interface of the estimator to a scene's lights: one dome, or a rig of lamps and domes (`lookdev.mitsuba.rig`).

Points are about the geometry's centre, directions in world space. `turns` are two angles in radians: that of lights
that turn with the rig, and that of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import drjit as dr

from lookdev.light.dome import Dome
from lookdev.light.shape import FAR, INFINITE
from lookdev.mitsuba import sobol
from lookdev.mitsuba.dome import DomeLight, NormalBin
from lookdev.mitsuba.surface import Arriving, Surface
from lookdev.mitsuba.types import Bool, Color3f, Float, Mitsuba, Point3f, UInt, Vector2f, Vector3f

LightSample = tuple[Vector3f, Color3f, Float, Float, tuple[Float, ...]]
"""A direction from a light, its radiance, its distance, its density, and the light's controls."""


class Lighting(Protocol):
    """The light at points of a surface, from which a number of directions is drawn."""

    def arriving(
        self, w: Vector3f, own_density: Float, weighed: float, occluders: list[Float], active: Bool, straight: bool
    ) -> list[Arriving]:
        """Return the sum over lights of unoccluded radiance over density, as `Lights.by_group`.

        A density is `own_density`, plus the density of directions drawn from the light if `weighed` is 1. `occluders`
        has the distance of the first part that casts shadows, for each set of `Lights.shadow_excluded`. Light that is
        `straight` is not reflected.
        """

    def draw(self, index: UInt, number: UInt, seed: UInt, active: Bool) -> LightSample:
        """Return direction `number` of sample `index`, its radiance, distance, the density of all directions, controls.

        The radiance is multiplied by the ratio of that density to the one with which the direction was drawn.
        """


class Lights(Protocol):
    """All lights of a scene. `sampled` says whether directions are drawn from them."""

    sampled: bool
    shadow_excluded: Sequence[tuple[int, ...]]  # the sets of groups of parts that the shadows of some light exclude
    shadowed: bool  # the light that passes an occluder depends on its distance
    split: bool  # diffuse and specular lobes reflect different light
    visible: bool  # the camera sees some lights
    groups: int  # the number of groups of lights whose light is recorded separately

    def at(self, surface: Surface, turns: Vector2f, count: UInt, both_sides: bool) -> Lighting:
        """Return the lighting of a surface; `count` directions are drawn from it, on `both_sides` or in front."""

    def camera_radiance(
        self, start: Point3f, w: Vector3f, turns: Vector2f, distance: Float
    ) -> tuple[list[Color3f], Bool]:
        """Return the radiance of visible lights nearer than a distance (all, then by group), and where one is hit."""

    def by_group(self, controls: tuple[Float, ...], arriving: Arriving) -> list[Arriving]:
        """Return the light of a light, and the part of it from each recorded group."""

    def excludes(self, controls: tuple[Float, ...], number: int) -> Bool:
        """Return whether the shadow of a light excludes a set of parts, by the set's number."""

    def shadow_shares(
        self, controls: tuple[Float, ...], distance: Float, occluders: list[Float], straight: bool = False
    ) -> Arriving:
        """Return the shares of a light at a distance that occluders transmit, for specular and diffuse lobes."""


def split_count(count: UInt) -> tuple[UInt, UInt]:
    """Return the numbers of directions in front and behind, as in the shader."""
    return count - count // 2, count // 2


def rotate_z(v: Vector3f, angle: Float) -> Vector3f:
    """Return vectors rotated about z, counter-clockwise seen from above."""
    s, c = dr.sincos(angle)
    return type(v)(c * v.x - s * v.y, s * v.x + c * v.y, v.z)


class OneDome:
    """A dome in world axes. The directions of all samples are stratified over its slots."""

    sampled: bool
    shadow_excluded: Sequence[tuple[int, ...]] = ((),)
    shadowed = split = visible = False
    groups = 0

    def __init__(self, mi: Mitsuba, dome: Dome) -> None:
        self._mi = mi
        self._dome = DomeLight(mi, dome)
        self.sampled = self._dome.sampled

    def at(self, surface: Surface, turns: Vector2f, count: UInt, both_sides: bool) -> Lighting:
        return _DomeLighting(self._mi, self._dome, surface, turns.x, count, both_sides and self.sampled)

    def camera_radiance(
        self, start: Point3f, w: Vector3f, turns: Vector2f, distance: Float
    ) -> tuple[list[Color3f], Bool]:
        return [self._mi.Color3f(0.0)], self._mi.Bool(False)

    def by_group(self, controls: tuple[Float, ...], arriving: Arriving) -> list[Arriving]:
        return [arriving]

    def excludes(self, controls: tuple[Float, ...], number: int) -> Bool:
        return self._mi.Bool(True)

    def shadow_shares(
        self, controls: tuple[Float, ...], distance: Float, occluders: list[Float], straight: bool = False
    ) -> Arriving:
        share = self._mi.Color3f(dr.select(distance > occluders[0], self._mi.Float(0.0), 1.0))
        return share, share


class _DomeLighting:
    def __init__(
        self, mi: Mitsuba, dome: DomeLight, surface: Surface, turn: Float, drawn_count: UInt, both_sides: bool
    ) -> None:
        self._mi, self._dome, self._turn = mi, dome, turn
        self._bins: list[tuple[UInt, NormalBin]] = []
        if dome.sampled:
            counts = split_count(drawn_count) if both_sides else (drawn_count,)
            normals = (surface.normal, -surface.normal)
            self._bins = [(count, dome.bin(rotate_z(n, -turn))) for count, n in zip(counts, normals, strict=False)]

    def arriving(
        self, w: Vector3f, own_density: Float, weighed: float, occluders: list[Float], active: Bool, straight: bool
    ) -> list[Arriving]:
        active = active & (occluders[0] >= FAR)
        local = rotate_z(w, -self._turn)
        radiance = self._dome.radiance(local, active)
        density = own_density + weighed * self._density(local, radiance)
        arriving_light = dr.select(active, radiance / density, 0.0)
        return [(arriving_light, arriving_light)]

    def draw(self, index: UInt, number: UInt, seed: UInt, active: Bool) -> LightSample:
        start = sobol.hash_integers(seed ^ 0x2545F491)
        front, bin = self._bins[0]
        back = number >= front
        sample = bin.draw_numbered(start ^ (index * front + number), seed, active)
        if len(self._bins) > 1:
            behind, other = self._bins[1]
            back_sample = other.draw_numbered(start ^ (index * behind + number - front), seed + 1, active)
            sample = dr.select(back, back_sample, sample)
        local, radiance, ratio = sample
        density = self._density(local, radiance)
        return rotate_z(local, self._turn), ratio * radiance, self._mi.Float(INFINITE), density, ()

    def _density(self, local: Vector3f, radiance: Color3f) -> Float:
        total = self._mi.Float(0.0)
        for count, bin in self._bins:
            total += self._mi.Float(count) * bin.pdf(local, radiance)
        return total
