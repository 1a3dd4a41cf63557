"""The estimator: all samples of some pixels in one kernel.

At each hit, directions are drawn from the BSDF and from the light, weighted by the balance heuristic (Veach and Guibas
1995). Of the BSDF's directions that hit the asset again, one is continued, chosen in proportion to its throughput, as
in `lookdev/shaders/surface.osl`. Directions of all samples of a pixel are one set of low-discrepancy points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr

from lookdev.codegen.source import LOBE_GROUPS
from lookdev.light.shape import FAR
from lookdev.mitsuba import sobol
from lookdev.mitsuba.dual import Dual, less, product, size, summed, where
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.lights import Lighting, Lights
from lookdev.mitsuba.surface import Arriving, Looks, Response, Surface
from lookdev.mitsuba.view import Rectangle, View

LITTLE = 0.1  # of the throughput: with 1, dielectrics had five times the error at the same time
_NEGLIGIBLE = 1e-20  # of the BSDF: as in the shader


@dataclass(frozen=True)
class Counts:
    """Directions from the BSDF and from the light, at the first hit and at later ones."""

    brdf: int
    light: int
    brdf_onward: int = 1
    light_onward: int = 1
    resampled: bool = False  # of those from the light one is traced


class Estimator:
    """A scene: geometry, looks and lights.

    Besides the beauty it records parts of it: what the first hit reflects by each of some `groups` of lobes, and, if
    `direct`, of lights; and what comes from each of the groups of lights that are kept apart.
    """

    def __init__(
        self,
        mi: Any,
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

    def pixels(self, view: View, rectangle: Rectangle, lane: Any, seed: Any, first: Any, shift: Any) -> list[Any]:
        """Return the channels of radiance, coverage, and the channels of each part, of samples of pixels.

        `lane` are the numbers of the samples, from 0 on. Results are not yet evaluated.

        `first` is the number of the first of the pixels in a rectangle, whose samples follow each other, and `shift`
        the logarithm of the samples of each: inputs of the kernel.
        """
        triangle, uv, ray, hit, before, hidden, index, place = self._seen(view, rectangle, lane, seed, first, shift)
        shown = hit & ~hidden
        (radiance, *parts), (cover,) = self._reflected(triangle, uv, -ray.d, shown, view.turns, index, place)
        radiance += before[0]
        if self._light.shown:
            cover = dr.select(hit & hidden, 1.0, cover)
            # What the camera sees of lights came from there, by no lobe.
            lobes = len(self._groups)
            parts = [*parts[:lobes], *summed(parts[lobes:], [before[0]] * self._direct + before[1:])]
        return [*radiance, cover, *(channel for part in parts for channel in part)]

    def _seen(self, view: View, rectangle: Rectangle, lane: Any, seed: Any, first: Any, shift: Any) -> tuple[Any, ...]:
        """Return what samples of pixels see; arguments as of `pixels`.

        Triangle, place on it, ray, whether it is hit, what lights send along the ray (`Lights.before`), whether they
        hide the hit, the number of the sample in its pixel, and the scramble of that.
        """
        mi = self._mi
        number = first + (lane >> shift)
        row = number // rectangle.width
        pixel = (rectangle.top + row) * view.width + rectangle.left + number - row * rectangle.width
        index = lane & ((mi.UInt32(1) << shift) - 1)
        place = sobol.hashed(sobol.hashed(seed) ^ pixel)
        triangle, uv, ray, hit, distance = view.seen(mi, self._geometry, pixel, index, place)
        before, hidden = [mi.Color3f(0.0)], mi.Bool(False)
        if self._light.shown:
            before, hidden = self._light.before(ray.o, ray.d, view.turns, dr.select(hit, distance, 0.0))
        return triangle, uv, ray, hit, before, hidden, index, place

    @dr.syntax
    def _reflected(self, triangle: Any, uv: Any, viewer: Any, active: Any, turns: Any, index: Any, place: Any) -> Any:
        """Return what comes back from triangles along directions, as `_recorded`, and how much is covered.

        What loops only read is no state of theirs: else Dr.Jit traces their bodies again without it.
        """
        mi = self._mi
        found, throughput = self._dark(), self._constant(1.0)
        depth = mi.UInt32(0)
        active = mi.Bool(active)
        whole = [dr.select(active, mi.Float(1.0), 0.0), *(mi.Float(0.0) for _ in throughput[1:])]
        # Of looks that can be seen through: how much of the background is, and whether a path has only passed them.
        seen = [mi.Float(0.0) for _ in throughput if self._looks.see_through]
        through = [mi.Bool(active)] * self._looks.see_through
        # Of a path after its first reflection: what of its throughput is of each group, by channels.
        shares = [mi.Color3f(0.0) for _ in self._groups]
        while dr.hint(active, exclude=[index, place, turns]):
            surface = self._surface(triangle, uv, viewer, active)
            seed = sobol.hashed(place + depth)
            first = depth == 0
            drawn = dr.select(first, mi.UInt32(self._counts.brdf), mi.UInt32(self._counts.brdf_onward))
            lit = dr.select(first, mi.UInt32(self._counts.light), mi.UInt32(self._counts.light_onward))
            lighting = self._light.at(surface, turns, lit, self._looks.transmits)
            onward = depth < self._bounces
            straight = through[0] if self._looks.see_through else first
            record = Record(throughput, straight, shares)

            path, here, passed = self._follow(surface, lighting, record, active, onward, seed ^ index)
            found = summed(found, here)
            seen = summed(seen, [dr.mean(each) for each in product(throughput, passed)] if passed else [])
            share, chosen, chosen_triangle, chosen_uv, chosen_ray, chosen_through, chosen_shares = path

            # Directions of the BSDF.
            k = mi.UInt32(0)
            while dr.hint(active & (k < drawn), exclude=[index, drawn, seed, onward, straight, active]):
                number = index * drawn + k
                u1, u2 = sobol.points(mi.Float, number, seed)
                wi = surface.draw(u1, u2, active)
                responses, pdf = surface.respond(wi, active, self._light.split, self._groups)
                w = surface.to_world(wi)
                met = active & self._agree(surface, wi, w) & _matters(responses) & (pdf > 0.0)
                density = mi.Float(drawn) * pdf
                blocked, occluder, other, other_uv = self._trace(surface, w, met)
                occluders = self._occluders(surface, w, occluder, blocked)
                arriving = lighting.arriving(w, density, 1.0, occluders, met, straight=False)
                found = summed(found, self._recorded(record, responses, arriving, met))
                # Weighted reservoir: each hit is kept with probability proportional to its luminance.
                weight = where(met & blocked & onward, [each.value / density for each in responses])
                share += size(weight)
                kept = (size(weight) > 0.0) & (
                    sobol.unit(mi.Float, sobol.hashed(seed ^ (number + 1) * 0x3504F333)) * share < size(weight)
                )
                chosen = dr.select(kept, [each / size(weight) for each in weight], chosen)
                chosen_triangle = dr.select(kept, other, chosen_triangle)
                chosen_uv = dr.select(kept, other_uv, chosen_uv)
                chosen_ray = dr.select(kept, -w, chosen_ray)
                chosen_through = [each & ~kept for each in chosen_through]
                chosen_shares = dr.select(kept & straight, responses[0].shares(), chosen_shares)
                k += 1

            found = summed(found, self._from_light(surface, lighting, record, index, drawn, lit, seed, active))

            throughput = product(throughput, [each * share for each in chosen])
            # Russian roulette: paths of little throughput end, and others stand for them.
            survival = dr.minimum(size(throughput) / LITTLE, 1.0)
            lucky = sobol.unit(mi.Float, sobol.hashed(seed ^ index * 0x2545F491 ^ 0x1B873593)) < survival
            throughput = where(lucky, [each / survival for each in throughput])
            active &= onward & lucky & (share > 0.0)
            triangle, uv, viewer, through = chosen_triangle, chosen_uv, chosen_ray, chosen_through
            shares = chosen_shares
            depth += 1
        return found, less(whole, seen) if seen else whole

    def _surface(self, triangle: Any, uv: Any, viewer: Any, active: Any) -> Surface:
        return Surface(self._looks, triangle, uv, viewer, active)

    def _constant(self, value: float) -> Dual:
        return [self._mi.Color3f(value)]

    def _from_light(self, surface: Surface, *arguments: Any) -> list[Any]:
        """Return what directions drawn from the light find, as `_recorded`."""
        if not self._light.sampled:
            return self._dark()
        found = self._one_of_light if self._counts.resampled else self._all_of_light
        return found(surface, *arguments)  # type: ignore[no-any-return]

    @dr.syntax
    def _all_of_light(
        self,
        surface: Surface,
        lighting: Lighting,
        record: Record,
        index: Any,
        drawn: Any,
        lit: Any,
        seed: Any,
        active: Any,
    ) -> Any:
        total, j = self._dark(), self._mi.UInt32(0)
        while dr.hint(active & (j < lit), exclude=[index, drawn, lit, seed, active]):
            one = self._drawn(surface, lighting, index, j, drawn, seed, active)
            total = summed(total, self._shown(surface, record, one, self._mi.Float(1.0)))
            j += 1
        return total

    @dr.syntax
    def _one_of_light(
        self,
        surface: Surface,
        lighting: Lighting,
        record: Record,
        index: Any,
        drawn: Any,
        lit: Any,
        seed: Any,
        active: Any,
    ) -> Any:
        """Trace one of the directions, chosen in proportion to what it brings unless it is occluded.

        For glossy surfaces, whose lobes most directions of the light miss (Talbot et al. 2005, "Importance Resampling
        for Global Illumination").
        """
        mi = self._mi
        j, chosen = mi.UInt32(0), mi.UInt32(0)
        sum_, own = mi.Float(0.0), mi.Float(0.0)
        while dr.hint(active & (j < lit), exclude=[index, drawn, lit, seed, active]):
            brought = self._drawn(surface, lighting, index, j, drawn, seed, active)[-1]
            sum_ += brought
            lot = sobol.unit(mi.Float, sobol.hashed(seed ^ (index * lit + j + 1) * 0x85EBCA77))
            kept = (brought > 0.0) & (lot * sum_ < brought)
            chosen = dr.select(kept, j, chosen)
            own = dr.select(kept, brought, own)
            j += 1
        one = self._drawn(surface, lighting, index, chosen, drawn, seed, active & (sum_ > 0.0))
        return self._shown(surface, record, one, sum_ / own)

    def _drawn(
        self, surface: Surface, lighting: Lighting, index: Any, j: Any, drawn: Any, seed: Any, active: Any
    ) -> tuple[Any, ...]:
        """Return a direction of the light: responses, light over density, distance, controls, whether met, its gain."""
        w, sent, distance, density, controls = lighting.draw(index, j, seed, active)
        wi = surface.to_local(w)
        responses, pdf = surface.respond(wi, active, self._light.split, self._groups)
        met = active & self._agree(surface, wi, w) & _matters(responses)
        met &= dr.max(sent) > 0.0
        weight = sent / (self._mi.Float(drawn) * pdf + density)
        brought = dr.select(met, dr.mean(responses[0].value * weight), 0.0)
        return w, responses, weight, distance, controls, met, brought

    def _shown(self, surface: Surface, record: Record, drawn: tuple[Any, ...], times: Any) -> list[Any]:
        """Return what a direction of `_drawn` finds, as `_recorded`."""
        w, responses, weight, distance, controls, met, _ = drawn
        specular, diffuse = self._passed(surface, w, distance, controls, met)
        weight = weight * dr.select(met, times, 0.0)
        arriving = self._light.by_group(controls, (weight * specular, weight * diffuse))
        return self._recorded(record, responses, arriving, met)

    def _dark(self) -> list[Any]:
        """Return no light, and no part of it, as `_recorded`."""
        return [self._mi.Color3f(0.0) for _ in range(1 + len(self._groups) + self._direct + self._light.groups)]

    def _recorded(self, record: Record, responses: list[Response], arriving: list[Arriving], active: Any) -> list[Any]:
        """Return what is reflected of light, and each part: by lobes of groups, of lights directly, of their groups."""
        (throughput, *_), (response, *_) = record.throughput, responses
        whole, *of_lights = where(active, [throughput * response.to(each) for each in arriving])
        by_lobes = [throughput * each for each in response.parts_to(arriving[0])]
        of_lobes = [
            dr.select(active, dr.select(record.straight, here, share * whole), 0.0)
            for here, share in zip(by_lobes, record.shares, strict=True)
        ]
        direct = [dr.select(record.straight, whole, 0.0)] * self._direct
        return [whole, *of_lobes, *direct, *of_lights]

    def _follow(
        self, surface: Surface, lighting: Lighting, record: Record, active: Any, onward: Any, seed: Any
    ) -> tuple[Any, Any, Any]:
        """Follow single directions: no direction of the light is ever one of them.

        Where the surface is absent, a path goes straight on, from the camera to a black background. Returns a path
        onward: the sum of weights, its own weight over that, triangle, coordinates, direction back, whether it is still
        straight from the camera, and the shares of groups. Then the light that comes back, as `_recorded`, and how much
        of the background is seen, if looks can be seen through.
        """
        mi, see_through = self._mi, self._looks.see_through
        found, share = self._dark(), mi.Float(0.0)
        passed = self._constant(0.0) if see_through else []
        chosen = (
            self._constant(0.0), mi.UInt32(surface.triangle), mi.Point2f(surface.uv), mi.Vector3f(surface.viewer)
        )  # fmt: skip
        chosen_through = [mi.Bool(False)] * see_through
        chosen_shares = [mi.Color3f(each) for each in record.shares]
        for number, (w, responses, passes) in enumerate(self._singles(surface)):
            weight = [each.value for each in responses]
            met = active & (dr.max(weight[0]) > 0.0)
            blocked, occluder, triangle, uv = self._trace(surface, w, met)
            occluders = self._occluders(surface, w, occluder, blocked)
            unseen = record.straight & passes
            lit = met & ~unseen
            arriving = lighting.arriving(w, mi.Float(1.0), 0.0, occluders, lit, straight=passes)
            found = summed(found, self._recorded(record, responses, arriving, lit))
            if see_through:
                passed = summed(passed, where(met & ~blocked & unseen, weight))
            followed = dr.select(met & blocked & onward, size(weight), 0.0)
            share += followed
            lot = sobol.unit(mi.Float, sobol.hashed(seed + (number + 1) * 0x1B873593))
            kept = (followed > 0.0) & (lot * share < followed)
            chosen = dr.select(kept, ([each / followed for each in weight], triangle, uv, -w), chosen)
            chosen_through = [dr.select(kept, unseen, each) for each in chosen_through]
            chosen_shares = dr.select(kept & record.straight & ~unseen, responses[0].shares(), chosen_shares)
        return (share, *chosen, chosen_through, chosen_shares), found, passed

    def _singles(self, surface: Surface) -> list[tuple[Any, list[Response], bool]]:
        """Return directions of the world, the responses to light from there, and whether they pass the surface."""
        black = self._mi.Color3f(0.0)
        found: list[tuple[Any, list[Response], bool]] = []
        for number in range(self._looks.deltas):
            wi, value, group = surface.delta(number)
            w = surface.to_world(wi)
            value = where(self._agree(surface, wi, w), value)
            groups = [group == LOBE_GROUPS.index(name) for name in self._groups]
            parts = [(each, black) for each in (dr.select(here, value[0], 0.0) for here in groups)]
            found.append((w, [Response((each, black), parts, False) for each in value], False))
        if self._looks.see_through:
            parts = [(black, black)] * len(self._groups)
            absent = [Response((each, black), parts, False) for each in surface.absence()]
            found.append((-surface.viewer, absent, True))
        return found

    def _agree(self, surface: Surface, wi: Any, w: Any) -> Any:
        """Return where shading normal and facet agree on which side a direction is, and the looks let it be there."""
        height = dr.dot(w, surface.facet)
        if self._looks.transmits:
            return wi.z * height > 0.0
        return (wi.z > 0.0) & (height > 0.0)

    def _ray(self, surface: Surface, w: Any) -> Any:
        side = dr.select(dr.dot(w, surface.facet) < 0.0, -surface.lift, surface.lift)
        return self._mi.Ray3f(self._mi.Point3f(surface.point + side * surface.facet), w)

    def _trace(self, surface: Surface, w: Any, active: Any) -> tuple[Any, Any, Any, Any]:
        """Return which directions meet the asset, and how far, the triangles and their coordinates there."""
        if not self._shadows:
            return self._mi.Bool(False), self._mi.Float(FAR), surface.triangle, surface.uv
        found = self._geometry.scene.ray_intersect_preliminary(self._ray(surface, w), coherent=False, active=active)
        hit = found.is_valid()
        return hit, dr.select(hit, found.t, FAR), self._geometry.met(found), found.prim_uv

    def _occluders(self, surface: Surface, w: Any, occluder: Any, blocked: Any) -> list[Any]:
        """Return how far occluders are, by what lights spare, where the first hit of any is known."""
        found = []
        for which, spared in enumerate(self._light.spared):
            far = self._mi.Float(FAR)
            found.append(self._occluder(which, surface, w, far, blocked) if spared else occluder)
        return found

    def _passed(self, surface: Surface, w: Any, distance: Any, controls: tuple[Any, ...], active: Any) -> Arriving:
        """Return the shares of lights at a distance that pass what occludes them."""
        occluders = [
            self._occluder(which, surface, w, distance, active & self._light.spares(controls, which))
            for which in range(len(self._light.spared))
        ]
        return self._light.let(controls, distance, occluders)

    def _occluder(self, which: int, surface: Surface, w: Any, distance: Any, active: Any) -> Any:
        """Return how far the first occluder of the lights is that spare a set of parts; `FAR` if beyond a distance."""
        mi = self._mi
        if not self._shadows:
            return mi.Float(FAR)
        ray = self._ray(surface, w)
        ray.maxt = distance
        scene = self._geometry.casting(self._light.spared[which])
        if not self._light.shadowed and len(self._light.spared) == 1:
            return dr.select(scene.ray_test(ray, coherent=False, active=active), mi.Float(0.0), FAR)
        found = scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        return dr.select(found.is_valid(), found.t, FAR)


class Record:
    """A path where it has come to: throughput, whether straight from the camera, else what of it is of each group.

    It is no dataclass: those are state of Dr.Jit's loops, which a record does not change in.
    """

    def __init__(self, throughput: Any, straight: Any, shares: list[Any]) -> None:
        self.throughput, self.straight, self.shares = throughput, straight, shares


def _matters(responses: list[Response]) -> Any:
    """Return where light from a direction is reflected, or changes with an input."""
    first, *slopes = responses
    found = dr.max(first.value) > _NEGLIGIBLE
    for each in slopes:
        found |= dr.max(dr.abs(each.value)) > _NEGLIGIBLE
    return found
