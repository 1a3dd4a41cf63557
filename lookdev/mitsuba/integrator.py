"""The estimator: all samples of some pixels in one kernel.

At each hit, directions are drawn from the BSDF and from the light, weighted by the balance heuristic (Veach and Guibas
1995). Of the BSDF's directions that hit the asset again, one is continued, chosen in proportion to its throughput, as
in `lookdev/shaders/surface.osl`. Directions of all samples of a pixel are one set of low-discrepancy points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from lookdev.light.shape import FAR
from lookdev.mitsuba import sobol
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.lights import Lighting, Lights
from lookdev.mitsuba.surface import Looks, Surface
from lookdev.render.adaptive import Region
from lookdev.scene import Camera, Pose

LITTLE = 0.1  # of the throughput: with 1, dielectrics had five times the error at the same time
_NEGLIGIBLE = 1e-20  # of the BSDF: as in the shader


@dataclass(frozen=True)
class Counts:
    """Directions from the BSDF and from the light, at the first hit and at later ones."""

    brdf: int
    light: int
    brdf_onward: int = 1
    light_onward: int = 1


@dataclass(frozen=True, eq=False)
class View:
    """A camera about the centre of the geometry, and the turns of the lights in radians, as inputs of a kernel.

    The first turn is that of lights that turn with the rig, the second that of those that stay.
    """

    origin: Any
    right: Any
    up: Any
    back: Any
    turns: Any
    width: int
    height: int
    aperture: float
    focus: float
    near: float

    @classmethod
    def of(cls, mi: Any, camera: Camera, pose: Pose, resolution: tuple[int, int], center: Any) -> View:
        """Of a pose: the camera orbits, the light turns, the asset stays (`lookdev.scene.Pose`).

        `right` and `up` span half the frame at depth 1, and `back` is shifted with it.
        """
        orbited = camera.orbited(-pose.element)
        right, up, back = orbited.frame
        width, height = resolution
        across, along = camera.reach * right, camera.reach * up
        shifted = back - 2.0 * camera.shift[0] * across - 2.0 * camera.shift[1] * along
        vectors = (orbited.position - center, across, along * height / width, shifted)
        opaque = [dr.opaque(mi.Float, float(x)) for vector in vectors for x in vector]
        angles = (math.radians(each) for each in (pose.lighting - pose.element, -pose.element))
        turns = mi.Vector2f(*(dr.opaque(mi.Float, each) for each in angles))
        lens = camera.lens
        aperture, focus = (lens.aperture, lens.focus) if lens else (0.0, 1.0)
        origin, right, up, back = (mi.Vector3f(*opaque[3 * i : 3 * i + 3]) for i in range(4))
        return cls(origin, right, up, back, turns, width, height, aperture, focus, camera.clip[0])

    def rays(self, mi: Any, x: Any, y: Any, u: Any, v: Any) -> Any:
        """Return the rays through places of the film, in pixels from the upper left corner; u and v are on the lens."""
        sx, sy = 2.0 * x / self.width - 1.0, 1.0 - 2.0 * y / self.height
        direction = sx * self.right + sy * self.up - self.back
        origin = mi.Point3f(self.origin)
        if self.aperture > 0.0:
            radius = 0.5 * self.aperture * dr.sqrt(u)
            s, c = dr.sincos(2.0 * math.pi * v)
            within = radius * c * dr.normalize(self.right) + radius * s * dr.normalize(self.up)
            origin, direction = origin + within, direction - within / self.focus
        return mi.Ray3f(origin + self.near * direction, dr.normalize(direction))


@dataclass(frozen=True, eq=False)
class Rectangle:
    """A part of the frame: its upper left pixel, and its width, as inputs of a kernel."""

    left: Any
    top: Any
    width: Any

    @classmethod
    def of(cls, mi: Any, region: Region) -> Rectangle:
        left, right = region.columns.start, region.columns.stop
        return cls(*(dr.opaque(mi.UInt32, each) for each in (left, region.rows.start, right - left)))


class Estimator:
    """A scene: geometry, looks and lights."""

    def __init__(
        self, mi: Any, geometry: Geometry, looks: Looks, light: Lights, counts: Counts, bounces: int, shadows: bool
    ) -> None:
        self._mi = mi
        self._geometry = geometry
        self._looks = looks
        self._light = light
        self._counts = counts
        self._bounces = bounces
        self._shadows = shadows

    def pixels(self, view: View, rectangle: Rectangle, count: int, seed: Any, first: Any, shift: Any) -> Any:
        """Return the three channels of radiance, and the coverage, of `count` samples of pixels, not yet evaluated.

        `first` is the number of the first of the pixels in a rectangle, whose samples follow each other, and `shift`
        the logarithm of the samples of each: inputs of the kernel.
        """
        mi = self._mi
        lane = dr.arange(mi.UInt32, count)
        number = first + (lane >> shift)
        row = number // rectangle.width
        pixel = (rectangle.top + row) * view.width + rectangle.left + number - row * rectangle.width
        index = lane & ((mi.UInt32(1) << shift) - 1)
        place = sobol.hashed(sobol.hashed(seed) ^ pixel)
        triangle, uv, ray, hit = self._seen(view, pixel, index, place)
        radiance, cover = self._reflected(triangle, uv, -ray.d, hit, view.turns, index, place)
        return radiance.x, radiance.y, radiance.z, cover

    def guides(self, view: View, samples: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the mean albedos and normals (P, 3) of all pixels, by a power of two of samples of each."""
        mi = self._mi
        lane = dr.arange(mi.UInt32, view.width * view.height * samples)
        pixel = lane // samples
        place = sobol.hashed(pixel)
        triangle, uv, ray, hit = self._seen(view, pixel, lane & (samples - 1), place)
        surface = Surface(self._looks, triangle, uv, -ray.d, hit)
        guides = [dr.select(hit, each, 0.0) for each in surface.guide()]
        dr.eval(guides)
        albedo, normal = (
            np.stack([np.array(dr.block_sum(component, samples)) for component in each], axis=-1) / samples
            for each in guides
        )
        return albedo.astype(np.float32), normal.astype(np.float32)

    def _seen(self, view: View, pixel: Any, index: Any, place: Any) -> tuple[Any, Any, Any, Any]:
        """Return triangles, barycentric coordinates and rays of samples of pixels, and which hit any."""
        mi = self._mi
        u, v = sobol.points(mi.Float, index, sobol.hashed(place ^ 0x9E3779B9))
        on_lens = sobol.points(mi.Float, index, sobol.hashed(place ^ 0x7F4A7C15)) if view.aperture > 0.0 else (0.0, 0.0)
        row = pixel // view.width
        ray = view.rays(mi, mi.Float(pixel - row * view.width) + u, mi.Float(row) + v, *on_lens)
        found = self._geometry.scene.ray_intersect_preliminary(ray, coherent=True)
        return found.prim_index, found.prim_uv, ray, found.is_valid()

    @dr.syntax
    def _reflected(self, triangle: Any, uv: Any, viewer: Any, active: Any, turns: Any, index: Any, place: Any) -> Any:
        """Return the radiance that comes back from triangles along directions, and how much of them is covered."""
        mi = self._mi
        radiance = mi.Color3f(0.0)
        throughput = mi.Color3f(1.0)
        depth = mi.UInt32(0)
        active = mi.Bool(active)
        cover = dr.select(active, mi.Float(1.0), 0.0)
        straight = mi.Bool(active)
        while active:
            surface = Surface(self._looks, triangle, uv, viewer, active)
            seed = sobol.hashed(place + depth)
            first = depth == 0
            drawn = dr.select(first, mi.UInt32(self._counts.brdf), mi.UInt32(self._counts.brdf_onward))
            lit = dr.select(first, mi.UInt32(self._counts.light), mi.UInt32(self._counts.light_onward))
            lighting = self._light.at(surface, turns, lit, self._looks.transmits)
            onward = depth < self._bounces

            direct, passed, share, chosen, chosen_triangle, chosen_uv, chosen_ray, chosen_straight = self._follow(
                surface, lighting, active, straight, onward, seed ^ index
            )
            radiance += throughput * direct
            cover -= dr.mean(throughput) * passed

            # Directions of the BSDF.
            k = mi.UInt32(0)
            while active & (k < drawn):
                number = index * drawn + k
                u1, u2 = sobol.points(mi.Float, number, seed)
                wi = surface.draw(u1, u2, active)
                value, pdf = surface.respond(wi, active)
                w = surface.to_world(wi)
                met = active & self._agree(surface, wi, w) & (dr.max(value) > _NEGLIGIBLE) & (pdf > 0.0)
                density = mi.Float(drawn) * pdf
                blocked, occluder, other, other_uv = self._trace(surface, w, met)
                arriving = lighting.arriving(w, density, 1.0, occluder, met)
                radiance += dr.select(met, throughput * value * arriving, 0.0)
                # Weighted reservoir: each hit is kept with probability proportional to its luminance.
                weight = dr.select(met & blocked & onward, value / density, 0.0)
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
                k += 1

            radiance += throughput * self._from_light(surface, lighting, index, drawn, lit, seed, active)

            throughput *= chosen * share
            # Russian roulette: paths of little throughput end, and others stand for them.
            survival = dr.minimum(dr.mean(throughput) / LITTLE, 1.0)
            lucky = sobol.unit(mi.Float, sobol.hashed(seed ^ index * 0x2545F491 ^ 0x1B873593)) < survival
            throughput = dr.select(lucky, throughput / survival, 0.0)
            active &= onward & lucky & (share > 0.0)
            triangle, uv, viewer, straight = chosen_triangle, chosen_uv, chosen_ray, chosen_straight
            depth += 1
        return radiance, cover

    @dr.syntax
    def _from_light(
        self, surface: Surface, lighting: Lighting, index: Any, drawn: Any, lit: Any, seed: Any, active: Any
    ) -> Any:
        """Return the part of reflected light that directions drawn from the light find."""
        mi = self._mi
        radiance = mi.Color3f(0.0)
        if self._light.sampled:
            j = mi.UInt32(0)
            while active & (j < lit):
                w, arriving, distance, density = lighting.draw(index, j, seed, active)
                wi = surface.to_local(w)
                value, pdf = surface.respond(wi, active)
                met = active & self._agree(surface, wi, w) & (dr.max(value) > _NEGLIGIBLE) & (dr.max(arriving) > 0.0)
                met &= ~self._occluded(surface, w, distance, met)
                radiance += dr.select(met, value * arriving / (mi.Float(drawn) * pdf + density), 0.0)
                j += 1
        return radiance

    def _follow(self, surface: Surface, lighting: Lighting, active: Any, straight: Any, onward: Any, seed: Any) -> Any:
        """Follow single directions: no direction of the light is ever one of them.

        Where the surface is absent, a path goes straight on, from the camera to a black background. Returns the light
        that comes back and how much of the background is seen; and of a path onward the sum of weights, its own weight
        over that, triangle, coordinates, direction back, and whether it is still straight from the camera.
        """
        mi = self._mi
        direct, passed, share = mi.Color3f(0.0), mi.Float(0.0), mi.Float(0.0)
        chosen = (mi.Color3f(0.0), mi.UInt32(surface.triangle), mi.Point2f(surface.uv), mi.Vector3f(surface.viewer))
        chosen_straight = mi.Bool(False)
        for number, (w, weight, passes) in enumerate(self._singles(surface)):
            met = active & (dr.max(weight) > 0.0)
            blocked, occluder, triangle, uv = self._trace(surface, w, met)
            unseen = straight & passes
            lit = met & ~unseen
            direct += dr.select(lit, weight * lighting.arriving(w, self._mi.Float(1.0), 0.0, occluder, lit), 0.0)
            passed += dr.select(met & ~blocked & unseen, weight.x, 0.0)
            size = dr.select(met & blocked & onward, dr.mean(weight), 0.0)
            share += size
            lot = sobol.unit(mi.Float, sobol.hashed(seed + (number + 1) * 0x1B873593))
            kept = (size > 0.0) & (lot * share < size)
            chosen = dr.select(kept, (weight / size, triangle, uv, -w), chosen)
            chosen_straight = dr.select(kept, unseen, chosen_straight)
        return direct, passed, share, *chosen, chosen_straight

    def _singles(self, surface: Surface) -> list[tuple[Any, Any, bool]]:
        """Return directions of the world, what light from there is multiplied by, and whether they pass unchanged."""
        found = []
        for number in range(self._looks.deltas):
            wi, value = surface.delta(number)
            w = surface.to_world(wi)
            found.append((w, dr.select(self._agree(surface, wi, w), value, 0.0), False))
        if self._looks.see_through:
            found.append((-surface.viewer, self._mi.Color3f(1.0 - surface.presence()), True))
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
        return hit, dr.select(hit, found.t, FAR), found.prim_index, found.prim_uv

    def _occluded(self, surface: Surface, w: Any, distance: Any, active: Any) -> Any:
        if not self._shadows:
            return self._mi.Bool(False)
        ray = self._ray(surface, w)
        ray.maxt = distance
        return self._geometry.scene.ray_test(ray, coherent=False, active=active)
