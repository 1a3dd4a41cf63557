"""The lights of a scene as the estimator meets them: one dome, or a rig of lamps and domes.

Places are about the geometry's centre, directions of the world. `turns` are two angles in radians: of the lights that
turn with the rig, and of those that stay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import drjit as dr

from lookdev.light import Light, coded
from lookdev.light.dome import Dome
from lookdev.light.lamps import FIELDS, SHAPES, CodedRig, Stand
from lookdev.light.shape import FAR, INFINITE
from lookdev.mitsuba import sobol
from lookdev.mitsuba.dome import DomeLight, NormalBin
from lookdev.mitsuba.lamps import Lamps
from lookdev.mitsuba.surface import Surface


class Lighting(Protocol):
    """Light at places of a surface, of which a number of directions is drawn."""

    def arriving(self, w: Any, own_density: Any, weighed: float, occluder: Any, active: Any) -> Any:
        """Return the sum over lights of radiance over density, nearer than what occludes them.

        A density is `own_density`, plus that of the directions drawn of the light if `weighed` is 1.
        """

    def draw(self, index: Any, number: Any, seed: Any, active: Any) -> tuple[Any, Any, Any, Any]:
        """Draw direction `number` of sample `index`: return it, radiance, distance and the density of all drawn.

        The radiance is corrected by the ratio of that density to the one it was drawn with.
        """


class Lights(Protocol):
    """All lights of a scene; `sampled`: directions are drawn of them."""

    sampled: bool

    def at(self, surface: Surface, turns: Any, lit: Any, both_sides: bool) -> Lighting:
        """Return the lighting of a surface, of which `lit` directions are drawn, on `both_sides` of it or in front."""


def lights_of(mi: Any, lights: Sequence[Light], center: Any, pivot: tuple[float, float]) -> Lights:
    """Return the lights of a scene about a centre, which turn about the vertical through `pivot`."""
    alone = coded(lights)
    return OneDome(mi, alone) if isinstance(alone, Dome) else Rig(mi, lights, center, pivot)


def divided(count: Any) -> tuple[Any, Any]:
    """Divide a number of directions among front and back, as the shader does."""
    return count - count // 2, count // 2


class OneDome:
    """A dome in the world's axes. Directions of all samples are stratified over its slots."""

    def __init__(self, mi: Any, dome: Dome) -> None:
        self._mi = mi
        self._dome = DomeLight(mi, dome)
        self.sampled = self._dome.sampled

    def at(self, surface: Surface, turns: Any, lit: Any, both_sides: bool) -> Lighting:
        return _OfOneDome(self._mi, self._dome, surface, turns.x, lit, both_sides and self.sampled)


class _OfOneDome:
    def __init__(self, mi: Any, dome: DomeLight, surface: Surface, turn: Any, lit: Any, both_sides: bool) -> None:
        self._mi, self._dome, self._turn = mi, dome, turn
        self._bins: list[tuple[Any, NormalBin]] = []
        if dome.sampled:
            counts = divided(lit) if both_sides else (lit,)
            normals = (surface.normal, -surface.normal)
            self._bins = [(count, dome.bin(_turned(n, -turn))) for count, n in zip(counts, normals, strict=False)]

    def arriving(self, w: Any, own_density: Any, weighed: float, occluder: Any, active: Any) -> Any:
        active = active & (occluder >= FAR)
        local = _turned(w, -self._turn)
        radiance = self._dome.radiance(local, active)
        density = own_density + weighed * self._density(local, radiance)
        return dr.select(active, radiance / density, 0.0)

    def draw(self, index: Any, number: Any, seed: Any, active: Any) -> tuple[Any, Any, Any, Any]:
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
        return _turned(local, self._turn), ratio * radiance, self._mi.Float(INFINITE), density

    def _density(self, local: Any, radiance: Any) -> Any:
        total = self._mi.Float(0.0)
        for count, bin in self._bins:
            total += self._mi.Float(count) * bin.pdf(local, radiance)
        return total


class Rig:
    """Lamps and domes. A light is chosen for each direction in proportion to an estimate of its irradiance."""

    sampled = True

    def __init__(self, mi: Any, lights: Sequence[Light], center: Any, pivot: tuple[float, float]) -> None:
        self._mi = mi
        rig = CodedRig.of(lights)
        x, y, z = (float(each) for each in center)
        numbers = rig.rows(Stand((x, y, z), pivot))
        self.offset = mi.Vector3f(*(float(each) for each in numbers[:3]))
        rows = numbers[3:].reshape(-1, len(FIELDS))
        lamps, domes = rows[: len(rig.lamps)], rows[len(rig.lamps) :]
        kinds = [(kind, lamps[lamps[:, 0] == list(SHAPES).index(kind)]) for kind in rig.kinds]
        self.lamps = [Lamps(mi, kind, each, shaped=rig.shaped, falling=rig.falling) for kind, each in kinds]
        found = [each for each in rig.domes if isinstance(each, Dome)]
        self.domes = [_PlacedDome(mi, dome, row) for dome, row in zip(found, domes, strict=True)]

    def at(self, surface: Surface, turns: Any, lit: Any, both_sides: bool) -> Lighting:
        return _OfRig(self._mi, self, surface, turns, lit, both_sides)


class _PlacedDome:
    """A dome of a rig: its map, its axes, its colour, and whether it turns."""

    def __init__(self, mi: Any, dome: Dome, row: Any) -> None:
        self.map = DomeLight(mi, dome, colored=False)
        named = dict(zip(FIELDS, row.tolist(), strict=True))
        self._axes = [mi.Vector3f(*(named[f"{axis}{i}"] for i in range(3))) for axis in "xyz"]
        self.color = mi.Color3f(named["red"], named["green"], named["blue"])
        if dome.constant:
            # The row has the map's radiance, too.
            self.color /= dr.maximum(mi.Color3f(*dome.table[0, 0].tolist()), 1e-30)
        self.mean = named["mean"]
        self.turns = named["turns"] > 0.0

    def local(self, v: Any) -> Any:
        return type(v)(*(dr.dot(v, axis) for axis in self._axes))

    def world(self, v: Any) -> Any:
        return v.x * self._axes[0] + v.y * self._axes[1] + v.z * self._axes[2]


class _OfRig:
    def __init__(self, mi: Any, rig: Rig, surface: Surface, turns: Any, lit: Any, both_sides: bool) -> None:
        self._mi, self._rig, self._turns = mi, rig, turns
        self._surface = surface
        place = mi.Vector3f(surface.point) + rig.offset
        self._here, self._here_still = _turned(place, -turns.x), _turned(place, -turns.y)
        self._sides = [surface.normal, -surface.normal][: 1 + both_sides]
        self._counts = divided(lit) if both_sides else (lit,)
        self._bins = [
            [dome.map.bin(self._of_dome(dome, n)) for n in self._sides] if dome.map.sampled else []
            for dome in rig.domes
        ]
        self._sums = [self._sum(side) for side in range(len(self._sides))]

    def _of_dome(self, dome: _PlacedDome, v: Any) -> Any:
        return dome.local(_turned(v, -(self._turns.x if dome.turns else self._turns.y)))

    def _from_dome(self, dome: _PlacedDome, v: Any) -> Any:
        return _turned(dome.world(v), self._turns.x if dome.turns else self._turns.y)

    def _seen(self, lamps: Lamps, lamp: Any, v: Any) -> tuple[Any, Any]:
        """Return the place, and a vector of the world, by the axes of lamps."""
        turns = lamps.turns(lamp)
        p = lamps.local(lamp, dr.select(turns, self._here, self._here_still))
        return p, lamps.inside(lamp, _turned(v, -dr.select(turns, self._turns.x, self._turns.y)))

    def _dome_weight(self, number: int, side: int) -> Any:
        dome = self._rig.domes[number]
        if not dome.map.sampled:
            return self._mi.Float(dome.mean * math.pi)
        scale = self._bins[number][side].scale
        return dr.select(scale > 0.0, dome.mean / scale, 0.0)

    @dr.syntax
    def _sum(self, side: int) -> Any:
        """Return the sum of all lights' estimates of irradiance on a side."""
        mi = self._mi
        total = mi.Float(0.0)
        for number in range(len(self._rig.domes)):
            total += self._dome_weight(number, side)
        for lamps in self._rig.lamps:
            total += self._sum_of(lamps, side)
        return total

    @dr.syntax
    def _sum_of(self, lamps: Lamps, side: int) -> Any:
        total = self._mi.Float(0.0)
        lamp = self._mi.UInt32(0)
        while lamp < lamps.count:
            p, n = self._seen(lamps, lamp, self._sides[side])
            total += lamps.weight(lamp, p, n)
            lamp += 1
        return total

    def _drawn(self, weight_of: Any) -> Any:
        """Return the number of directions that are drawn of a light, by a function of its weight on a side."""
        total = self._mi.Float(0.0)
        for side, (count, sum_) in enumerate(zip(self._counts, self._sums, strict=True)):
            share = weight_of(side) / sum_
            total += self._mi.Float(count) * dr.select(sum_ > 0.0, share, 0.0)
        return total

    def _density_of_lamp(self, lamps: Lamps, lamp: Any, pdf: Any) -> Any:
        def weight(side: int) -> Any:
            p, n = self._seen(lamps, lamp, self._sides[side])
            return lamps.weight(lamp, p, n)

        return self._drawn(weight) * pdf

    def _density_of_dome(self, number: int, local: Any, w: Any, radiance: Any) -> Any:
        """Return the density of directions of a dome: `local` by its axes, w of the world."""
        dome, total = self._rig.domes[number], self._mi.Float(0.0)
        for side, (count, sum_) in enumerate(zip(self._counts, self._sums, strict=True)):
            share = dr.select(sum_ > 0.0, self._dome_weight(number, side) / sum_, 0.0)
            if dome.map.sampled:
                pdf = self._bins[number][side].pdf(local, radiance)
            else:
                pdf = dr.maximum(dr.dot(w, self._sides[side]), 0.0) / math.pi
            total += self._mi.Float(count) * share * pdf
        return total

    @dr.syntax
    def arriving(self, w: Any, own_density: Any, weighed: float, occluder: Any, active: Any) -> Any:
        total = self._mi.Color3f(0.0)
        for number in range(len(self._rig.domes)):
            total += self._of_dome_arriving(number, w, own_density, weighed, occluder, active)
        for lamps in self._rig.lamps:
            total += self._of_lamps_arriving(lamps, w, own_density, weighed, occluder, active)
        return total

    def _of_dome_arriving(
        self, number: int, w: Any, own_density: Any, weighed: float, occluder: Any, active: Any
    ) -> Any:
        dome = self._rig.domes[number]
        seen = active & (occluder >= FAR)
        local = self._of_dome(dome, w)
        radiance = dome.map.radiance(local, seen)
        density = own_density + (self._density_of_dome(number, local, w, radiance) if weighed else 0.0)
        return dr.select(seen, radiance * dome.color / density, 0.0)

    @dr.syntax
    def _of_lamps_arriving(
        self, lamps: Lamps, w: Any, own_density: Any, weighed: float, occluder: Any, active: Any
    ) -> Any:
        mi = self._mi
        total = mi.Color3f(0.0)
        lamp = mi.UInt32(0)
        while active & (lamp < lamps.count):
            p, local = self._seen(lamps, lamp, w)
            distance, pdf = lamps.meet(lamp, p, local)
            met = (distance < FAR) & (distance < occluder)
            density = own_density + weighed * self._density_of_lamp(lamps, lamp, pdf)
            total += dr.select(met, lamps.sent(lamp, p, local) / density, 0.0)
            lamp += 1
        return total

    def draw(self, index: Any, number: Any, seed: Any, active: Any) -> tuple[Any, Any, Any, Any]:
        mi = self._mi
        front = self._counts[0]
        back = (number >= front) if len(self._sides) > 1 else mi.Bool(False)
        behind = self._counts[-1]
        own = dr.select(back, index * behind + number - front, index * front + number)
        u1, u2 = sobol.points(mi.Float, own, sobol.hashed(seed + 0x1B873593 + dr.select(back, mi.UInt32(1), 0)))
        wanted = u1 * dr.select(back, self._sums[-1], self._sums[0])
        # The light whose interval of the sum has the number: then where in it, for its own direction.
        before = mi.Float(0.0)
        drawn = (mi.Vector3f(0.0, 0.0, 1.0), mi.Color3f(0.0), mi.Float(INFINITE), mi.Float(0.0))
        for place, dome in enumerate(self._rig.domes):
            weight = dr.select(back, self._dome_weight(place, len(self._sides) - 1), self._dome_weight(place, 0))
            here = (wanted >= before) & (wanted < before + weight)
            within = dr.clip((wanted - before) / weight, 0.0, 0.99999994)
            drawn = dr.select(here, self._draw_of_dome(place, dome, back, within, u2, active & here), drawn)
            before += weight
        for lamps in self._rig.lamps:
            chosen, start, weight, before = self._choose(lamps, wanted, before, back, active)
            here = active & (weight > 0.0)
            within = dr.clip((wanted - start) / weight, 0.0, 0.99999994)
            drawn = dr.select(here, self._draw_of_lamp(lamps, chosen, within, u2), drawn)
        return drawn

    @dr.syntax
    def _choose(self, lamps: Lamps, wanted: Any, before: Any, back: Any, active: Any) -> tuple[Any, Any, Any, Any]:
        """Return the lamp whose interval has a number, its start and length, 0 if none has, and the end of all."""
        mi = self._mi
        chosen, start, length = mi.UInt32(0), mi.Float(0.0), mi.Float(0.0)
        end = mi.Float(before)
        lamp = mi.UInt32(0)
        while active & (lamp < lamps.count):
            side = dr.select(back, -self._surface.normal, self._surface.normal)
            p, n = self._seen(lamps, lamp, side)
            weight = lamps.weight(lamp, p, n)
            here = (wanted >= end) & (wanted < end + weight)
            chosen = dr.select(here, lamp, chosen)
            start = dr.select(here, end, start)
            length = dr.select(here, weight, length)
            end += weight
            lamp += 1
        return chosen, start, length, end

    def _draw_of_lamp(self, lamps: Lamps, lamp: Any, u1: Any, u2: Any) -> tuple[Any, Any, Any, Any]:
        p, _ = self._seen(lamps, lamp, self._surface.normal)
        local, distance, pdf = lamps.draw(lamp, p, u1, u2)
        radiance = dr.select(distance < FAR, lamps.sent(lamp, p, local), 0.0)
        turn = dr.select(lamps.turns(lamp), self._turns.x, self._turns.y)
        w = _turned(lamps.outside(lamp, local), turn)
        return w, radiance, distance, self._density_of_lamp(lamps, lamp, pdf)

    def _draw_of_dome(
        self, place: int, dome: _PlacedDome, back: Any, u1: Any, u2: Any, active: Any
    ) -> tuple[Any, Any, Any, Any]:
        mi = self._mi
        if dome.map.sampled:
            front, behind = self._bins[place][0], self._bins[place][-1]
            local, radiance, ratio = dr.select(back, behind.placed(u1, u2, active), front.placed(u1, u2, active))
            w = self._from_dome(dome, local)
        else:
            # In proportion to the cosine.
            radius, (s, c) = dr.sqrt(u1), dr.sincos(2.0 * math.pi * u2)
            height = dr.safe_sqrt(1.0 - u1) * dr.select(back, -1.0, 1.0)
            w = self._surface.to_world(mi.Vector3f(radius * c, radius * s, height))
            local, ratio = self._of_dome(dome, w), mi.Float(1.0)
            radiance = dome.map.radiance(local, active)
        density = self._density_of_dome(place, local, w, radiance)
        return w, ratio * radiance * dome.color, mi.Float(INFINITE), density


def _turned(v: Any, angle: Any) -> Any:
    """Return vectors turned about z, counter-clockwise seen from above."""
    s, c = dr.sincos(angle)
    return type(v)(c * v.x - s * v.y, s * v.x + c * v.y, v.z)
