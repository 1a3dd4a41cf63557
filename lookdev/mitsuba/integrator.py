"""The estimator: all samples of some pixels in one kernel.

At each hit, directions are drawn from the BSDF and from the light, weighted by the balance heuristic (Veach and Guibas
1995). One of the BSDF's directions that hit the asset again continues the path, with a probability proportional to its
throughput, as in `lookdev/shaders/surface.osl`. The directions of all samples of a pixel are one set of low-discrepancy
points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr

from lookdev.codegen.source import LOBE_GROUPS
from lookdev.light.shape import FAR
from lookdev.mitsuba import sobol
from lookdev.mitsuba.dual import Dual, difference, path_weight, product, sum_of, where
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.lights import Lighting, Lights
from lookdev.mitsuba.surface import Arriving, Looks, Response, Surface
from lookdev.mitsuba.types import UV, Bool, Color3f, Float, Mitsuba, Ray3f, UInt, Vector2f, Vector3f
from lookdev.mitsuba.view import Rectangle, View

# Russian roulette begins below this throughput: with 1, dielectrics had five times the error in equal time.
LOW_THROUGHPUT = 0.1
_NEGLIGIBLE = 1e-20  # BSDF times cosine: as in the shader


@dataclass(frozen=True)
class Counts:
    """The numbers of directions from the BSDF and from the light, at the first hit and at later ones."""

    brdf: int
    light: int
    brdf_onward: int = 1
    light_onward: int = 1
    resampled: bool = False  # whether only one of the directions from the light is traced


class Record:
    """A path at a hit: throughput, whether it is straight from the camera, and if not, the shares of groups of lobes.

    Not a dataclass: Dr.Jit makes dataclasses part of the state of its loops, and loops do not change a record.
    """

    def __init__(self, throughput: Dual, straight: Bool, shares: list[Color3f]) -> None:
        self.throughput, self.straight, self.shares = throughput, straight, shares


_Path = tuple[Float, Dual, UInt, UV, Vector3f, list[Bool], list[Color3f]]
_DrawArguments = tuple[Lighting, Record, UInt, UInt, UInt, UInt, Bool]
_Sample = tuple[Vector3f, list[Response], Color3f, Float, tuple[Float, ...], Bool, Float]


class Estimator:
    """Estimates the radiance and the coverage of pixels of a scene: geometry, looks and lights.

    Besides the beauty it records parts of it: the light that each of the `groups` of lobes reflects at the first hit;
    with `direct`, the light that reaches the first hit from lights; and the light of each recorded group of lights.
    """

    def __init__(
        self,
        mi: Mitsuba,
        geometry: Geometry,
        looks: Looks,
        light: Lights,
        counts: Counts,
        bounces: int,
        shadows: bool,
        groups: Sequence[str] = (),
        direct: bool = False,
    ) -> None:
        self._mi = mi
        self._geometry = geometry
        self._looks = looks
        self._light = light
        self._counts = counts
        self._bounces = bounces
        self._shadows = shadows
        self._groups, self._direct = groups, direct

    def pixels(self, view: View, rectangle: Rectangle, lane: UInt, seed: UInt, first: UInt, shift: UInt) -> list[Float]:
        """Return the channels of radiance, the coverage, and the channels of each part, of samples of pixels.

        `lane` has the numbers of the samples, from 0. The samples of a pixel are consecutive, and so are the pixels of
        the rectangle. `first`, the number of the first pixel in the rectangle, and `shift`, the logarithm of the
        samples per pixel, are inputs of the kernel. The results are not evaluated yet.
        """
        triangle, uv, ray, hit, visible_light, hidden, index, scramble = self._first_hits(
            view, rectangle, lane, seed, first, shift
        )
        visible_hit = hit & ~hidden
        (radiance, *parts), (cover,) = self._trace_paths(triangle, uv, -ray.d, visible_hit, view.turns, index, scramble)
        radiance += visible_light[0]
        if self._light.visible:
            cover = dr.select(hit & hidden, 1.0, cover)
            # Light that the camera sees directly is not reflected by any lobe.
            lobes = len(self._groups)
            parts = [*parts[:lobes], *sum_of(parts[lobes:], [visible_light[0]] * self._direct + visible_light[1:])]
        return [*radiance, cover, *(channel for part in parts for channel in part)]

    def _first_hits(
        self, view: View, rectangle: Rectangle, lane: UInt, seed: UInt, first: UInt, shift: UInt
    ) -> tuple[UInt, UV, Ray3f, Bool, list[Color3f], Bool, UInt, UInt]:
        """Return the first hits of samples of pixels; arguments as of `pixels`.

        These are: triangle, coordinates on it, ray, whether a triangle is hit, the light that the camera sees directly
        (`Lights.camera_radiance`), whether that hides the hit, the number of the sample in its pixel, and its scramble.
        """
        mi = self._mi
        number = first + (lane >> shift)
        row = number // rectangle.width
        pixel = (rectangle.top + row) * view.width + rectangle.left + number - row * rectangle.width
        index = lane & ((mi.UInt32(1) << shift) - 1)
        scramble = sobol.hash_integers(sobol.hash_integers(seed) ^ pixel)
        triangle, uv, ray, hit, distance = view.first_hits(mi, self._geometry, pixel, index, scramble)
        visible_light, hidden = [mi.Color3f(0.0)], mi.Bool(False)
        if self._light.visible:
            visible_light, hidden = self._light.camera_radiance(ray.o, ray.d, view.turns, dr.select(hit, distance, 0.0))
        return triangle, uv, ray, hit, visible_light, hidden, index, scramble

    @dr.syntax
    def _trace_paths(
        self, triangle: UInt, uv: UV, viewer: Vector3f, active: Bool, turns: Vector2f, index: UInt, scramble: UInt
    ) -> tuple[Dual, list[Float]]:
        """Return the light that triangles send to `viewer`, as `_reflect` returns it, and the coverage.

        Variables that loops only read are excluded from their state: otherwise Dr.Jit traces the bodies twice.
        """
        mi = self._mi
        total, throughput = self._no_light(), self._constant(1.0)
        depth = mi.UInt32(0)
        active = mi.Bool(active)
        whole = [dr.select(active, mi.Float(1.0), 0.0), *(mi.Float(0.0) for _ in throughput[1:])]
        # Where looks can be seen through: the visible share of the background, and whether a path is straight so far.
        seen_background = [mi.Float(0.0) for _ in throughput if self._looks.see_through]
        through = [mi.Bool(active)] * self._looks.see_through
        # The share of each group of lobes in the throughput, by channel, after the first reflection.
        shares = [mi.Color3f(0.0) for _ in self._groups]
        while dr.hint(active, exclude=[index, scramble, turns]):
            surface = self._surface(triangle, uv, viewer, active)
            seed = sobol.hash_integers(scramble + depth)
            first = depth == 0
            brdf_count = dr.select(first, mi.UInt32(self._counts.brdf), mi.UInt32(self._counts.brdf_onward))
            light_count = dr.select(first, mi.UInt32(self._counts.light), mi.UInt32(self._counts.light_onward))
            lighting = self._light.at(surface, turns, light_count, self._looks.transmits)
            onward = depth < self._bounces
            straight = through[0] if self._looks.see_through else first
            record = Record(throughput, straight, shares)

            path, reflected, background = self._follow(surface, lighting, record, active, onward, seed ^ index)
            total = sum_of(total, reflected)
            seen_background = sum_of(
                seen_background, [dr.mean(element) for element in product(throughput, background)] if background else []
            )
            share, next_weight, next_triangle, next_uv, next_viewer, next_through, next_shares = path

            # Directions of the BSDF.
            k = mi.UInt32(0)
            while dr.hint(active & (k < brdf_count), exclude=[index, brdf_count, seed, onward, straight, active]):
                number = index * brdf_count + k
                u1, u2 = sobol.points(mi.Float, number, seed)
                wi = surface.draw(u1, u2, active)
                responses, pdf = surface.respond(wi, active, self._light.split, self._groups)
                w = surface.to_world(wi)
                valid = active & self._is_on_side(surface, wi, w) & _contributes(responses) & (pdf > 0.0)
                density = mi.Float(brdf_count) * pdf
                blocked, occluder, hit_triangle, hit_uv = self._trace(surface, w, valid)
                occluders = self._occluders(surface, w, occluder, blocked)
                arriving = lighting.arriving(w, density, 1.0, occluders, valid, straight=False)
                total = sum_of(total, self._reflect(record, responses, arriving, valid))
                # Weighted reservoir sampling: a hit is selected with a probability proportional to its weight.
                weight = where(valid & blocked & onward, [response.value / density for response in responses])
                share += path_weight(weight)
                accepted = (path_weight(weight) > 0.0) & (
                    sobol.unit_float(mi.Float, sobol.hash_integers(seed ^ (number + 1) * 0x3504F333)) * share
                    < path_weight(weight)
                )
                next_weight = dr.select(accepted, [element / path_weight(weight) for element in weight], next_weight)
                next_triangle = dr.select(accepted, hit_triangle, next_triangle)
                next_uv = dr.select(accepted, hit_uv, next_uv)
                next_viewer = dr.select(accepted, -w, next_viewer)
                next_through = [flag & ~accepted for flag in next_through]
                next_shares = dr.select(accepted & straight, responses[0].shares(), next_shares)
                k += 1

            total = sum_of(
                total, self._sample_light(surface, lighting, record, index, brdf_count, light_count, seed, active)
            )

            throughput = product(throughput, [element * share for element in next_weight])
            # Russian roulette: a path of low throughput ends, or goes on with a larger weight.
            survival = dr.minimum(path_weight(throughput) / LOW_THROUGHPUT, 1.0)
            survives = (
                sobol.unit_float(mi.Float, sobol.hash_integers(seed ^ index * 0x2545F491 ^ 0x1B873593)) < survival
            )
            throughput = where(survives, [element / survival for element in throughput])
            active &= onward & survives & (share > 0.0)
            triangle, uv, viewer, through = next_triangle, next_uv, next_viewer, next_through
            shares = next_shares
            depth += 1
        return total, difference(whole, seen_background) if seen_background else whole

    def _surface(self, triangle: UInt, uv: UV, viewer: Vector3f, active: Bool) -> Surface:
        return Surface(self._looks, triangle, uv, viewer, active)

    def _constant(self, value: float) -> Dual:
        return [self._mi.Color3f(value)]

    def _sample_light(self, surface: Surface, *arguments: *_DrawArguments) -> Dual:
        """Return the reflected light of directions drawn from the light, as `_reflect` returns it."""
        if not self._light.sampled:
            return self._no_light()
        estimate = self._resample_light if self._counts.resampled else self._sample_light_fully
        return estimate(surface, *arguments)

    @dr.syntax
    def _sample_light_fully(
        self,
        surface: Surface,
        lighting: Lighting,
        record: Record,
        index: UInt,
        brdf_count: UInt,
        light_count: UInt,
        seed: UInt,
        active: Bool,
    ) -> Dual:
        total, j = self._no_light(), self._mi.UInt32(0)
        while dr.hint(active & (j < light_count), exclude=[index, brdf_count, light_count, seed, active]):
            sample = self._draw_from_light(surface, lighting, index, j, brdf_count, seed, active)
            total = sum_of(total, self._reflect_drawn(surface, record, sample, self._mi.Float(1.0)))
            j += 1
        return total

    @dr.syntax
    def _resample_light(
        self,
        surface: Surface,
        lighting: Lighting,
        record: Record,
        index: UInt,
        brdf_count: UInt,
        light_count: UInt,
        seed: UInt,
        active: Bool,
    ) -> Dual:
        """Return the light of one direction, selected in proportion to its unoccluded contribution, for all of them.

        For glossy surfaces, whose lobes most directions from the light miss (Talbot et al. 2005, "Importance Resampling
        for Global Illumination").
        """
        mi = self._mi
        j, selected = mi.UInt32(0), mi.UInt32(0)
        sum_, selected_weight = mi.Float(0.0), mi.Float(0.0)
        while dr.hint(active & (j < light_count), exclude=[index, brdf_count, light_count, seed, active]):
            weight = self._draw_from_light(surface, lighting, index, j, brdf_count, seed, active)[-1]
            sum_ += weight
            random = sobol.unit_float(mi.Float, sobol.hash_integers(seed ^ (index * light_count + j + 1) * 0x85EBCA77))
            accepted = (weight > 0.0) & (random * sum_ < weight)
            selected = dr.select(accepted, j, selected)
            selected_weight = dr.select(accepted, weight, selected_weight)
            j += 1
        sample = self._draw_from_light(surface, lighting, index, selected, brdf_count, seed, active & (sum_ > 0.0))
        return self._reflect_drawn(surface, record, sample, sum_ / selected_weight)

    def _draw_from_light(
        self, surface: Surface, lighting: Lighting, index: UInt, j: UInt, brdf_count: UInt, seed: UInt, active: Bool
    ) -> _Sample:
        """Return a direction from the light, responses, radiance / density, distance, controls, mask, contribution."""
        w, radiance, distance, density, controls = lighting.draw(index, j, seed, active)
        wi = surface.to_local(w)
        responses, pdf = surface.respond(wi, active, self._light.split, self._groups)
        valid = active & self._is_on_side(surface, wi, w) & _contributes(responses)
        valid &= dr.max(radiance) > 0.0
        weight = radiance / (self._mi.Float(brdf_count) * pdf + density)
        contribution = dr.select(valid, dr.mean(responses[0].value * weight), 0.0)
        return w, responses, weight, distance, controls, valid, contribution

    def _reflect_drawn(self, surface: Surface, record: Record, sample: _Sample, factor: Float) -> Dual:
        """Return the reflected light of a direction of `_draw_from_light`, as `_reflect` returns it."""
        w, responses, weight, distance, controls, valid, _ = sample
        specular, diffuse = self._unoccluded_shares(surface, w, distance, controls, valid)
        weight = weight * dr.select(valid, factor, 0.0)
        arriving = self._light.by_group(controls, (weight * specular, weight * diffuse))
        return self._reflect(record, responses, arriving, valid)

    def _no_light(self) -> Dual:
        """Return zero light and zero parts, as `_reflect` returns them."""
        return [self._mi.Color3f(0.0) for _ in range(1 + len(self._groups) + self._direct + self._light.groups)]

    def _reflect(self, record: Record, responses: list[Response], arriving: list[Arriving], active: Bool) -> Dual:
        """Return the reflected light and its parts: by groups of lobes, direct, and by groups of lights."""
        (throughput, *_), (response, *_) = record.throughput, responses
        whole, *of_lights = where(active, [throughput * response.to(light) for light in arriving])
        by_lobes = [throughput * part for part in response.parts_to(arriving[0])]
        of_lobes = [
            dr.select(active, dr.select(record.straight, part, share * whole), 0.0)
            for part, share in zip(by_lobes, record.shares, strict=True)
        ]
        direct = [dr.select(record.straight, whole, 0.0)] * self._direct
        return [whole, *of_lobes, *direct, *of_lights]

    def _follow(
        self, surface: Surface, lighting: Lighting, record: Record, active: Bool, onward: Bool, seed: UInt
    ) -> tuple[_Path, Dual, Dual]:
        """Follow the single directions of the BSDF, which sampling the light never draws.

        Where the surface is absent, a path goes straight on; from the camera, the background is black. Returns the path
        to continue (the sum of weights, its own weight over that sum, triangle, coordinates, direction back, whether it
        is still straight from the camera, the shares of groups), the reflected light, as `_reflect` returns it, and the
        visible share of the background if looks can be seen through.
        """
        mi, see_through = self._mi, self._looks.see_through
        total, share = self._no_light(), mi.Float(0.0)
        background = self._constant(0.0) if see_through else []
        next_path: tuple[Dual, UInt, UV, Vector3f] = (
            self._constant(0.0), mi.UInt32(surface.triangle), mi.Point2f(surface.uv), mi.Vector3f(surface.viewer)
        )  # fmt: skip
        next_through = [mi.Bool(False)] * see_through
        next_shares = [mi.Color3f(initial) for initial in record.shares]
        for number, (w, responses, passes) in enumerate(self._single_directions(surface)):
            weight = [response.value for response in responses]
            valid = active & (dr.max(weight[0]) > 0.0)
            blocked, occluder, triangle, uv = self._trace(surface, w, valid)
            occluders = self._occluders(surface, w, occluder, blocked)
            straight_on = record.straight & passes
            reflecting = valid & ~straight_on
            arriving = lighting.arriving(w, mi.Float(1.0), 0.0, occluders, reflecting, straight=passes)
            total = sum_of(total, self._reflect(record, responses, arriving, reflecting))
            if see_through:
                background = sum_of(background, where(valid & ~blocked & straight_on, weight))
            next_size = dr.select(valid & blocked & onward, path_weight(weight), 0.0)
            share += next_size
            random = sobol.unit_float(mi.Float, sobol.hash_integers(seed + (number + 1) * 0x1B873593))
            accepted = (next_size > 0.0) & (random * share < next_size)
            next_path = dr.select(accepted, ([element / next_size for element in weight], triangle, uv, -w), next_path)
            next_through = [dr.select(accepted, straight_on, flag) for flag in next_through]
            next_shares = dr.select(accepted & record.straight & ~straight_on, responses[0].shares(), next_shares)
        return (share, *next_path, next_through, next_shares), total, background

    def _single_directions(self, surface: Surface) -> list[tuple[Vector3f, list[Response], bool]]:
        """Return the single directions in world space, the responses to them, and whether they pass the surface."""
        black = self._mi.Color3f(0.0)
        singles: list[tuple[Vector3f, list[Response], bool]] = []
        for number in range(self._looks.deltas):
            wi, value, group = surface.delta(number)
            w = surface.to_world(wi)
            value = where(self._is_on_side(surface, wi, w), value)
            groups = [group == LOBE_GROUPS.index(name) for name in self._groups]
            parts = [(part, black) for part in (dr.select(in_group, value[0], 0.0) for in_group in groups)]
            singles.append((w, [Response((factor, black), parts, False) for factor in value], False))
        if self._looks.see_through:
            parts = [(black, black)] * len(self._groups)
            absent = [Response((factor, black), parts, False) for factor in surface.absence()]
            singles.append((-surface.viewer, absent, True))
        return singles

    def _is_on_side(self, surface: Surface, wi: Vector3f, w: Vector3f) -> Bool:
        """Return where a direction is on the same side of shading normal and facet, and on one that the looks allow."""
        height = dr.dot(w, surface.facet)
        if self._looks.transmits:
            return wi.z * height > 0.0
        return (wi.z > 0.0) & (height > 0.0)

    def _ray(self, surface: Surface, w: Vector3f) -> Ray3f:
        side = dr.select(dr.dot(w, surface.facet) < 0.0, -surface.lift, surface.lift)
        return self._mi.Ray3f(self._mi.Point3f(surface.point + side * surface.facet), w)

    def _trace(self, surface: Surface, w: Vector3f, active: Bool) -> tuple[Bool, Float, UInt, UV]:
        """Return which directions hit the asset, the distances, and the triangles and coordinates of the hits."""
        if not self._shadows:
            return self._mi.Bool(False), self._mi.Float(FAR), surface.triangle, surface.uv
        intersection = self._geometry.scene.ray_intersect_preliminary(
            self._ray(surface, w), coherent=False, active=active
        )
        hit = intersection.is_valid()
        return hit, dr.select(hit, intersection.t, FAR), self._geometry.triangle_of(intersection), intersection.prim_uv

    def _occluders(self, surface: Surface, w: Vector3f, occluder: Float, blocked: Bool) -> list[Float]:
        """Return the distances of occluders for each set of `shadow_excluded`; `occluder` is that of any part."""
        distances = []
        for number, excluded in enumerate(self._light.shadow_excluded):
            far = self._mi.Float(FAR)
            distances.append(self._occluder(number, surface, w, far, blocked) if excluded else occluder)
        return distances

    def _unoccluded_shares(
        self, surface: Surface, w: Vector3f, distance: Float, controls: tuple[Float, ...], active: Bool
    ) -> Arriving:
        """Return the shares of lights at a distance that occluders transmit."""
        occluders = [
            self._occluder(number, surface, w, distance, active & self._light.excludes(controls, number))
            for number in range(len(self._light.shadow_excluded))
        ]
        return self._light.shadow_shares(controls, distance, occluders)

    def _occluder(self, number: int, surface: Surface, w: Vector3f, distance: Float, active: Bool) -> Float:
        """Return the distance of the first occluder for a set of `shadow_excluded`; `FAR` beyond `distance`."""
        mi = self._mi
        if not self._shadows:
            return mi.Float(FAR)
        ray = self._ray(surface, w)
        ray.maxt = distance
        scene = self._geometry.shadow_scene(self._light.shadow_excluded[number])
        if not self._light.shadowed and len(self._light.shadow_excluded) == 1:
            return dr.select(scene.ray_test(ray, coherent=False, active=active), mi.Float(0.0), FAR)
        intersection = scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        return dr.select(intersection.is_valid(), intersection.t, FAR)


def _contributes(responses: list[Response]) -> Bool:
    """Return where the light of a direction is reflected, or has a derivative."""
    first, *slopes = responses
    contributes = dr.max(first.value) > _NEGLIGIBLE
    for slope in slopes:
        contributes |= dr.max(dr.abs(slope.value)) > _NEGLIGIBLE
    return contributes
