"""The path tracer on Dr.Jit's arrays: one kernel estimates the light of all samples of some pixels.

At each hit, directions are drawn from the BSDF and from the light, and weighted by the balance heuristic (Veach and
Guibas 1995). A direction from the BSDF may hit the asset again. One of these directions continues the path; it is
selected in proportion to its throughput, as in `lookdev/shaders/surface.osl`. The directions of all samples of a pixel
are one set of low-discrepancy points.

Light is a dual (`lookdev.mitsuba.dual`): here, a list of the light, then the parts of it that passes record. In
`lookdev.mitsuba.derivatives`, it is a list of the light and its derivatives. `w` is a direction in world space, and
`wi` is the same direction in the shading frame. Hexadecimal constants are arbitrary odd numbers. Random numbers that
are derived from the same seed use different constants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr

from lookdev.codegen.source import LOBE_GROUPS
from lookdev.light.shape import FAR
from lookdev.mitsuba import sobol
from lookdev.mitsuba.dual import Dual, difference, path_weight, product, sum_of, where
from lookdev.mitsuba.lights import Direction, Lighting, SceneLights
from lookdev.mitsuba.surface import Arriving, Response, SceneLooks, SurfacePoints
from lookdev.mitsuba.types import UV, Bool, Color3f, Float, Ray3f, UInt, Vector2f, Vector3f
from lookdev.mitsuba.view import FramePart, KernelView
from lookdev.scene import Sampling

# Russian roulette begins below this throughput. With 1 instead, dielectrics have five times the error in equal time.
LOW_THROUGHPUT = 0.1
_NEGLIGIBLE = 1e-20  # directions with at most this BSDF times cosine are left out, as in the OSL shader


@dataclass(frozen=True)
class PathDirectionCounts:
    """The numbers of directions that are drawn at a hit of a path."""

    brdf: int  # from the BSDF, at the first hit
    light: int  # from the light, at the first hit
    brdf_onward: int = 1  # from the BSDF, at later hits
    light_onward: int = 1  # from the light, at later hits
    is_resampled: bool = False  # whether only one of the directions from the light is selected and traced


# The numbers for diffuse looks, for glossy looks, and for glossy looks with resampling. In recesses, a path adds one
# sample of the light from other parts, no matter how many directions its first hit draws (as in
# `lookdev.codegen.osl.surface`). Glossy looks therefore draw few directions at the first hit.
_COUNTS, _GLOSSY_COUNTS, _RESAMPLED_COUNTS = (
    PathDirectionCounts(2, 4, 1, 4),
    PathDirectionCounts(1, 2, 1, 4),
    PathDirectionCounts(1, 4, 1, 8, is_resampled=True),
)


def direction_counts(
    sampling: Sampling, is_light_sampled: bool, is_glossy: bool, can_resample: bool = True
) -> PathDirectionCounts:
    """Return the numbers of directions: from the job, or else defaults, which reach an error in the least time.

    is_light_sampled : whether directions can be drawn from the light; is_glossy : whether all looks are glossy;
    can_resample : whether the estimator can select and trace a single one of the directions from the light.
    """
    default = _COUNTS
    if is_glossy and sampling.bounces > 0:
        default = _RESAMPLED_COUNTS if can_resample and sampling.ibl_samples is None else _GLOSSY_COUNTS
    brdf = default.brdf if sampling.brdf_samples is None else sampling.brdf_samples
    light = default.light if sampling.ibl_samples is None else sampling.ibl_samples
    if not is_light_sampled or light == 0:
        return PathDirectionCounts(max(brdf, 1), 0, 1, 0)
    onward = default.light_onward if sampling.ibl_samples is None else -(-light // 2)
    # Later hits draw a direction from the BSDF in any case, so that the path goes on.
    return PathDirectionCounts(brdf, light, 1, onward, default.is_resampled)


class Vertex:
    """The vertices of paths at one depth. Each array has one element per path.

    Parameters
    ----------
    surface, lighting
        The points of the surface, and the light there.
    path
        Three values: the throughput; whether the path is straight, so that nothing has scattered it since the camera;
        for scattered paths, the share of each group of lobes in the throughput.
    counts
        The numbers of directions to draw from the BSDF and from the light.
    index
        The number of the sample in its pixel.
    seed
        The seed of the low-discrepancy points that select directions.

    The class is not a dataclass: Dr.Jit makes dataclasses part of the state of its loops, and loops do not change a
    vertex.
    """

    def __init__(
        self,
        surface: SurfacePoints,
        lighting: Lighting,
        path: tuple[Dual, Bool, list[Color3f]],
        counts: tuple[UInt, UInt],
        index: UInt,
        seed: UInt,
    ) -> None:
        self.surface, self.lighting, self.active = surface, lighting, surface.active
        self.throughput, self.is_straight, self.shares = path
        self.brdf_count, self.light_count = counts
        self.index, self.seed = index, seed


_Path = tuple[Float, Dual, UInt, UV, Vector3f, list[Bool], list[Color3f]]
"""The path to continue, as `Estimator._follow_deltas` returns it."""

_Sample = tuple[Vector3f, list[Response], Color3f, Float, tuple[Float, ...], Bool, Float]
"""A direction drawn from the light, as `Estimator._draw_from_light` returns it."""


class Estimator:
    """Estimates the radiance and the coverage of pixels of a scene.

    It also estimates parts of the radiance, in this order: the light that each of the `groups` of lobes reflects at the
    first hit; the direct light, if the pass is requested; and the light of each recorded group of lights.
    """

    _can_resample = True  # whether a single one of the directions from the light can be selected and traced

    def __init__(self, looks: SceneLooks, light: SceneLights, sampling: Sampling, groups: Sequence[str] = ()) -> None:
        self._mi, self._geometry, self._looks, self._light = looks.mi, looks.geometry, looks, light
        glossy = all(source.glossy for source in looks.sources)
        self._counts = direction_counts(sampling, light.sampled, glossy, self._can_resample)
        self._bounces = sampling.bounces
        self._shadows = any(source.shadows for source in looks.sources)
        self._groups, self._direct = groups, "direct" in sampling.passes

    def render_pixels(
        self, view: KernelView, rectangle: FramePart, lane: UInt, seed: UInt, first: UInt, shift: UInt
    ) -> list[Float]:
        """Return arrays over samples of pixels: three channels of radiance, the coverage, three channels of each part.

        The arrays are not evaluated yet.

        Parameters
        ----------
        view, rectangle
            The camera, and the rectangle of the frame. The pixels of a rectangle are numbered row by row.
        lane
            The numbers of the samples, from 0. The samples of a pixel are consecutive, and so are the pixels.
        seed
            The seed of the samples.
        first
            The number of the first pixel to render.
        shift
            The base 2 logarithm of the samples per pixel.
        """
        (radiance, *parts), (coverage,), visible_light = self._estimate(view, rectangle, lane, seed, first, shift)
        if self._light.visible:
            # Light that the camera sees directly is not reflected by any lobe.
            lobes = len(self._groups)
            parts = [*parts[:lobes], *sum_of(parts[lobes:], [visible_light[0]] * self._direct + visible_light[1:])]
        return [*radiance, coverage, *(channel for part in parts for channel in part)]

    def _estimate(
        self, view: KernelView, rectangle: FramePart, lane: UInt, seed: UInt, first: UInt, shift: UInt
    ) -> tuple[Dual, list[Float], list[Color3f]]:
        """Return three values: the light of samples and its parts, the coverage, and the light seen directly.

        The light is a dual as `_reflect` returns it, and the coverage is followed by its derivatives. The parts exclude
        light that the camera sees directly, which has no derivative. The third value has this light, as
        `SceneLights.camera_radiance` returns it. The arguments are as in `render_pixels`.
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
        light, coverage = self._trace_paths(triangle, uv, -ray.d, hit & ~hidden, view.turns, index, scramble)
        light[0] += visible_light[0]
        coverage[0] = dr.select(hit & hidden, 1.0, coverage[0])
        return light, coverage, visible_light

    @dr.syntax
    def _trace_paths(
        self, triangle: UInt, uv: UV, viewer: Vector3f, active: Bool, turns: Vector2f, index: UInt, scramble: UInt
    ) -> tuple[Dual, list[Float]]:
        """Return the light that triangles reflect towards `viewer`, as `_reflect` returns it, and the coverage.

        triangle, uv : the numbers of the triangles, and barycentric coordinates; turns : rotations of lights; index :
        the number of a sample in its pixel; scramble : the seed of the pixel.

        Dr.Jit traces the body of a loop twice if the state of the loop contains variables that the loop only reads.
        Such variables are therefore excluded from the state.
        """
        mi = self._mi
        total, throughput = self._no_light(), self._constant_dual(1.0)
        depth = mi.UInt32(0)
        active = mi.Bool(active)
        coverage = [dr.select(active, mi.Float(1.0), 0.0), *(mi.Float(0.0) for _ in throughput[1:])]
        # If looks can be seen through: the visible share of the background, and whether a path is straight so far. If
        # not, both lists are empty.
        seen_background = [mi.Float(0.0) for _ in throughput if self._looks.see_through]
        straight = [mi.Bool(active)] * self._looks.see_through
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
            is_straight = straight[0] if self._looks.see_through else first
            counts = brdf_count, light_count
            vertex = Vertex(surface, lighting, (throughput, is_straight, shares), counts, index, seed)

            path, reflected, background = self._follow_deltas(vertex, onward)
            total = sum_of(total, reflected)
            seen_background = sum_of(
                seen_background, [dr.mean(element) for element in product(throughput, background)] if background else []
            )
            weight_sum, next_weight, next_triangle, next_uv, next_viewer, next_straight, next_shares = path

            # Directions of the BSDF.
            k = mi.UInt32(0)
            while dr.hint(active & (k < brdf_count), exclude=[index, brdf_count, seed, onward, is_straight, active]):
                number = index * brdf_count + k
                u1, u2 = sobol.points(mi.Float, number, seed)
                wi = surface.draw(u1, u2, active)
                responses, pdf = surface.respond(wi, active, self._light.split, self._groups)
                w = surface.to_world(wi)
                valid = active & self._is_on_side(surface, wi, w) & _contributes(responses) & (pdf > 0.0)
                density = mi.Float(brdf_count) * pdf
                blocked, occluder_distance, hit_triangle, hit_uv = self._trace(surface, w, valid)
                occluders = self._occluder_distances(surface, w, occluder_distance, blocked)
                arriving = lighting.arriving(Direction(w, density, 1.0, occluders, valid))
                total = sum_of(total, self._reflect(vertex, responses, arriving, valid))
                # Weighted reservoir sampling selects one of all hits, with a probability proportional to its weight.
                weight = where(valid & blocked & onward, [response.value / density for response in responses])
                weight_sum += path_weight(weight)
                random = sobol.random(mi.Float, seed ^ (number + 1) * 0x3504F333)
                accepted = (path_weight(weight) > 0.0) & (random * weight_sum < path_weight(weight))
                next_weight = dr.select(accepted, [element / path_weight(weight) for element in weight], next_weight)
                next_triangle = dr.select(accepted, hit_triangle, next_triangle)
                next_uv = dr.select(accepted, hit_uv, next_uv)
                next_viewer = dr.select(accepted, -w, next_viewer)
                next_straight = [flag & ~accepted for flag in next_straight]
                next_shares = dr.select(accepted & is_straight, responses[0].shares(), next_shares)
                k += 1

            total = sum_of(total, self._sample_light(vertex))

            throughput = product(throughput, [element * weight_sum for element in next_weight])
            # Russian roulette: a path of low throughput ends, or continues with a larger weight.
            survival = dr.minimum(path_weight(throughput) / LOW_THROUGHPUT, 1.0)
            survives = sobol.random(mi.Float, seed ^ index * 0x2545F491 ^ 0x1B873593) < survival
            throughput = where(survives, [element / survival for element in throughput])
            active &= onward & survives & (weight_sum > 0.0)
            triangle, uv, viewer, straight = next_triangle, next_uv, next_viewer, next_straight
            shares = next_shares
            depth += 1
        return total, difference(coverage, seen_background) if seen_background else coverage

    def _surface(self, triangle: UInt, uv: UV, viewer: Vector3f, active: Bool) -> SurfacePoints:
        """Return the points of surfaces that paths have hit."""
        return SurfacePoints(self._looks, triangle, uv, viewer, active)

    def _constant_dual(self, value: float) -> Dual:
        """Return a grey colour as a dual whose derivatives are 0."""
        return [self._mi.Color3f(value)]

    def _sample_light(self, vertex: Vertex) -> Dual:
        """Return the light that is reflected from directions drawn from the light, as `_reflect` returns it."""
        if not self._light.sampled:
            return self._no_light()
        return self._resample_light(vertex) if self._counts.is_resampled else self._sample_light_fully(vertex)

    @dr.syntax
    def _sample_light_fully(self, vertex: Vertex) -> Dual:
        """Return the reflected light of all directions; each direction is traced."""
        total, j = self._no_light(), self._mi.UInt32(0)
        while vertex.active & (j < vertex.light_count):
            sample = self._draw_from_light(vertex, j, vertex.active)
            total = sum_of(total, self._reflect_drawn(vertex, sample, self._mi.Float(1.0)))
            j += 1
        return total

    @dr.syntax
    def _resample_light(self, vertex: Vertex) -> Dual:
        """Return the reflected light of all directions, estimated from the only direction that is traced.

        This direction is selected in proportion to its contribution without occlusion (Talbot et al. 2005, "Importance
        Resampling for Global Illumination"). The selection pays off for glossy surfaces, because most directions from
        the light miss their lobes.
        """
        mi = self._mi
        j, selected = mi.UInt32(0), mi.UInt32(0)
        sum_, selected_weight = mi.Float(0.0), mi.Float(0.0)
        while vertex.active & (j < vertex.light_count):
            weight = self._draw_from_light(vertex, j, vertex.active)[-1]
            sum_ += weight
            number = vertex.index * vertex.light_count + j + 1
            random = sobol.random(mi.Float, vertex.seed ^ number * 0x85EBCA77)
            accepted = (weight > 0.0) & (random * sum_ < weight)
            selected = dr.select(accepted, j, selected)
            selected_weight = dr.select(accepted, weight, selected_weight)
            j += 1
        sample = self._draw_from_light(vertex, selected, vertex.active & (sum_ > 0.0))
        return self._reflect_drawn(vertex, sample, sum_ / selected_weight)

    def _draw_from_light(self, vertex: Vertex, j: UInt, active: Bool) -> _Sample:
        """Return direction `j` drawn from the light, and everything about it that needs no shadow ray.

        The tuple has these members: the direction; the responses; the radiance over the density of all drawn
        directions; the distance of the light; the controls of the light (`SceneLights`); a mask of directions that
        contribute; the mean contribution without occlusion.
        """
        surface = vertex.surface
        w, radiance, distance, density, controls = vertex.lighting.draw(vertex.index, j, vertex.seed, active)
        wi = surface.to_local(w)
        responses, pdf = surface.respond(wi, active, self._light.split, self._groups)
        valid = active & self._is_on_side(surface, wi, w) & _contributes(responses)
        valid &= dr.max(radiance) > 0.0
        weight = radiance / (self._mi.Float(vertex.brdf_count) * pdf + density)
        contribution = dr.select(valid, dr.mean(responses[0].value * weight), 0.0)
        return w, responses, weight, distance, controls, valid, contribution

    def _reflect_drawn(self, vertex: Vertex, sample: _Sample, factor: Float) -> Dual:
        """Trace a direction of `_draw_from_light`; return its reflected light times a factor, as `_reflect` does."""
        w, responses, weight, distance, controls, valid, _ = sample
        specular, diffuse = self._unoccluded_shares(vertex.surface, w, distance, controls, valid)
        weight = weight * dr.select(valid, factor, 0.0)
        arriving = self._light.split_by_group(controls, (weight * specular, weight * diffuse))
        return self._reflect(vertex, responses, arriving, valid)

    def _no_light(self) -> Dual:
        """Return zero light and zero parts, as `_reflect` returns them."""
        return [self._mi.Color3f(0.0) for _ in range(1 + len(self._groups) + self._direct + self._light.groups)]

    def _reflect(self, vertex: Vertex, responses: list[Response], arriving: list[Arriving], active: Bool) -> Dual:
        """Return the light that is reflected along the path: the whole light, then its parts.

        The parts are one for each group of lobes, the direct light if requested, and one for each group of lights.
        `arriving` has the arriving light over its density: the whole light, then the light of each group of lights.
        """
        (throughput, *_), (response, *_) = vertex.throughput, responses
        reflected, *light_parts = where(active, [throughput * response.to(light) for light in arriving])
        response_parts = [throughput * part for part in response.parts_to(arriving[0])]
        lobe_parts = [
            dr.select(active, dr.select(vertex.is_straight, part, share * reflected), 0.0)
            for part, share in zip(response_parts, vertex.shares, strict=True)
        ]
        direct = [dr.select(vertex.is_straight, reflected, 0.0)] * self._direct
        return [reflected, *lobe_parts, *direct, *light_parts]

    def _follow_deltas(self, vertex: Vertex, onward: Bool) -> tuple[_Path, Dual, Dual]:
        """Follow the delta directions of the BSDF, which are never drawn from the light.

        Where the presence of the surface is below 1, one of these directions passes straight through it. For a path
        that nothing has scattered since the camera, the background is black.

        Returns
        -------
        path
            The path to continue, if there is one: the sum of the weights of all hits; for the selected hit, its weight
            (a dual) divided by the mean of the weight's colour, its triangle, barycentric coordinates and the direction
            back; whether the path is still straight since the camera; the shares of groups of lobes in the throughput.
        light
            The reflected light, as `_reflect` returns it.
        background
            The visible share of the background; empty if looks cannot be seen through.
        """
        mi, see_through, surface = self._mi, self._looks.see_through, vertex.surface
        seed = vertex.seed ^ vertex.index
        total, weight_sum = self._no_light(), mi.Float(0.0)
        background = self._constant_dual(0.0) if see_through else []
        next_path: tuple[Dual, UInt, UV, Vector3f] = (
            self._constant_dual(0.0), mi.UInt32(surface.triangle), mi.Point2f(surface.uv), mi.Vector3f(surface.viewer)
        )  # fmt: skip
        next_straight = [mi.Bool(False)] * see_through
        next_shares = [mi.Color3f(initial) for initial in vertex.shares]
        for number, (w, responses, passes) in enumerate(self._delta_directions(surface)):
            weight = [response.value for response in responses]
            valid = vertex.active & (dr.max(weight[0]) > 0.0)
            blocked, occluder_distance, triangle, uv = self._trace(surface, w, valid)
            occluders = self._occluder_distances(surface, w, occluder_distance, blocked)
            straight_on = vertex.is_straight & passes
            reflecting = valid & ~straight_on
            arriving = vertex.lighting.arriving(Direction(w, mi.Float(1.0), 0.0, occluders, reflecting, passes))
            total = sum_of(total, self._reflect(vertex, responses, arriving, reflecting))
            if see_through:
                background = sum_of(background, where(valid & ~blocked & straight_on, weight))
            selection_weight = dr.select(valid & blocked & onward, path_weight(weight), 0.0)
            weight_sum += selection_weight
            random = sobol.random(mi.Float, seed + (number + 1) * 0x1B873593)
            accepted = (selection_weight > 0.0) & (random * weight_sum < selection_weight)
            weight = [element / selection_weight for element in weight]
            next_path = dr.select(accepted, (weight, triangle, uv, -w), next_path)
            next_straight = [dr.select(accepted, straight_on, flag) for flag in next_straight]
            next_shares = dr.select(accepted & vertex.is_straight & ~straight_on, responses[0].shares(), next_shares)
        return (weight_sum, *next_path, next_straight, next_shares), total, background

    def _delta_directions(self, surface: SurfacePoints) -> list[tuple[Vector3f, list[Response], bool]]:
        """Return the delta directions in world space, the responses to them, and whether each passes the surface."""
        black = self._mi.Color3f(0.0)
        deltas: list[tuple[Vector3f, list[Response], bool]] = []
        for number in range(self._looks.deltas):
            wi, value, group = surface.delta(number)
            w = surface.to_world(wi)
            value = where(self._is_on_side(surface, wi, w), value)
            groups = [group == LOBE_GROUPS.index(name) for name in self._groups]
            parts = [(part, black) for part in (dr.select(in_group, value[0], 0.0) for in_group in groups)]
            deltas.append((w, [Response((factor, black), parts, False) for factor in value], False))
        if self._looks.see_through:
            parts = [(black, black)] * len(self._groups)
            absent = [Response((factor, black), parts, False) for factor in surface.absence()]
            deltas.append((-surface.viewer, absent, True))
        return deltas

    def _is_on_side(self, surface: SurfacePoints, wi: Vector3f, w: Vector3f) -> Bool:
        """Return where a direction is on the same side of the shading normal and of the facet.

        Unless looks transmit light, it must be the front side.
        """
        height = dr.dot(w, surface.facet)
        if self._looks.transmits:
            return wi.z * height > 0.0
        return (wi.z > 0.0) & (height > 0.0)

    def _ray(self, surface: SurfacePoints, w: Vector3f) -> Ray3f:
        """Return rays that leave a surface. They start a small distance above or below its facet."""
        side = dr.select(dr.dot(w, surface.facet) < 0.0, -surface.lift, surface.lift)
        return self._mi.Ray3f(self._mi.Point3f(surface.point + side * surface.facet), w)

    def _trace(self, surface: SurfacePoints, w: Vector3f, active: Bool) -> tuple[Bool, Float, UInt, UV]:
        """Return hit masks of directions, distances (`FAR` without a hit), triangles, and barycentric coordinates."""
        if not self._shadows:
            return self._mi.Bool(False), self._mi.Float(FAR), surface.triangle, surface.uv
        intersection = self._geometry.scene.ray_intersect_preliminary(
            self._ray(surface, w), coherent=False, active=active
        )
        hit = intersection.is_valid()
        return hit, dr.select(hit, intersection.t, FAR), self._geometry.triangle_of(intersection), intersection.prim_uv

    def _occluder_distances(self, surface: SurfacePoints, w: Vector3f, nearest: Float, blocked: Bool) -> list[Float]:
        """Return the distance of the first occluder along a direction, for each set in `SceneLights.shadow_excluded`.

        A set lists groups of parts that cast no shadow. For the empty set, the distance is `nearest`.
        """
        distances = []
        for number, excluded in enumerate(self._light.shadow_excluded):
            far = self._mi.Float(FAR)
            distances.append(self._occluder_distance(number, surface, w, far, blocked) if excluded else nearest)
        return distances

    def _unoccluded_shares(
        self, surface: SurfacePoints, w: Vector3f, distance: Float, controls: tuple[Float, ...], active: Bool
    ) -> Arriving:
        """Return the shares of a light at a distance that pass the occluders, for specular and for diffuse lobes."""
        occluders = [
            self._occluder_distance(number, surface, w, distance, active & self._light.excludes(controls, number))
            for number in range(len(self._light.shadow_excluded))
        ]
        return self._light.shadow_shares(controls, distance, occluders)

    def _occluder_distance(
        self, number: int, surface: SurfacePoints, w: Vector3f, distance: Float, active: Bool
    ) -> Float:
        """Return the distance of the first occluder nearer than `distance`, or `FAR` if there is none.

        `number` is the index of a set in `SceneLights.shadow_excluded`. Where only the fact of occlusion matters, the
        distance of an occluder is returned as 0.
        """
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
    """Return where the response to a direction, or one of its derivatives, is not negligible."""
    first, *derivatives = responses
    contributes = dr.max(first.value) > _NEGLIGIBLE
    for derivative in derivatives:
        contributes |= dr.max(dr.abs(derivative.value)) > _NEGLIGIBLE
    return contributes
