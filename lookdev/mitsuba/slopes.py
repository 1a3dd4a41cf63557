"""Pictures with their derivatives by live inputs of looks, estimated along the same paths.

Directions are drawn, and paths chosen and ended, by densities that are not differentiated, so an estimate of

    f(wi, x) L(wi) / pdf(wi)    has the derivative    df/dx L / pdf + f dL/dx / pdf,

whose mean is that of the integral: no edge of the picture moves with an input. Derivatives of f, and of its diffuse
part where that is lit by other light, are outputs of the look's program (`lookdev.codegen.trace.slopes`). Loops are
those of `lookdev.mitsuba.integrator`, whose lists (`lookdev.mitsuba.dual`) have derivatives here.
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
from lookdev.mitsuba.dual import Dual, product, where
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.integrator import Counts, Estimator, Record
from lookdev.mitsuba.programs import Place
from lookdev.mitsuba.render import counts_of
from lookdev.mitsuba.rig import lights_of
from lookdev.mitsuba.surface import Arriving, Looks, Response, Surface
from lookdev.mitsuba.view import Rectangle, View
from lookdev.rendering.adaptive import Region
from lookdev.rendering.slopes import SlopeTask
from lookdev.rendering.task import SceneTask

_LAUNCH = 1 << 21  # samples, of which each has four numbers and their derivatives


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

    def respond(self, wi: Any, active: Any, split: bool, groups: Sequence[str]) -> tuple[list[Response], Any]:
        mi = self.looks.mi

        def respond(place: Place, wi: Any) -> tuple[Dual, Dual, Any]:
            given = {"wi_x": wi.x, "wi_y": wi.y, "wi_z": wi.z}
            value = self._dual(place, "value", mi.Color3f, **given)
            diffuse = self._dual(place, "diffuse", mi.Color3f, **given) if split else [mi.Color3f(0.0)] * len(value)
            return value, diffuse, mi.Float(place.values("pdf", **given)[0])

        value, diffuse, pdf = self._called(respond, wi, active=active)
        return [Response(each, [], split) for each in zip(value, diffuse, strict=True)], pdf

    def absence(self) -> Dual:
        mi = self.looks.mi

        def presence(place: Place) -> Dual:
            if not place.has("presence"):
                return [mi.Color3f(1.0), *(mi.Color3f(0.0) for _ in self._symbols)]
            return self._dual(place, "presence", mi.Color3f)

        there, *slopes = self._called(presence, active=self.active)
        return [1.0 - there, *(-each for each in slopes)]

    def delta(self, number: int) -> tuple[Any, Dual, Any]:
        mi = self.looks.mi

        def delta(place: Place) -> Dual:
            if not place.has(f"delta{number}"):
                return [mi.Color3f(0.0) for _ in range(1 + len(self._symbols))]
            return self._dual(place, f"delta{number}", lambda *elements: mi.Color3f(*elements[3:6]))

        wi, _, group = super().delta(number)
        return wi, self._called(delta, active=self.active), group

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
        radiance, cover = self._reflected(triangle, uv, -ray.d, shown, view.turns, index, place)
        # Lamps that the camera sees have no derivative.
        radiance[0] += before[0]
        cover[0] = dr.select(hit & hidden, 1.0, cover[0])
        whole = dr.zeros(mi.Float, count)  # what is 0 everywhere is one number
        return [part + whole for color, alpha in zip(radiance, cover, strict=True) for part in (*color, alpha)]

    def _surface(self, triangle: Any, uv: Any, viewer: Any, active: Any) -> Surface:
        return LiveSurface(self._looks, self._symbols, self._light.split, triangle, uv, viewer, active)

    def _constant(self, value: float) -> Dual:
        return [self._mi.Color3f(value), *(self._mi.Color3f(0.0) for _ in self._symbols)]

    def _dark(self) -> Dual:
        return self._constant(0.0)

    def _recorded(self, record: Record, responses: list[Response], arriving: list[Arriving], active: Any) -> Dual:
        """Return what is reflected of light, which does not depend on the inputs."""
        (light,) = arriving
        return where(active, product(record.throughput, [each.to(light) for each in responses]))
