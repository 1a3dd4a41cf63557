"""Pictures with their derivatives by live inputs of looks, estimated along the same paths.

Directions are drawn, and paths chosen and ended, by densities that are not differentiated, so an estimate of

    f(wi, x) L(wi) / pdf(wi)    has the derivative    df/dx L / pdf + f dL/dx / pdf,

whose mean is that of the integral: no edge of the picture moves with an input. Derivatives of f, and of its diffuse
part where that is lit by other light, are outputs of the look's program (`lookdev.codegen.trace.slopes`). Loops are
those of `lookdev.mitsuba.integrator`; what they carry from hit to hit are lists: a colour and its derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from lookdev.asset import read_asset
from lookdev.codegen import ProgramSource
from lookdev.codegen.program.look import slope_name
from lookdev.mitsuba import sobol
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.integrator import LITTLE, Counts, Estimator
from lookdev.mitsuba.lights import Lighting
from lookdev.mitsuba.programs import Place
from lookdev.mitsuba.render import counts_of
from lookdev.mitsuba.rig import lights_of
from lookdev.mitsuba.surface import Arriving, Looks, Response, Surface
from lookdev.mitsuba.view import Rectangle, View
from lookdev.render.adaptive import Region
from lookdev.render.slopes import SlopeTask
from lookdev.render.task import SceneTask

_LAUNCH = 1 << 21  # samples, of which each has four numbers and their derivatives

Dual = list[Any]
"""A colour or a number, and its derivatives."""


class SlopeScene:
    """A scene task whose looks have live inputs."""

    def __init__(self, mi: Any, task: SceneTask) -> None:
        self.task = task
        self._mi = mi
        self._sources = [source for source in task.shaders if isinstance(source, ProgramSource)]
        self._geometry = Geometry(mi, read_asset(task.asset.path))
        self._geometry.dress(task.worn, task.groups)
        self._light = lights_of(mi, task.lights, task.lit, self._geometry.center, task.camera.pivot)
        for spared in self._light.spared:
            self._geometry.casting(spared)  # made before it is used in a kernel
        glossy = all(source.glossy for source in self._sources)
        self._counts = counts_of(task.sampling, self._light.sampled, glossy, resampled=False)

    def render(self, task: SlopeTask, progress: Callable[[int, int], None]) -> NDArray[np.float32]:
        """Return halves (2, 1 + P, H, W, 4): radiance and coverage, and their derivatives by `task.symbols`."""
        mi, geometry = self._mi, self._geometry
        inputs = {name: (mi.Vector3f if len(each) == 3 else mi.Float)(*each) for name, each in task.values.items()}
        dr.make_opaque(inputs)
        looks = Looks(mi, self._sources, geometry, inputs)
        estimator = SlopeEstimator(mi, geometry, looks, self._light, self._counts, task.scene, task.symbols)
        width, height = task.scene.resolution
        view = View.of(mi, task.scene.camera, task.pose, (width, height), geometry.center)
        place = Rectangle.of(mi, Region(slice(0, height), slice(0, width), task.samples))
        rows: list[list[NDArray[np.float32]]] = []
        step = max(1, _LAUNCH // (task.samples * (1 + len(task.symbols))))
        starts = range(0, width * height, step)
        for seed in task.seeds:
            for first in starts:
                count = min(step, width * height - first)
                numbers = [dr.opaque(mi.UInt32, each) for each in (seed, first, task.samples.bit_length() - 1)]
                found = estimator.duals(view, place, count * task.samples, *numbers)
                dr.eval(found)  # at once: a sum of one of them would compute it alone
                sums = [dr.block_sum(each, task.samples) for each in found]
                rows.append([np.array(each) / np.float32(task.samples) for each in sums])
                progress(len(rows), 2 * len(starts))
        halves = np.split(np.concatenate([np.stack(each, -1) for each in rows]), 2)
        shape = height, width, 1 + len(task.symbols), 4
        return np.stack([np.moveaxis(half.reshape(shape), 2, 0) for half in halves])


class LiveSurface(Surface):
    """A surface whose looks have derivatives by some symbols."""

    def __init__(self, looks: Looks, symbols: Sequence[str], split: bool, *where: Any) -> None:
        super().__init__(looks, *where)
        self._symbols, self._split = symbols, split
        if (place := self._alone) is not None:
            outputs = [*(["diffuse"] * split), *(slope_name("diffuse", each) for each in symbols if split)]
            outputs += [slope_name("value", each) for each in symbols]
            place.prepare(*filter(place.has, outputs))

    def respond_dual(self, wi: Any, active: Any) -> tuple[list[Response], Any]:
        """Return the response to light from local directions and its derivatives, and the pdf of `draw` there."""
        mi = self.looks.mi

        def respond(place: Place, wi: Any) -> tuple[Dual, Dual, Any]:
            given = {"wi_x": wi.x, "wi_y": wi.y, "wi_z": wi.z}
            value = self._dual(place, "value", mi.Color3f, **given)
            diffuse = (
                self._dual(place, "diffuse", mi.Color3f, **given) if self._split else [mi.Color3f(0.0)] * len(value)
            )
            return value, diffuse, mi.Float(place.values("pdf", **given)[0])

        value, diffuse, pdf = self._called(respond, wi, active=active)
        return [Response(each, [], self._split) for each in zip(value, diffuse, strict=True)], pdf

    def presence_dual(self) -> Dual:
        mi = self.looks.mi

        def presence(place: Place) -> Dual:
            if not place.has("presence"):
                return [mi.Color3f(1.0), *(mi.Color3f(0.0) for _ in self._symbols)]
            return self._dual(place, "presence", mi.Color3f)

        return self._called(presence, active=self.active)  # type: ignore[no-any-return]

    def delta_dual(self, number: int) -> Dual:
        """Return what light from the single direction of a number is multiplied by."""
        mi = self.looks.mi

        def delta(place: Place) -> Dual:
            if not place.has(f"delta{number}"):
                return [mi.Color3f(0.0) for _ in range(1 + len(self._symbols))]
            return self._dual(place, f"delta{number}", lambda *elements: mi.Color3f(*elements[3:6]))

        return self._called(delta, active=self.active)  # type: ignore[no-any-return]

    def _dual(self, place: Place, output: str, kind: Callable[..., Any], **given: Any) -> Dual:
        names = [slope_name(output, symbol) for symbol in self._symbols]
        zero = self.looks.mi.Color3f(0.0)
        slopes = [kind(*place.values(name, **given)) if place.has(name) else zero for name in names]
        return [kind(*place.values(output, **given)), *slopes]


class SlopeEstimator(Estimator):
    """A scene, whose pictures it derives by symbols of its looks' programs."""

    def __init__(
        self,
        mi: Any,
        geometry: Geometry,
        looks: Looks,
        light: Any,
        counts: Counts,
        task: SceneTask,
        symbols: Sequence[str],
    ) -> None:
        shadows = any(source.shadows for source in looks.sources)
        super().__init__(mi, geometry, looks, light, counts, task.sampling.bounces, shadows)
        self._symbols = symbols

    def duals(self, view: View, rectangle: Rectangle, count: int, seed: Any, first: Any, shift: Any) -> list[Any]:
        """Return radiance and coverage, then the derivatives of these four by each symbol; arguments as `pixels`."""
        mi = self._mi
        lane = dr.arange(mi.UInt32, count)
        triangle, uv, ray, hit, before, hidden, index, place = self._seen(view, rectangle, lane, seed, first, shift)
        shown = hit & ~hidden
        radiance, cover = self._reflected_dual(triangle, uv, -ray.d, shown, view.turns, index, place)
        # Lamps that the camera sees have no derivative.
        radiance[0] += before[0]
        cover[0] = dr.select(hit & hidden, 1.0, cover[0])
        whole = dr.zeros(mi.Float, count)  # what is 0 everywhere is one number
        return [part + whole for color, alpha in zip(radiance, cover, strict=True) for part in (*color, alpha)]

    @dr.syntax
    def _reflected_dual(
        self, triangle: Any, uv: Any, viewer: Any, active: Any, turns: Any, index: Any, place: Any
    ) -> Any:
        mi = self._mi
        radiance, throughput = self._constant(0.0), self._constant(1.0)
        depth = mi.UInt32(0)
        active = mi.Bool(active)
        cover = [dr.select(active, mi.Float(1.0), 0.0), *(mi.Float(0.0) for _ in self._symbols)]
        straight = mi.Bool(active)
        while active:
            surface = LiveSurface(self._looks, self._symbols, self._light.split, triangle, uv, viewer, active)
            seed = sobol.hashed(place + depth)
            first = depth == 0
            drawn = dr.select(first, mi.UInt32(self._counts.brdf), mi.UInt32(self._counts.brdf_onward))
            lit = dr.select(first, mi.UInt32(self._counts.light), mi.UInt32(self._counts.light_onward))
            lighting = self._light.at(surface, turns, lit, self._looks.transmits)
            onward = depth < self._bounces

            direct, passed, share, chosen, chosen_triangle, chosen_uv, chosen_ray, chosen_straight = self._follow_dual(
                surface, lighting, active, straight, onward, seed ^ index
            )
            radiance = _sum(radiance, _product(throughput, direct))
            cover = _less(cover, _product(throughput, passed))

            k = mi.UInt32(0)
            while active & (k < drawn):
                number = index * drawn + k
                u1, u2 = sobol.points(mi.Float, number, seed)
                wi = surface.draw(u1, u2, active)
                response, pdf = surface.respond_dual(wi, active)
                w = surface.to_world(wi)
                met = active & self._agree(surface, wi, w) & (pdf > 0.0)
                density = mi.Float(drawn) * pdf
                blocked, occluder, other, other_uv = self._trace(surface, w, met)
                occluders = self._occluders(surface, w, occluder, blocked)
                (arriving,) = lighting.arriving(w, density, 1.0, occluders, met, straight=False)
                radiance = _sum(radiance, _where(met, _product(throughput, _reflected(response, arriving))))
                weight = _where(met & blocked & onward, [each.value / density for each in response])
                size = _size(weight)
                share += size
                kept = (size > 0.0) & (
                    sobol.unit(mi.Float, sobol.hashed(seed ^ (number + 1) * 0x3504F333)) * share < size
                )
                chosen = dr.select(kept, _scaled(weight, 1.0 / size), chosen)
                chosen_triangle = dr.select(kept, other, chosen_triangle)
                chosen_uv = dr.select(kept, other_uv, chosen_uv)
                chosen_ray = dr.select(kept, -w, chosen_ray)
                chosen_straight &= ~kept
                k += 1

            lights = self._from_light_dual(surface, lighting, index, drawn, lit, seed, active)
            radiance = _sum(radiance, _product(throughput, lights))

            throughput = _scaled(_product(throughput, chosen), share)
            survival = dr.minimum(_size(throughput) / LITTLE, 1.0)
            lucky = sobol.unit(mi.Float, sobol.hashed(seed ^ index * 0x2545F491 ^ 0x1B873593)) < survival
            throughput = _where(lucky, _scaled(throughput, 1.0 / survival))
            active &= onward & lucky & (share > 0.0)
            triangle, uv, viewer, straight = chosen_triangle, chosen_uv, chosen_ray, chosen_straight
            depth += 1
        return radiance, cover

    @dr.syntax
    def _from_light_dual(
        self, surface: LiveSurface, lighting: Lighting, index: Any, drawn: Any, lit: Any, seed: Any, active: Any
    ) -> Any:
        mi = self._mi
        radiance = self._constant(0.0)
        if self._light.sampled:
            j = mi.UInt32(0)
            while active & (j < lit):
                w, arriving, distance, density, controls = lighting.draw(index, j, seed, active)
                wi = surface.to_local(w)
                response, pdf = surface.respond_dual(wi, active)
                met = active & self._agree(surface, wi, w) & (dr.max(arriving) > 0.0)
                specular, diffuse = self._passed(surface, w, distance, controls, met)
                weight = arriving / (mi.Float(drawn) * pdf + density)
                radiance = _sum(radiance, _where(met, _reflected(response, (weight * specular, weight * diffuse))))
                j += 1
        return radiance

    def _follow_dual(
        self, surface: LiveSurface, lighting: Lighting, active: Any, straight: Any, onward: Any, seed: Any
    ) -> Any:
        mi = self._mi
        direct, passed, share = self._constant(0.0), self._constant(0.0), mi.Float(0.0)
        chosen = (
            self._constant(0.0), mi.UInt32(surface.triangle), mi.Point2f(surface.uv), mi.Vector3f(surface.viewer)
        )  # fmt: skip
        chosen_straight = mi.Bool(False)
        for number, (w, weight, passes) in enumerate(self._single_duals(surface)):
            met = active & (_size(weight) > 0.0)
            blocked, occluder, triangle, uv = self._trace(surface, w, met)
            unseen = straight & passes
            lit = met & ~unseen
            occluders = self._occluders(surface, w, occluder, blocked)
            ((specular, _),) = lighting.arriving(w, mi.Float(1.0), 0.0, occluders, lit, straight=passes)
            direct = _sum(direct, _where(lit, _scaled(weight, specular)))
            passed = _sum(passed, _where(met & ~blocked & unseen, weight))
            size = dr.select(met & blocked & onward, _size(weight), 0.0)
            share += size
            lot = sobol.unit(mi.Float, sobol.hashed(seed + (number + 1) * 0x1B873593))
            kept = (size > 0.0) & (lot * share < size)
            chosen = dr.select(kept, (_scaled(weight, 1.0 / size), triangle, uv, -w), chosen)
            chosen_straight = dr.select(kept, unseen, chosen_straight)
        return direct, passed, share, *chosen, chosen_straight

    def _single_duals(self, surface: LiveSurface) -> list[tuple[Any, Dual, bool]]:
        found: list[tuple[Any, Dual, bool]] = []
        for number in range(self._looks.deltas):
            wi, _, _ = surface.delta(number)
            w = surface.to_world(wi)
            found.append((w, _where(self._agree(surface, wi, w), surface.delta_dual(number)), False))
        if self._looks.see_through:
            there, *slopes = surface.presence_dual()
            found.append((-surface.viewer, [1.0 - there, *(-each for each in slopes)], True))
        return found

    def _constant(self, value: float) -> Dual:
        return [self._mi.Color3f(value), *(self._mi.Color3f(0.0) for _ in self._symbols)]


def _reflected(response: Sequence[Response], arriving: Arriving) -> Dual:
    """Return what is reflected of light, which does not depend on the inputs."""
    return [each.to(arriving) for each in response]


def _product(a: Dual, b: Dual) -> Dual:
    return [a[0] * b[0], *(da * b[0] + a[0] * db for da, db in zip(a[1:], b[1:], strict=True))]


def _sum(a: Dual, b: Dual) -> Dual:
    return [x + y for x, y in zip(a, b, strict=True)]


def _less(a: Dual, b: Dual) -> Dual:
    return [x - dr.mean(y) for x, y in zip(a, b, strict=True)]


def _scaled(a: Dual, factor: Any) -> Dual:
    return [each * factor for each in a]


def _where(mask: Any, a: Dual) -> Dual:
    return [dr.select(mask, each, 0.0) for each in a]


def _size(a: Dual) -> Any:
    """Return by which paths are chosen: the colour's mean, no derivative."""
    return dr.mean(a[0])
