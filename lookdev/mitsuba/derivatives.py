"""Renders pictures, and along the same paths their derivatives with respect to live inputs of looks, for fits.

A live input is an input of a look whose value is an argument of a render (`DerivativeTask.values`), and not a constant
of the look's program.

Directions are drawn, and paths are selected and ended, with densities that are not differentiated. Therefore an
estimate

    f(wi, x) L(wi) / pdf(wi)    has the derivative    df/dx L / pdf + f dL/dx / pdf.

Here, f is the BSDF times the cosine, wi a direction, x a live input, and L the light from wi. The mean of this
derivative is the derivative of the integral, because no edge of the picture moves with an input.

The program of a look has the derivatives of f among its outputs (`codegen.trace.derivatives`). If diffuse and specular
lobes reflect different light, the program also has the derivatives of the diffuse part of f. The loops over paths in
`lookdev.mitsuba.integrator` compute with duals (`lookdev.mitsuba.dual`). Here, a dual is a list of a value and its
derivatives. When a frame is rendered, a dual has only the value.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import drjit as dr
import numpy as np

from lookdev.arrays import Floats32
from lookdev.asset import read_asset
from lookdev.codegen.program.look import derivative_name
from lookdev.mitsuba.dual import Dual, product, where
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.integrator import Estimator, Vertex
from lookdev.mitsuba.lights import SceneLights
from lookdev.mitsuba.programs import Evaluation
from lookdev.mitsuba.rig import scene_lights
from lookdev.mitsuba.surface import Arriving, Response, SceneLooks, SurfacePoints
from lookdev.mitsuba.types import UV, Bool, Color3f, Float, Mitsuba, UInt, Vector3f
from lookdev.mitsuba.view import FramePart, KernelView
from lookdev.rendering.adaptive import Region
from lookdev.rendering.derivatives import DerivativeTask
from lookdev.rendering.task import SceneTask
from lookdev.scene import Sampling

_LAUNCH_SAMPLES = 1 << 21  # the most samples in a launch without derivatives; with P derivatives, divided by 1 + P


class DerivativeScene:
    """The geometry and the lights of a scene whose looks have live inputs. Both are the same for all input values."""

    def __init__(self, mi: Mitsuba, task: SceneTask) -> None:
        self.task = task
        self._mi = mi
        self._geometry = Geometry(mi, read_asset(task.asset.path))
        self._geometry.assign_looks(task.slot_shaders, task.groups)
        self._light = scene_lights(mi, task, self._geometry)

    def render(self, task: DerivativeTask, progress: Callable[[int, int], None]) -> Floats32:
        """Return two halves of a picture and of its derivatives, (2, 1 + P, H, W, 4).

        The derivatives are with respect to the P `task.symbols`. The axes are the half, the picture followed by its
        derivatives, row, column, and the channels of radiance (3) and coverage. `progress` is called with the number of
        finished launches and the number of all launches.
        """
        mi, geometry = self._mi, self._geometry
        inputs = {name: (mi.Vector3f if len(value) == 3 else mi.Float)(*value) for name, value in task.values.items()}
        dr.make_opaque(inputs)
        looks = SceneLooks(mi, task.scene, geometry, inputs)
        estimator = DerivativeEstimator(looks, self._light, task.scene.sampling, task.symbols)
        width, height = task.scene.resolution
        view = KernelView.of(mi, task.scene.camera, task.pose, (width, height), geometry.center)
        rectangle = FramePart.of(mi, Region(slice(0, height), slice(0, width), task.samples))
        rows: list[list[Floats32]] = []
        step = max(1, _LAUNCH_SAMPLES // (task.samples * (1 + len(task.symbols))))
        starts = range(0, width * height, step)
        for seed in task.seeds:
            for first in starts:
                count = min(step, width * height - first)
                numbers = [dr.opaque(mi.UInt32, number) for number in (seed, first, task.samples.bit_length() - 1)]
                duals = estimator.duals(view, rectangle, count * task.samples, *numbers)
                # One kernel computes all channels. Otherwise each of the sums below would run a kernel of its own.
                dr.eval(duals)
                sums = [dr.block_sum(channel, task.samples) for channel in duals]
                rows.append([np.array(channel_sum) / np.float32(task.samples) for channel_sum in sums])
                progress(len(rows), 2 * len(starts))
        halves = np.split(np.concatenate([np.stack(channels, -1) for channels in rows]), 2)
        shape = height, width, 1 + len(task.symbols), 4
        return np.stack([np.moveaxis(half.reshape(shape), 2, 0) for half in halves])


class LiveSurface(SurfacePoints):
    """Points of a surface where the responses of the look have derivatives.

    The derivatives are with respect to the numbers that `symbols` names. With `split`, the diffuse part of a response
    is separate. `position` is as in `SurfacePoints`.
    """

    def __init__(
        self, looks: SceneLooks, symbols: Sequence[str], split: bool, *position: *tuple[UInt, UV, Vector3f, Bool]
    ) -> None:
        super().__init__(looks, *position)
        self._symbols, self._split = symbols, split
        if (evaluation := self._single) is not None:
            outputs = [*(["diffuse"] * split), *(derivative_name("diffuse", symbol) for symbol in symbols if split)]
            outputs += [derivative_name("value", symbol) for symbol in symbols]
            evaluation.prepare(*filter(evaluation.has, outputs))

    def respond(self, wi: Vector3f, active: Bool, split: bool, groups: Sequence[str]) -> tuple[list[Response], Float]:
        """Return the response, followed by its derivatives, and the pdf, as `SurfacePoints.respond`."""
        mi = self.looks.mi

        def respond(evaluation: Evaluation, wi: Vector3f) -> tuple[Dual, Dual, Float]:
            directions = {"wi_x": wi.x, "wi_y": wi.y, "wi_z": wi.z}
            value = self._dual(evaluation, "value", mi.Color3f, **directions)
            diffuse = (
                self._dual(evaluation, "diffuse", mi.Color3f, **directions) if split else [mi.Color3f(0.0)] * len(value)
            )
            return value, diffuse, mi.Float(evaluation.values("pdf", **directions)[0])

        value, diffuse, pdf = self._call_programs(respond, wi, active=active)
        return [Response(pair, [], split) for pair in zip(value, diffuse, strict=True)], pdf

    def absence(self) -> Dual:
        """Return 1 minus the presence, followed by its derivatives."""
        mi = self.looks.mi

        def presence(evaluation: Evaluation) -> Dual:
            if not evaluation.has("presence"):
                return [mi.Color3f(1.0), *(mi.Color3f(0.0) for _ in self._symbols)]
            return self._dual(evaluation, "presence", mi.Color3f)

        present, *derivatives = self._call_programs(presence, active=self.active)
        return [1.0 - present, *(-derivative for derivative in derivatives)]

    def delta(self, number: int) -> tuple[Vector3f, Dual, Float]:
        """Return a delta direction, its factor followed by derivatives, and its group, as `SurfacePoints.delta`."""
        mi = self.looks.mi

        def delta(evaluation: Evaluation) -> Dual:
            if not evaluation.has(f"delta{number}"):
                return [mi.Color3f(0.0) for _ in range(1 + len(self._symbols))]
            return self._dual(evaluation, f"delta{number}", lambda *elements: mi.Color3f(*elements[3:6]))

        wi, _, group = super().delta(number)
        return wi, self._call_programs(delta, active=self.active), group

    def _dual(self, evaluation: Evaluation, output: str, kind: Callable[..., Color3f], **inputs: Float) -> Dual:
        """Return an output of a program and its derivatives with respect to the symbols; `kind` makes the colours."""
        names = [derivative_name(output, symbol) for symbol in self._symbols]
        zero = self.looks.mi.Color3f(0.0)
        derivatives = [kind(*evaluation.values(name, **inputs)) if evaluation.has(name) else zero for name in names]
        return [kind(*evaluation.values(output, **inputs)), *derivatives]


class DerivativeEstimator(Estimator):
    """Estimates pictures of a scene, and their derivatives with respect to symbols of its looks' programs."""

    _can_resample = False

    def __init__(self, looks: SceneLooks, light: SceneLights, sampling: Sampling, symbols: Sequence[str]) -> None:
        super().__init__(looks, light, sampling)
        self._symbols = symbols

    def duals(
        self, view: KernelView, rectangle: FramePart, count: int, seed: UInt, first: UInt, shift: UInt
    ) -> list[Float]:
        """Return the four channels of radiance and coverage, then their derivatives with respect to each symbol.

        `count` is the number of samples. The other arguments are as in `Estimator.render_pixels`.
        """
        mi = self._mi
        lane = dr.arange(mi.UInt32, count)
        radiance, coverage, _ = self._estimate(view, rectangle, lane, seed, first, shift)
        zeros = dr.zeros(mi.Float, count)  # a channel that is 0 everywhere is a single number; the sum is an array
        return [part + zeros for color, alpha in zip(radiance, coverage, strict=True) for part in (*color, alpha)]

    def _surface(self, triangle: UInt, uv: UV, viewer: Vector3f, active: Bool) -> SurfacePoints:
        return LiveSurface(self._looks, self._symbols, self._light.split, triangle, uv, viewer, active)

    def _constant_dual(self, value: float) -> Dual:
        return [self._mi.Color3f(value), *(self._mi.Color3f(0.0) for _ in self._symbols)]

    def _no_light(self) -> Dual:
        return self._constant_dual(0.0)

    def _reflect(self, vertex: Vertex, responses: list[Response], arriving: list[Arriving], active: Bool) -> Dual:
        """Return the reflected light and its derivatives; the arriving light does not depend on live inputs."""
        (light,) = arriving
        return where(active, product(vertex.throughput, [response.to(light) for response in responses]))
