"""Lamps and domes of a rig as the estimator meets them (`lookdev.mitsuba.lights`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from lookdev.codegen.program.lamps import ball_operations
from lookdev.light import Light, coded
from lookdev.light.dome import Dome
from lookdev.light.lamps import FIELDS, CodedRig, Stand
from lookdev.light.shape import FAR, INFINITE
from lookdev.mitsuba import sobol
from lookdev.mitsuba.dome import DomeLight, NormalBin
from lookdev.mitsuba.lamps import Controls, Lamps, Rows, kinds_of
from lookdev.mitsuba.lights import Lighting, Lights, OneDome, divided, turned
from lookdev.mitsuba.programs import Program
from lookdev.mitsuba.surface import Arriving, Surface


def lights_of(
    mi: Any,
    lights: Sequence[Light],
    lit: Sequence[Sequence[int]],
    center: Any,
    pivot: tuple[float, float],
    groups: Sequence[int] = (),
) -> Lights:
    """Return the lights of a scene about a centre, which turn about the vertical through `pivot`.

    `lit` are the numbers of the lights of each look; (): each has all. `groups` are the numbers of the lights' groups:
    the light of all but the last is kept apart.
    """
    alone = None if lit else coded(lights)
    return OneDome(mi, alone) if isinstance(alone, Dome) else Rig(mi, lights, lit, center, pivot, groups)


class Rig:
    """Lamps and domes. A light is chosen for each direction in proportion to an estimate of its irradiance."""

    sampled = True

    def __init__(
        self,
        mi: Any,
        lights: Sequence[Light],
        lit: Sequence[Sequence[int]],
        center: Any,
        pivot: tuple[float, float],
        groups: Sequence[int] = (),
    ) -> None:
        self._mi = mi
        rig = CodedRig.of(lights)
        x, y, z = (float(each) for each in center)
        numbers = rig.rows(Stand((x, y, z), pivot))
        self.offset = mi.Vector3f(*(float(each) for each in numbers[:3]))
        order = [n for kind in (False, True) for n, each in enumerate(lights) if (each.map_dome is not None) is kind]
        grouped = np.array([groups[n] for n in order] if groups else np.zeros(len(order)), np.float32)
        rows = np.column_stack((numbers[3:].reshape(-1, len(FIELDS)), grouped))
        linked = np.array([[n in each for n in order] for each in lit], np.bool_) if lit else None

        def links(which: slice) -> NDArray[np.bool_] | None:
            return None if linked is None else linked[:, which]

        count = len(rig.lamps)
        self.lamps = kinds_of(mi, rig, rows[:count], links(slice(count)))
        self.domes = [
            _PlacedDome(mi, dome, rows[n : n + 1], links(slice(n, n + 1))) for n, dome in enumerate(rig.domes, count)
        ]
        self._controls = Controls(mi, rig, max(groups, default=0))
        self.spared: Sequence[tuple[int, ...]] = self._controls.spared
        self.shadowed, self.split = rig.shadowed, rig.split
        self.shown = any(each.emission.camera for each in rig.lamps)
        self.spares, self.let = self._controls.spares, self._controls.let
        self.controls, self.none = self._controls.of, self._controls.none
        self.groups, self.by_group = self._controls.groups, self._controls.by_group

    def at(self, surface: Surface, turns: Any, lit: Any, both_sides: bool) -> Lighting:
        return _OfRig(self._mi, self, surface, turns, lit, both_sides)

    @dr.syntax
    def before(self, start: Any, w: Any, turns: Any, distance: Any) -> tuple[list[Any], Any]:
        mi = self._mi
        radiance, hidden = self.dark(), mi.Bool(False)
        here = _Here(mi, self, start, turns)
        for lamps in self.lamps:
            lamp = mi.UInt32(0)
            while lamp < lamps.count:
                p, local = here.seen(lamps, lamp, w)
                away, _ = lamps.meet(lamp, p, local)
                met = (lamps.field(lamp, "camera") > 0.0) & (away < distance)
                sent = dr.select(met, lamps.sent(lamp, p, local), 0.0)
                radiance = _sums(radiance, self.by_group(self.controls(lamps, lamp), (sent, sent)))
                hidden |= met
                lamp += 1
        return [each[0] for each in radiance], hidden

    def dark(self) -> list[Arriving]:
        """Return no light, `by_group`."""
        return [(self._mi.Color3f(0.0), self._mi.Color3f(0.0)) for _ in range(1 + self.groups)]


class _PlacedDome(Rows):
    """A dome of a rig: its map, its axes, its colour, and whether it turns. A local one has a middle and a radius."""

    def __init__(self, mi: Any, dome: Light, rows: NDArray[np.float32], linked: NDArray[np.bool_] | None) -> None:
        super().__init__(mi, rows, linked)
        assert dome.map_dome is not None, "it shows a map"
        self.local_one = not dome.far
        self.map = DomeLight(mi, dome.map_dome, local=self.local_one)
        self.first = mi.UInt32(0)
        self.radiance_factor = self.color(self.first)
        if dome.constant:
            # The row has the map's radiance, too.
            self.radiance_factor /= dr.maximum(mi.Color3f(*dome.map_dome.table[0, 0].tolist()), 1e-30)
        self.mean = self.field(self.first, "mean")
        self._program = Program(*ball_operations(), mi.Float)

    def ball(self, name: str, **given: Any) -> tuple[Any, ...]:
        """Return an output of `ball_operations`."""
        return self.called(self._program, self.first, name, **given)


class _Here:
    """Places about the geometry's centre, in the frames of lights."""

    def __init__(self, mi: Any, rig: Rig, place: Any, turns: Any) -> None:
        self._mi, self._turns = mi, turns
        from_axis = mi.Vector3f(place) + rig.offset
        self._moving, self._still = turned(from_axis, -turns.x), turned(from_axis, -turns.y)

    def turn(self, lights: Rows, lamp: Any) -> Any:
        """Return the angle by which lights are turned."""
        return dr.select(lights.turns(lamp), self._turns.x, self._turns.y)

    def place(self, lights: Rows, lamp: Any) -> Any:
        """Return the places in the frame of lights."""
        return lights.local(lamp, dr.select(lights.turns(lamp), self._moving, self._still))

    def into(self, lights: Rows, lamp: Any, v: Any) -> Any:
        """Return vectors of the world by the axes of lights."""
        return lights.inside(lamp, turned(v, -self.turn(lights, lamp)))

    def out_of(self, lights: Rows, lamp: Any, v: Any) -> Any:
        """Return vectors of the world from those by the axes of lights."""
        return turned(lights.outside(lamp, v), self.turn(lights, lamp))

    def seen(self, lights: Rows, lamp: Any, v: Any) -> tuple[Any, Any]:
        """Return the places, and vectors of the world, by the axes of lights."""
        return self.place(lights, lamp), self.into(lights, lamp, v)


class _OfRig:
    def __init__(self, mi: Any, rig: Rig, surface: Surface, turns: Any, lit: Any, both_sides: bool) -> None:
        self._mi, self._rig = mi, rig
        self._surface = surface
        self._here = _Here(mi, rig, surface.point, turns)
        self._sides = [surface.normal, -surface.normal][: 1 + both_sides]
        self._counts = divided(lit) if both_sides else (lit,)
        self._bins = [self._bins_of(dome) for dome in rig.domes]
        self._places = [self._here.place(dome, dome.first) if dome.local_one else None for dome in rig.domes]
        self._shares = [
            dome.ball("share", p=place)[0] if dome.local_one else mi.Float(1.0)
            for dome, place in zip(rig.domes, self._places, strict=True)
        ]
        self._sums = [self._sum(side) for side in range(len(self._sides))]

    def _bins_of(self, dome: _PlacedDome) -> list[NormalBin]:
        if dome.local_one:
            return [dome.map.all_around] * len(self._sides)
        if not dome.map.sampled:
            return []
        return [dome.map.bin(self._here.into(dome, dome.first, n)) for n in self._sides]

    def _dome_weight(self, number: int, side: int) -> Any:
        dome = self._rig.domes[number]
        weight = dome.mean * math.pi
        if dome.map.sampled:
            scale = self._bins[number][side].scale
            # A quarter of the integral is a surface's irradiance, on the average.
            around = 0.25 * self._shares[number] if dome.local_one else 1.0
            weight = dr.select(scale > 0.0, around * dome.mean / scale, 0.0)
        return weight * dome.linked(dome.first, self._surface.source)

    def _lamp_weight(self, lamps: Lamps, lamp: Any, n: Any) -> Any:
        p, local = self._here.seen(lamps, lamp, n)
        return lamps.weight(lamp, p, local) * lamps.linked(lamp, self._surface.source)

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
            total += self._lamp_weight(lamps, lamp, self._sides[side])
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
        return self._drawn(lambda side: self._lamp_weight(lamps, lamp, self._sides[side])) * pdf

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
    def arriving(
        self, w: Any, own_density: Any, weighed: float, occluders: list[Any], active: Any, straight: bool
    ) -> list[Arriving]:
        total = self._rig.dark()
        for number in range(len(self._rig.domes)):
            found = self._of_dome_arriving(number, w, own_density, weighed, occluders, active, straight)
            total = _sums(total, found)
        for lamps in self._rig.lamps:
            found = self._of_lamps_arriving(lamps, w, own_density, weighed, occluders, active, straight)
            total = _sums(total, found)
        return total

    def _of_dome_arriving(
        self, number: int, w: Any, own_density: Any, weighed: float, occluders: list[Any], active: Any, straight: bool
    ) -> list[Arriving]:
        dome = self._rig.domes[number]
        local = self._here.into(dome, dome.first, w)
        distance, radiance_seen, density_seen = self._along_dome(number, local, w, active)
        density = own_density + (density_seen if weighed else 0.0)
        found = dr.select(active, radiance_seen / density, 0.0) * dome.linked(dome.first, self._surface.source)
        controls = self._rig.controls(dome, dome.first)
        shares = self._rig.let(controls, distance, occluders, straight)
        return self._rig.by_group(controls, (found * shares[0], found * shares[1]))

    def _along_dome(self, number: int, local: Any, w: Any, active: Any) -> tuple[Any, Any, Any]:
        """Return the distance of a dome's map along directions, its radiance, and the density of those drawn."""
        dome, onto, distance, around = self._rig.domes[number], local, self._mi.Float(INFINITE), 1.0
        if dome.local_one:
            place = self._places[number]
            inside, distance, around = dome.ball("meet", p=place, w=local)
            onto = (place + distance * local) / dome.field(dome.first, "b")
            active = active & (inside > 0.0)
        mapped = dr.select(active, dome.map.radiance(onto, active), 0.0)
        density = self._density_of_dome(number, onto, w, mapped) * around
        return distance, mapped * self._shares[number] * dome.radiance_factor, density

    @dr.syntax
    def _of_lamps_arriving(
        self, lamps: Lamps, w: Any, own_density: Any, weighed: float, occluders: list[Any], active: Any, straight: bool
    ) -> list[Arriving]:
        total = self._rig.dark()
        lamp = self._mi.UInt32(0)
        while dr.hint(active & (lamp < lamps.count), exclude=[w, own_density, weighed, occluders, active, straight]):
            p, local = self._here.seen(lamps, lamp, w)
            distance, pdf = lamps.meet(lamp, p, local)
            density = own_density + weighed * self._density_of_lamp(lamps, lamp, pdf)
            found = dr.select(distance < FAR, lamps.sent(lamp, p, local) / density, 0.0)
            found *= lamps.linked(lamp, self._surface.source)
            controls = self._rig.controls(lamps, lamp)
            shares = self._rig.let(controls, distance, occluders, straight)
            total = _sums(total, self._rig.by_group(controls, (found * shares[0], found * shares[1])))
            lamp += 1
        return total

    def draw(self, index: Any, number: Any, seed: Any, active: Any) -> tuple[Any, Any, Any, Any, tuple[Any, ...]]:
        mi = self._mi
        front = self._counts[0]
        back = (number >= front) if len(self._sides) > 1 else mi.Bool(False)
        behind = self._counts[-1]
        own = dr.select(back, index * behind + number - front, index * front + number)
        u1, u2 = sobol.points(mi.Float, own, sobol.hashed(seed + 0x1B873593 + dr.select(back, mi.UInt32(1), 0)))
        wanted = u1 * dr.select(back, self._sums[-1], self._sums[0])
        # The light whose interval of the sum has the number: then where in it, for its own direction.
        before = mi.Float(0.0)
        none = self._rig.none()
        drawn = (mi.Vector3f(0.0, 0.0, 1.0), mi.Color3f(0.0), mi.Float(INFINITE), mi.Float(0.0), none)
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
        while dr.hint(active & (lamp < lamps.count), exclude=[wanted, back, active]):
            side = dr.select(back, -self._surface.normal, self._surface.normal)
            weight = self._lamp_weight(lamps, lamp, side)
            here = (wanted >= end) & (wanted < end + weight)
            chosen = dr.select(here, lamp, chosen)
            start = dr.select(here, end, start)
            length = dr.select(here, weight, length)
            end += weight
            lamp += 1
        return chosen, start, length, end

    def _draw_of_lamp(self, lamps: Lamps, lamp: Any, u1: Any, u2: Any) -> tuple[Any, Any, Any, Any, tuple[Any, ...]]:
        p = self._here.place(lamps, lamp)
        local, distance, pdf = lamps.draw(lamp, p, u1, u2)
        radiance = dr.select(distance < FAR, lamps.sent(lamp, p, local), 0.0)
        w, density = self._here.out_of(lamps, lamp, local), self._density_of_lamp(lamps, lamp, pdf)
        return w, radiance, distance, density, self._rig.controls(lamps, lamp)

    def _draw_of_dome(
        self, place: int, dome: _PlacedDome, back: Any, u1: Any, u2: Any, active: Any
    ) -> tuple[Any, Any, Any, Any, tuple[Any, ...]]:
        mi, controls = self._mi, self._rig.controls(dome, dome.first)
        if not dome.map.sampled:
            # In proportion to the cosine.
            radius, (s, c) = dr.sqrt(u1), dr.sincos(2.0 * math.pi * u2)
            height = dr.safe_sqrt(1.0 - u1) * dr.select(back, -1.0, 1.0)
            w = self._surface.to_world(mi.Vector3f(radius * c, radius * s, height))
            distance, radiance, density = self._along_dome(place, self._here.into(dome, dome.first, w), w, active)
            return w, radiance, distance, density, controls
        front, behind = self._bins[place][0], self._bins[place][-1]
        onto, mapped, ratio = dr.select(back, behind.placed(u1, u2, active), front.placed(u1, u2, active))
        local, distance, around = onto, mi.Float(INFINITE), 1.0
        if dome.local_one:
            local = mi.Vector3f(*dome.ball("draw", p=self._places[place], onto=onto))
            _, distance, around = dome.ball("meet", p=self._places[place], w=local)
        w = self._here.out_of(dome, dome.first, local)
        density = self._density_of_dome(place, onto, w, mapped) * around
        return w, ratio * mapped * self._shares[place] * dome.radiance_factor, distance, density, controls


def _sums(one: list[Arriving], other: list[Arriving]) -> list[Arriving]:
    return [(a + c, b + d) for (a, b), (c, d) in zip(one, other, strict=True)]
