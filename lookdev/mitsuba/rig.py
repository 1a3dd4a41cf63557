"""The lights of a rig, lamps and domes, behind the interface of `lookdev.mitsuba.lights`.

To draw a direction, one light is selected at random. Its probability is in proportion to a weight, which estimates the
irradiance from the light at the point. In front of the surface and behind it, the weights of a light differ, and
directions are drawn on each side separately. `w` is a direction and `n` is a normal in world space. `local` is a
direction in the axes of a light, and `p` is a point in the frame of a light.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import drjit as dr
import numpy as np

from lookdev.arrays import Bools, Floats, Floats32
from lookdev.codegen.program.lamps import ball_operations
from lookdev.light import Light, coded_light
from lookdev.light.dome import Dome
from lookdev.light.lamps import FIELDS, CodedRig, RigOrigin
from lookdev.light.shape import FAR, INFINITE_DISTANCE
from lookdev.mitsuba import sobol
from lookdev.mitsuba.dome import DomeLight, NormalBin
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.lamps import LampRows, Lamps, lamps_by_kind
from lookdev.mitsuba.lights import Direction, Lighting, LightSample, OneDome, SceneLights, rotate_z, split_count
from lookdev.mitsuba.programs import Program
from lookdev.mitsuba.surface import Arriving, SurfacePoints
from lookdev.mitsuba.types import Bool, Color3f, Float, Mitsuba, Point3f, UInt, Vector2f, Vector3f
from lookdev.rendering.task import SceneTask


def scene_lights(mi: Mitsuba, task: SceneTask, geometry: Geometry) -> SceneLights:
    """Return the lights of a task, relative to the geometry's centre, and create the scenes that cast their shadows.

    If the task has groups of lights, the light of each group except the last is recorded separately.
    """
    single = None if task.shader_lights else coded_light(task.lights)
    lights = OneDome(mi, single) if isinstance(single, Dome) else RigSampler(mi, task, geometry.center)
    for excluded in lights.shadow_excluded:
        geometry.shadow_scene(excluded)  # created ahead of time, because kernels cannot create it
    return lights


class RigSampler(SceneLights):
    """The lamps and domes of a rig; `center` (3,) is the centre of the geometry."""

    def __init__(self, mi: Mitsuba, task: SceneTask, center: Floats) -> None:
        lights, links = task.lights, task.shader_lights
        groups = [task.light_group_names.index(name) for name in task.light_groups[: len(lights)]]
        rig = CodedRig.from_lights(lights)
        super().__init__(mi, rig, max(groups, default=0))
        x, y, z = (float(coordinate) for coordinate in center)
        values = rig.rows(RigOrigin((x, y, z), task.camera.pivot))
        self.offset = mi.Vector3f(*(float(coordinate) for coordinate in values[:3]))  # added to points: `RigOrigin`
        # Rows are in the order of `CodedRig`: lamps, then domes.
        order = [
            n for has_map in (False, True) for n, light in enumerate(lights) if (light.map_dome is not None) is has_map
        ]
        group_column = np.array([groups[n] for n in order] if groups else np.zeros(len(order)), np.float32)
        rows = np.column_stack((values[3:].reshape(-1, len(FIELDS)), group_column))
        link_table = np.array([[n in numbers for n in order] for numbers in links], np.bool_) if links else None

        def links_of(part: slice) -> Bools | None:
            """Return the links of some rows: whether each of these lights reaches each source."""
            return None if link_table is None else link_table[:, part]

        count = len(rig.lamps)
        self.lamps = lamps_by_kind(mi, rig, rows[:count], links_of(slice(count)))
        self.domes = [
            _RigDome(mi, dome, rows[n : n + 1], links_of(slice(n, n + 1))) for n, dome in enumerate(rig.domes, count)
        ]
        self.visible = any(lamp.emission.camera for lamp in rig.lamps)

    def at(self, surface: SurfacePoints, turns: Vector2f, count: UInt, both_sides: bool) -> Lighting:
        """Return the light of the rig at a surface, as `SceneLights.at`."""
        return _RigLighting(self._mi, self, surface, turns, count, both_sides)

    @dr.syntax
    def camera_radiance(
        self, start: Point3f, w: Vector3f, turns: Vector2f, distance: Float
    ) -> tuple[list[Color3f], Bool]:
        """Return the light of visible lamps, as `SceneLights.camera_radiance`."""
        mi = self._mi
        radiance, hidden = self.zero_light(), mi.Bool(False)
        frames = _LightFrames(mi, self, start, turns)
        for lamps in self.lamps:
            lamp = mi.UInt32(0)
            while lamp < lamps.count:
                p, local = frames.to_frame(lamps, lamp, w)
                hit_distance, _ = lamps.intersect(lamp, p, local)
                visible = (lamps.field(lamp, "camera") > 0.0) & (hit_distance < distance)
                seen = dr.select(visible, lamps.radiance(lamp, p, local), 0.0)
                radiance = _add_arriving(radiance, self.split_by_group(self.controls(lamps, lamp), (seen, seen)))
                hidden |= visible
                lamp += 1
        return [light[0] for light in radiance], hidden

    def zero_light(self) -> list[Arriving]:
        """Return zero light, as a list like the result of `split_by_group`."""
        return [(self._mi.Color3f(0.0), self._mi.Color3f(0.0)) for _ in range(1 + self.groups)]


class _RigDome(LampRows):
    """A dome of a rig: its map, and its row in the table of lights.

    A local dome is a ball of finite radius about a centre. Its light comes from the surface of the ball.
    """

    def __init__(self, mi: Mitsuba, dome: Light, rows: Floats32, links: Bools | None) -> None:
        super().__init__(mi, rows, links)
        assert dome.map_dome is not None, "a dome has a map"
        self.is_local = not dome.is_infinitely_far
        self.map = DomeLight(mi, dome.map_dome, local=self.is_local)
        self.first = mi.UInt32(0)  # the number of the only row
        self.radiance_factor = self.color(self.first)
        if dome.constant:
            # The colour in the row of a constant dome already includes the radiance of the map.
            self.radiance_factor /= dr.maximum(mi.Color3f(*dome.map_dome.table[0, 0].tolist()), 1e-30)
        self.mean = self.field(self.first, "mean")
        self._program = Program(*ball_operations(), mi.Float)

    def ball(self, name: str, **inputs: Float | Vector3f) -> tuple[Float, ...]:
        """Return an output of `ball_operations`, the programs of local domes."""
        return self.evaluate(self._program, self.first, name, **inputs)


class _LightFrames:
    """Maps points and vectors between world space and the frames of lights. `point` is relative to the centre."""

    def __init__(self, mi: Mitsuba, rig: RigSampler, point: Vector3f | Point3f, turns: Vector2f) -> None:
        self._mi, self._turns = mi, turns
        from_axis = mi.Vector3f(point) + rig.offset
        self._in_turning, self._in_fixed = rotate_z(from_axis, -turns.x), rotate_z(from_axis, -turns.y)

    def turn(self, lights: LampRows, lamp: UInt) -> Float:
        """Return the rotations of lights about z."""
        return dr.select(lights.turns(lamp), self._turns.x, self._turns.y)

    def point(self, lights: LampRows, lamp: UInt) -> Vector3f:
        """Return the point in the frames of lights."""
        return lights.to_local_point(lamp, dr.select(lights.turns(lamp), self._in_turning, self._in_fixed))

    def to_light_axes(self, lights: LampRows, lamp: UInt, v: Vector3f) -> Vector3f:
        """Return vectors in the axes of lights, from vectors in world space."""
        return lights.to_local(lamp, rotate_z(v, -self.turn(lights, lamp)))

    def from_light_axes(self, lights: LampRows, lamp: UInt, v: Vector3f) -> Vector3f:
        """Return vectors in world space, from vectors in the axes of lights."""
        return rotate_z(lights.to_rig(lamp, v), self.turn(lights, lamp))

    def to_frame(self, lights: LampRows, lamp: UInt, v: Vector3f) -> tuple[Vector3f, Vector3f]:
        """Return the point in the frames of lights, and world vectors in their axes."""
        return self.point(lights, lamp), self.to_light_axes(lights, lamp, v)


class _RigLighting:
    """The light of a rig at points of a surface, from which `count` directions are drawn.

    A side is the front of the surface, or its back, which is sampled only if `both_sides`.
    """

    def __init__(
        self, mi: Mitsuba, rig: RigSampler, surface: SurfacePoints, turns: Vector2f, count: UInt, both_sides: bool
    ) -> None:
        self._mi, self._rig = mi, rig
        self._surface = surface
        self._frames = _LightFrames(mi, rig, surface.point, turns)
        self._sides = [surface.normal, -surface.normal][: 1 + both_sides]
        self._counts = split_count(count) if both_sides else (count,)
        self._bins = [self._side_bins(dome) for dome in rig.domes]
        domes = [*enumerate(rig.domes)]
        self._dome_points = {n: self._frames.point(dome, dome.first) for n, dome in domes if dome.is_local}
        # The share of a dome's light that arrives at the point. The light of a local dome fades towards its radius.
        self._shares = [
            dome.ball("share", p=self._dome_points[n])[0] if dome.is_local else mi.Float(1.0) for n, dome in domes
        ]
        self._side_sums = [self._sum(side) for side in range(len(self._sides))]

    def _side_bins(self, dome: _RigDome) -> list[NormalBin]:
        """Return the bin of a dome for the normal of each side; none if the dome is not sampled by tables."""
        if dome.is_local:
            return [dome.map.all_around] * len(self._sides)
        if not dome.map.sampled:
            return []
        return [dome.map.bin(self._frames.to_light_axes(dome, dome.first, n)) for n in self._sides]

    def _dome_weight(self, number: int, side: int) -> Float:
        """Return the estimated irradiance from a dome on a side: the weight of its selection."""
        dome = self._rig.domes[number]
        weight = dome.mean * math.pi
        if dome.map.sampled:
            scale = self._bins[number][side].scale
            # 1 / scale is the integral of the map times the widened cosine of the bin. For a local dome, it is the
            # integral of the map alone. The mean irradiance of a surface, over its orientations, is a quarter of that.
            factor = 0.25 * self._shares[number] if dome.is_local else 1.0
            weight = dr.select(scale > 0.0, factor * dome.mean / scale, 0.0)
        return weight * dome.link_of(dome.first, self._surface.source)

    def _lamp_weight(self, lamps: Lamps, lamp: UInt, n: Vector3f) -> Float:
        """Return the estimated irradiance from a lamp, for the normal of a side: the weight of its selection."""
        p, local = self._frames.to_frame(lamps, lamp, n)
        return lamps.weight(lamp, p, local) * lamps.link_of(lamp, self._surface.source)

    def _sum(self, side: int) -> Float:
        """Return the sum of the weights of all lights on a side."""
        mi = self._mi
        total = mi.Float(0.0)
        for number in range(len(self._rig.domes)):
            total += self._dome_weight(number, side)
        for lamps in self._rig.lamps:
            total += self._sum_of_lamps(lamps, side)
        return total

    @dr.syntax
    def _sum_of_lamps(self, lamps: Lamps, side: int) -> Float:
        """Return the sum of the weights of lamps of one kind on a side."""
        total = self._mi.Float(0.0)
        lamp = self._mi.UInt32(0)
        while lamp < lamps.count:
            total += self._lamp_weight(lamps, lamp, self._sides[side])
            lamp += 1
        return total

    def _drawn_counts(self, weight_of: Callable[[int], Float]) -> list[Float]:
        """Return the expected number of directions drawn from a light, for each side.

        `weight_of` returns the weight of the light on a side.
        """
        sides = enumerate(zip(self._counts, self._side_sums, strict=True))
        return [
            self._mi.Float(count) * dr.select(sum_ > 0.0, weight_of(side) / sum_, 0.0) for side, (count, sum_) in sides
        ]

    def _lamp_density(self, lamps: Lamps, lamp: UInt, pdf: Float) -> Float:
        """Return the density of all directions drawn from a lamp; `pdf` is the density of one direction."""
        counts = self._drawn_counts(lambda side: self._lamp_weight(lamps, lamp, self._sides[side]))
        return sum(counts, self._mi.Float(0.0)) * pdf

    def _dome_density(self, number: int, local: Vector3f, w: Vector3f, radiance: Color3f) -> Float:
        """Return the density, at direction `w`, of all directions drawn from a dome; `local` is `w` in its axes."""
        if self._rig.domes[number].map.sampled:
            pdfs = [bin.pdf(local, radiance) for bin in self._bins[number]]
        else:
            cosines = [dr.dot(w, normal) for normal in self._sides]
            pdfs = [dr.maximum(cosine, 0.0) / math.pi for cosine in cosines]
        counts = self._drawn_counts(lambda side: self._dome_weight(number, side))
        return sum((count * pdf for count, pdf in zip(counts, pdfs, strict=True)), self._mi.Float(0.0))

    def arriving(self, direction: Direction) -> list[Arriving]:
        """Return the light from all lights, as `Lighting.arriving`."""
        total = self._rig.zero_light()
        for number in range(len(self._rig.domes)):
            total = _add_arriving(total, self._arriving_from_dome(number, direction))
        for lamps in self._rig.lamps:
            total = _add_arriving(total, self._arriving_from_lamps(lamps, direction))
        return total

    def _arriving_from_dome(self, number: int, direction: Direction) -> list[Arriving]:
        """Return the part of `arriving` from a dome."""
        dome, active = self._rig.domes[number], direction.active
        local = self._frames.to_light_axes(dome, dome.first, direction.w)
        distance, radiance_seen, density_seen = self._along_dome(number, local, direction.w, active)
        density = direction.own_density + (density_seen if direction.weighed else 0.0)
        light = dr.select(active, radiance_seen / density, 0.0)
        return self._unoccluded_light(dome, dome.first, direction, light, distance)

    def _unoccluded_light(
        self, lights: LampRows, lamp: UInt, direction: Direction, light: Color3f, distance: Float
    ) -> list[Arriving]:
        """Return the light of lamps or domes that reaches the surface, as `split_by_group`.

        `light` is the light without links and occluders, and `distance` is the distance of the lamps or domes.
        """
        light = light * lights.link_of(lamp, self._surface.source)
        controls = self._rig.controls(lights, lamp)
        shares = self._rig.shadow_shares(controls, distance, direction.occluders, direction.is_straight)
        return self._rig.split_by_group(controls, (light * shares[0], light * shares[1]))

    def _along_dome(self, number: int, local: Vector3f, w: Vector3f, active: Bool) -> tuple[Float, Color3f, Float]:
        """Return a dome's distance and radiance along directions, and the density of all directions drawn from it."""
        dome, map_direction, distance = self._rig.domes[number], local, self._mi.Float(INFINITE_DISTANCE)
        density_factor: Float | float = 1.0
        if dome.is_local:
            point = self._dome_points[number]
            # The factor is the ratio of the solid angle in the map to the solid angle at the point. The field b is the
            # radius of the ball.
            inside, distance, density_factor = dome.ball("meet", p=point, w=local)
            map_direction = (point + distance * local) / dome.field(dome.first, "b")
            active = active & (inside > 0.0)
        map_radiance = dr.select(active, dome.map.radiance(map_direction, active), 0.0)
        density = self._dome_density(number, map_direction, w, map_radiance) * density_factor
        return distance, map_radiance * self._shares[number] * dome.radiance_factor, density

    @dr.syntax
    def _arriving_from_lamps(self, lamps: Lamps, direction: Direction) -> list[Arriving]:
        """Return the part of `arriving` from lamps of one kind."""
        total = self._rig.zero_light()
        lamp = self._mi.UInt32(0)
        while direction.active & (lamp < lamps.count):
            p, local = self._frames.to_frame(lamps, lamp, direction.w)
            distance, pdf = lamps.intersect(lamp, p, local)
            density = direction.own_density + direction.weighed * self._lamp_density(lamps, lamp, pdf)
            light = dr.select(distance < FAR, lamps.radiance(lamp, p, local) / density, 0.0)
            total = _add_arriving(total, self._unoccluded_light(lamps, lamp, direction, light, distance))
            lamp += 1
        return total

    def draw(self, index: UInt, number: UInt, seed: UInt, active: Bool) -> LightSample:
        """Draw a direction, as `Lighting.draw`. The first directions are in front of the surface, the others behind."""
        mi = self._mi
        front = self._counts[0]
        back = (number >= front) if len(self._sides) > 1 else mi.Bool(False)
        behind = self._counts[-1]
        sample = dr.select(back, index * behind + number - front, index * front + number)
        u1, u2 = sobol.points(
            mi.Float, sample, sobol.hash_integers(seed + 0x1B873593 + dr.select(back, mi.UInt32(1), 0))
        )
        target = u1 * dr.select(back, self._side_sums[-1], self._side_sums[0])
        # The weights of the lights are the lengths of consecutive intervals. The interval that contains the target
        # selects the light. The position of the target in the interval, clipped to [0, 1), is the first random number
        # for that light.
        end = mi.Float(0.0)
        none = self._rig.no_controls
        result = (mi.Vector3f(0.0, 0.0, 1.0), mi.Color3f(0.0), mi.Float(INFINITE_DISTANCE), mi.Float(0.0), none)
        for number_of_dome, dome in enumerate(self._rig.domes):
            weight = dr.select(
                back, self._dome_weight(number_of_dome, len(self._sides) - 1), self._dome_weight(number_of_dome, 0)
            )
            selected = (target >= end) & (target < end + weight)
            position = dr.clip((target - end) / weight, 0.0, 0.99999994)
            result = dr.select(
                selected, self._draw_from_dome(number_of_dome, dome, back, position, u2, active & selected), result
            )
            end += weight
        for lamps in self._rig.lamps:
            lamp, start, weight, end = self._select_lamp(lamps, target, end, back, active)
            selected = active & (weight > 0.0)
            position = dr.clip((target - start) / weight, 0.0, 0.99999994)
            result = dr.select(selected, self._draw_from_lamp(lamps, lamp, position, u2), result)
        return result

    @dr.syntax
    def _select_lamp(
        self, lamps: Lamps, target: Float, begin: Float, back: Bool, active: Bool
    ) -> tuple[UInt, Float, Float, Float]:
        """Return the lamp whose interval of weights contains `target`, and the start and the length of the interval.

        If no interval contains `target`, the length is 0. The intervals of these lamps start at `begin`. The last
        returned value is the end of the last interval.
        """
        mi = self._mi
        selected, start, length = mi.UInt32(0), mi.Float(0.0), mi.Float(0.0)
        end = mi.Float(begin)
        lamp = mi.UInt32(0)
        while dr.hint(active & (lamp < lamps.count), exclude=[target, back, active]):
            side = dr.select(back, -self._surface.normal, self._surface.normal)
            weight = self._lamp_weight(lamps, lamp, side)
            inside = (target >= end) & (target < end + weight)
            selected = dr.select(inside, lamp, selected)
            start = dr.select(inside, end, start)
            length = dr.select(inside, weight, length)
            end += weight
            lamp += 1
        return selected, start, length, end

    def _draw_from_lamp(self, lamps: Lamps, lamp: UInt, u1: Float, u2: Float) -> LightSample:
        """Draw a direction from a lamp by two uniform numbers."""
        p = self._frames.point(lamps, lamp)
        local, distance, pdf = lamps.draw(lamp, p, u1, u2)
        radiance = dr.select(distance < FAR, lamps.radiance(lamp, p, local), 0.0)
        w, density = self._frames.from_light_axes(lamps, lamp, local), self._lamp_density(lamps, lamp, pdf)
        return w, radiance, distance, density, self._rig.controls(lamps, lamp)

    def _draw_from_dome(
        self, number: int, dome: _RigDome, back: Bool, u1: Float, u2: Float, active: Bool
    ) -> LightSample:
        """Draw a direction from a dome by two uniform numbers."""
        mi, controls = self._mi, self._rig.controls(dome, dome.first)
        if not dome.map.sampled:
            # The density is proportional to the cosine.
            radius, (s, c) = dr.sqrt(u1), dr.sincos(2.0 * math.pi * u2)
            height = dr.safe_sqrt(1.0 - u1) * dr.select(back, -1.0, 1.0)
            w = self._surface.to_world(mi.Vector3f(radius * c, radius * s, height))
            local = self._frames.to_light_axes(dome, dome.first, w)
            distance, radiance, density = self._along_dome(number, local, w, active)
            return w, radiance, distance, density, controls
        front, behind = self._bins[number][0], self._bins[number][-1]
        map_direction, map_radiance, ratio = dr.select(
            back, behind.draw_uniform(u1, u2, active), front.draw_uniform(u1, u2, active)
        )
        local, distance = map_direction, mi.Float(INFINITE_DISTANCE)
        density_factor: Float | float = 1.0
        if dome.is_local:
            local = mi.Vector3f(*dome.ball("draw", p=self._dome_points[number], onto=map_direction))
            _, distance, density_factor = dome.ball("meet", p=self._dome_points[number], w=local)
        w = self._frames.from_light_axes(dome, dome.first, local)
        density = self._dome_density(number, map_direction, w, map_radiance) * density_factor
        return w, ratio * map_radiance * self._shares[number] * dome.radiance_factor, distance, density, controls


def _add_arriving(first: list[Arriving], second: list[Arriving]) -> list[Arriving]:
    """Return the sums of the elements of two lists of light."""
    return [(a + c, b + d) for (a, b), (c, d) in zip(first, second, strict=True)]
