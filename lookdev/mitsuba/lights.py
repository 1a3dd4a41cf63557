"""The lights of a scene as the estimator meets them: one dome, or a rig of lamps and domes (`lookdev.mitsuba.rig`).

Places are about the geometry's centre, directions of the world. `turns` are two angles in radians: of the lights that
turn with the rig, and of those that stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import drjit as dr

from lookdev.light.dome import Dome
from lookdev.light.shape import FAR, INFINITE
from lookdev.mitsuba import sobol
from lookdev.mitsuba.dome import DomeLight, NormalBin
from lookdev.mitsuba.surface import Arriving, Surface


class Lighting(Protocol):
    """Light at places of a surface, of which a number of directions is drawn."""

    def arriving(
        self, w: Any, own_density: Any, weighed: float, occluders: list[Any], active: Any, straight: bool
    ) -> list[Arriving]:
        """Return the sum over lights of radiance over density, as far as it passes what occludes them, `by_group`.

        A density is `own_density`, plus that of the directions drawn of the light if `weighed` is 1. Occluders are the
        distances to what is met first of the parts that cast shadows, for each set of `Lights.spared`. Light that is
        not reflected comes `straight`.
        """

    def draw(self, index: Any, number: Any, seed: Any, active: Any) -> tuple[Any, Any, Any, Any, tuple[Any, ...]]:
        """Draw direction `number` of sample `index`: return it, radiance, distance, density of all drawn, controls.

        The radiance is corrected by the ratio of that density to the one it was drawn with.
        """


class Lights(Protocol):
    """All lights of a scene; `sampled`: directions are drawn of them."""

    sampled: bool
    spared: Sequence[tuple[int, ...]]  # the sets of groups of parts that cast no shadow of some light
    shadowed: bool  # what passes an occluder depends on how far it is
    split: bool  # diffuse lobes reflect other light than specular ones
    shown: bool  # the camera sees some
    groups: int  # of how many groups of lights the light is kept apart

    def at(self, surface: Surface, turns: Any, lit: Any, both_sides: bool) -> Lighting:
        """Return the lighting of a surface, of which `lit` directions are drawn, on `both_sides` of it or in front."""

    def before(self, start: Any, w: Any, turns: Any, distance: Any) -> tuple[list[Any], Any]:
        """Return the radiance of what the camera sees of lights nearer than a distance, of all and of each group that
        is kept apart, and where there is any.
        """

    def by_group(self, controls: tuple[Any, ...], arriving: Arriving) -> list[Arriving]:
        """Return light of a light, and what of it is of each group that is kept apart."""

    def spares(self, controls: tuple[Any, ...], which: int) -> Any:
        """Return whether a light spares a set of parts, by the set's number."""

    def let(self, controls: tuple[Any, ...], distance: Any, occluders: list[Any], straight: bool = False) -> Arriving:
        """Return the shares of a light at a distance that pass occluders, for specular and diffuse lobes."""


def divided(count: Any) -> tuple[Any, Any]:
    """Divide a number of directions among front and back, as the shader does."""
    return count - count // 2, count // 2


def turned(v: Any, angle: Any) -> Any:
    """Return vectors turned about z, counter-clockwise seen from above."""
    s, c = dr.sincos(angle)
    return type(v)(c * v.x - s * v.y, s * v.x + c * v.y, v.z)


class OneDome:
    """A dome in the world's axes. Directions of all samples are stratified over its slots."""

    sampled: bool
    spared: Sequence[tuple[int, ...]] = ((),)
    shadowed = split = shown = False
    groups = 0

    def __init__(self, mi: Any, dome: Dome) -> None:
        self._mi = mi
        self._dome = DomeLight(mi, dome)
        self.sampled = self._dome.sampled

    def at(self, surface: Surface, turns: Any, lit: Any, both_sides: bool) -> Lighting:
        return _OfOneDome(self._mi, self._dome, surface, turns.x, lit, both_sides and self.sampled)

    def before(self, start: Any, w: Any, turns: Any, distance: Any) -> tuple[list[Any], Any]:
        return [self._mi.Color3f(0.0)], self._mi.Bool(False)

    def by_group(self, controls: tuple[Any, ...], arriving: Arriving) -> list[Arriving]:
        return [arriving]

    def spares(self, controls: tuple[Any, ...], which: int) -> Any:
        return self._mi.Bool(True)

    def let(self, controls: tuple[Any, ...], distance: Any, occluders: list[Any], straight: bool = False) -> Arriving:
        share = self._mi.Color3f(dr.select(distance > occluders[0], self._mi.Float(0.0), 1.0))
        return share, share


class _OfOneDome:
    def __init__(self, mi: Any, dome: DomeLight, surface: Surface, turn: Any, lit: Any, both_sides: bool) -> None:
        self._mi, self._dome, self._turn = mi, dome, turn
        self._bins: list[tuple[Any, NormalBin]] = []
        if dome.sampled:
            counts = divided(lit) if both_sides else (lit,)
            normals = (surface.normal, -surface.normal)
            self._bins = [(count, dome.bin(turned(n, -turn))) for count, n in zip(counts, normals, strict=False)]

    def arriving(
        self, w: Any, own_density: Any, weighed: float, occluders: list[Any], active: Any, straight: bool
    ) -> list[Arriving]:
        active = active & (occluders[0] >= FAR)
        local = turned(w, -self._turn)
        radiance = self._dome.radiance(local, active)
        density = own_density + weighed * self._density(local, radiance)
        found = dr.select(active, radiance / density, 0.0)
        return [(found, found)]

    def draw(self, index: Any, number: Any, seed: Any, active: Any) -> tuple[Any, Any, Any, Any, tuple[Any, ...]]:
        start = sobol.hashed(seed ^ 0x2545F491)
        front, bin = self._bins[0]
        back = number >= front
        drawn = bin.numbered(start ^ (index * front + number), seed, active)
        if len(self._bins) > 1:
            behind, other = self._bins[1]
            far = other.numbered(start ^ (index * behind + number - front), seed + 1, active)
            drawn = dr.select(back, far, drawn)
        local, radiance, ratio = drawn
        density = self._density(local, radiance)
        return turned(local, self._turn), ratio * radiance, self._mi.Float(INFINITE), density, ()

    def _density(self, local: Any, radiance: Any) -> Any:
        total = self._mi.Float(0.0)
        for count, bin in self._bins:
            total += self._mi.Float(count) * bin.pdf(local, radiance)
        return total
