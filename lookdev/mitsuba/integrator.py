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
        radiance, cover, parts = self._reflected(triangle, uv, -ray.d, shown, view.turns, index, place)
        radiance += before[0]
        if self._light.shown:
            cover = dr.select(hit & hidden, 1.0, cover)
            # What the camera sees of lights came from there, by no lobe.
            lobes = len(self._groups)
            parts = [*parts[:lobes], *_sums(parts[lobes:], [before[0]] * self._direct + before[1:])]
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
        """Return the radiance that comes back from triangles along directions, how much is covered, and the parts."""
        mi = self._mi
        radiance = mi.Color3f(0.0)
        throughput = mi.Color3f(1.0)
        depth = mi.UInt32(0)
        active = mi.Bool(active)
        cover = dr.select(active, mi.Float(1.0), 0.0)
        straight = mi.Bool(active)
        parts = self._dark()[1:]
        # Of a path after its first reflection: what of its throughput is of each group, by channels.
        shares = [mi.Color3f(0.0) for _ in self._groups]
        while active:
            surface = Surface(self._looks, triangle, uv, viewer, active)
            seed = sobol.hashed(place + depth)
            first = depth == 0
            drawn = dr.select(first, mi.UInt32(self._counts.brdf), mi.UInt32(self._counts.brdf_onward))
            lit = dr.select(first, mi.UInt32(self._counts.light), mi.UInt32(self._counts.light_onward))
            lighting = self._light.at(surface, turns, lit, self._looks.transmits)
            onward = depth < self._bounces
            record = _Record(throughput, straight, shares)

            path, found, passed = self._follow(surface, lighting, record, active, onward, seed ^ index)
            radiance += found[0]
            parts = _sums(parts, found[1:])
            cover -= dr.mean(throughput) * passed
            share, chosen, chosen_triangle, chosen_uv, chosen_ray, chosen_straight, chosen_shares = path

            # Directions of the BSDF.
            k = mi.UInt32(0)
            while active & (k < drawn):
                number = index * drawn + k
                u1, u2 = sobol.points(mi.Float, number, seed)
                wi = surface.draw(u1, u2, active)
                response, pdf = surface.respond(wi, active, self._light.split, self._groups)
                w = surface.to_world(wi)
                met = active & self._agree(surface, wi, w) & (dr.max(response.value) > _NEGLIGIBLE) & (pdf > 0.0)
                density = mi.Float(drawn) * pdf
                blocked, occluder, other, other_uv = self._trace(surface, w, met)
                occluders = self._occluders(surface, w, occluder, blocked)
                arriving = lighting.arriving(w, density, 1.0, occluders, met, straight=False)
                found = self._recorded(record, response, arriving, met)
                radiance += found[0]
                parts = _sums(parts, found[1:])
                # Weighted reservoir: each hit is kept with probability proportional to its luminance.
                weight = dr.select(met & blocked & onward, response.value / density, 0.0)
                size = dr.mean(weight)
                share += size
                kept = (size > 0.0) & (
                    sobol.unit(mi.Float, sobol.hashed(seed ^ (number + 1) * 0x3504F333)) * share < size
                )
                chosen = dr.select(kept, weight / size, chosen)
                chosen_triangle = dr.select(kept, other, chosen_triangle)
                chosen_uv = dr.select(kept, other_uv, chosen_uv)
                chosen_ray = dr.select(kept, -w, chosen_ray)
                chosen_straight &= ~kept
                chosen_shares = dr.select(kept & straight, response.shares(), chosen_shares)
                k += 1

            found = self._from_light(surface, lighting, record, index, drawn, lit, seed, active)
            radiance += found[0]
            parts = _sums(parts, found[1:])

            throughput *= chosen * share
            # Russian roulette: paths of little throughput end, and others stand for them.
            survival = dr.minimum(dr.mean(throughput) / LITTLE, 1.0)
            lucky = sobol.unit(mi.Float, sobol.hashed(seed ^ index * 0x2545F491 ^ 0x1B873593)) < survival
            throughput = dr.select(lucky, throughput / survival, 0.0)
            active &= onward & lucky & (share > 0.0)
            triangle, uv, viewer, straight = chosen_triangle, chosen_uv, chosen_ray, chosen_straight
            shares = chosen_shares
            depth += 1
        return radiance, cover, parts

    @dr.syntax
    def _from_light(
        self,
        surface: Surface,
        lighting: Lighting,
        record: _Record,
        index: Any,
        drawn: Any,
        lit: Any,
        seed: Any,
        active: Any,
    ) -> Any:
        """Return what directions drawn from the light find, as `_recorded`.

        Of a glossy surface, one of them is traced, chosen in proportion to what it brings unless it is occluded (Talbot
        et al. 2005, "Importance Resampling for Global Illumination"): most directions of the light miss its lobes.
        """
        mi = self._mi
        total = self._dark()
        if self._light.sampled:
            j, chosen = mi.UInt32(0), mi.UInt32(0)
            sum_, own = mi.Float(0.0), mi.Float(0.0)
            while active & (j < lit):
                one = self._drawn(surface, lighting, index, j, drawn, seed, active)
                if self._counts.resampled:
                    size = one[-1]
                    sum_ += size
                    lot = sobol.unit(mi.Float, sobol.hashed(seed ^ (index * lit + j + 1) * 0x85EBCA77))
                    kept = (size > 0.0) & (lot * sum_ < size)
                    chosen = dr.select(kept, j, chosen)
                    own = dr.select(kept, size, own)
                else:
                    total = _sums(total, self._shown(surface, record, one, mi.Float(1.0)))
                j += 1
            if self._counts.resampled:
                met = active & (sum_ > 0.0)
                one = self._drawn(surface, lighting, index, chosen, drawn, seed, met)
                total = self._shown(surface, record, one, sum_ / own)
        return total

    def _drawn(
        self, surface: Surface, lighting: Lighting, index: Any, j: Any, drawn: Any, seed: Any, active: Any
    ) -> tuple[Any, ...]:
        """Return a direction of the light: with response, light over density, distance, controls, whether met, size."""
        w, sent, distance, density, controls = lighting.draw(index, j, seed, active)
        wi = surface.to_local(w)
        response, pdf = surface.respond(wi, active, self._light.split, self._groups)
        met = active & self._agree(surface, wi, w) & (dr.max(response.value) > _NEGLIGIBLE)
        met &= dr.max(sent) > 0.0
        weight = sent / (self._mi.Float(drawn) * pdf + density)
        return w, response, weight, distance, controls, met, dr.select(met, dr.mean(response.value * weight), 0.0)

    def _shown(self, surface: Surface, record: _Record, drawn: tuple[Any, ...], times: Any) -> list[Any]:
        """Return what a direction of `_drawn` finds, as `_recorded`."""
        w, response, weight, distance, controls, met, _ = drawn
        specular, diffuse = self._passed(surface, w, distance, controls, met)
        weight = weight * dr.select(met, times, 0.0)
        arriving = self._light.by_group(controls, (weight * specular, weight * diffuse))
        return self._recorded(record, response, arriving, met)

    def _dark(self) -> list[Any]:
        """Return no light, and no part of it, as `_recorded`."""
        return [self._mi.Color3f(0.0) for _ in range(1 + len(self._groups) + self._direct + self._light.groups)]

    def _recorded(self, record: _Record, response: Response, arriving: list[Arriving], active: Any) -> list[Any]:
        """Return what is reflected of light, and each part: by lobes of groups, of lights directly, of their groups."""
        by_lights = [record.throughput * response.to(each) for each in arriving]
        by_lobes = [record.throughput * each for each in response.parts_to(arriving[0])]
        return self._divided(record, by_lights, by_lobes, active)

    def _divided(self, record: _Record, by_lights: list[Any], by_lobes: list[Any], active: Any) -> list[Any]:
        whole, *of_lights = (dr.select(active, each, 0.0) for each in by_lights)
        of_lobes = [
            dr.select(active, dr.select(record.straight, here, share * whole), 0.0)
            for here, share in zip(by_lobes, record.shares, strict=True)
        ]
        direct = [dr.select(record.straight, whole, 0.0)] * self._direct
        return [whole, *of_lobes, *direct, *of_lights]

    def _follow(
        self, surface: Surface, lighting: Lighting, record: _Record, active: Any, onward: Any, seed: Any
    ) -> tuple[Any, Any, Any]:
        """Follow single directions: no direction of the light is ever one of them.

        Where the surface is absent, a path goes straight on, from the camera to a black background. Returns a path
        onward: the sum of weights, its own weight over that, triangle, coordinates, direction back, whether it is still
        straight from the camera, and the shares of groups. Then the light that comes back, as `_recorded`, and how much
        of the background is seen.
        """
        mi = self._mi
        passed, share = mi.Float(0.0), mi.Float(0.0)
        found = self._dark()
        chosen = (mi.Color3f(0.0), mi.UInt32(surface.triangle), mi.Point2f(surface.uv), mi.Vector3f(surface.viewer))
        chosen_straight = mi.Bool(False)
        chosen_shares = [mi.Color3f(each) for each in record.shares]
        for number, (w, weight, group, passes) in enumerate(self._singles(surface)):
            met = active & (dr.max(weight) > 0.0)
            blocked, occluder, triangle, uv = self._trace(surface, w, met)
            occluders = self._occluders(surface, w, occluder, blocked)
            unseen = record.straight & passes
            lit = met & ~unseen
            arriving = lighting.arriving(w, mi.Float(1.0), 0.0, occluders, lit, straight=passes)
            by_lights = [record.throughput * weight * specular for specular, _ in arriving]
            ones = [dr.select(group == LOBE_GROUPS.index(name), mi.Color3f(1.0), 0.0) for name in self._groups]
            found = _sums(found, self._divided(record, by_lights, [one * by_lights[0] for one in ones], lit))
            passed += dr.select(met & ~blocked & unseen, weight.x, 0.0)
            size = dr.select(met & blocked & onward, dr.mean(weight), 0.0)
            share += size
            lot = sobol.unit(mi.Float, sobol.hashed(seed + (number + 1) * 0x1B873593))
            kept = (size > 0.0) & (lot * share < size)
            chosen = dr.select(kept, (weight / size, triangle, uv, -w), chosen)
            chosen_straight = dr.select(kept, unseen, chosen_straight)
            chosen_shares = dr.select(kept & record.straight & ~unseen, ones, chosen_shares)
        return (share, *chosen, chosen_straight, chosen_shares), found, passed

    def _singles(self, surface: Surface) -> list[tuple[Any, Any, Any, bool]]:
        """Return directions of the world, what light from there is multiplied by, groups, and whether they pass."""
        found: list[tuple[Any, Any, Any, bool]] = []
        for number in range(self._looks.deltas):
            wi, value, group = surface.delta(number)
            w = surface.to_world(wi)
            found.append((w, dr.select(self._agree(surface, wi, w), value, 0.0), group, False))
        if self._looks.see_through:
            absent = self._mi.Color3f(1.0 - surface.presence())
            found.append((-surface.viewer, absent, self._mi.Float(-1.0), True))
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


class _Record:
    """A path where it has come to: throughput, whether straight from the camera, else what of it is of each group.

    It is no dataclass: those are state of Dr.Jit's loops, which a record does not change in.
    """

    def __init__(self, throughput: Any, straight: Any, shares: list[Any]) -> None:
        self.throughput, self.straight, self.shares = throughput, straight, shares


def _sums(one: list[Any], other: list[Any]) -> list[Any]:
    return [a + b for a, b in zip(one, other, strict=True)]
