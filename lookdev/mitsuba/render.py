"""A scene in Mitsuba's arrays, and frames of it: two independent halves, in rounds up to the target error."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from lookdev.asset import read_asset
from lookdev.codegen import ProgramSource
from lookdev.metrics import relmse_of_halves
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.integrator import Counts, Estimator, View
from lookdev.mitsuba.lights import lights_of
from lookdev.mitsuba.surface import Looks
from lookdev.render.denoise import denoised
from lookdev.render.frame import Progress, RenderedFrame, rounds
from lookdev.render.oidn import denoiser
from lookdev.render.task import FrameTask, SceneTask
from lookdev.scene import Sampling

Floats = NDArray[np.float64]

LONGEST_LAUNCH = 0.2
"""Seconds: the worker reports between launches, and kernels cannot be interrupted."""

_FIRST_LAUNCH = 1 << 16  # samples, before their time is known
_MOST_SAMPLES = 1 << 24  # of a launch: four numbers of each are stored
_FEATURE_SAMPLES = 16  # edges, lenses and textures are all their noise
_SEEDS_PER_FRAME = 64  # of rounds and halves: those of neighbouring `seed` values never coincide


class MitsubaScene:
    """A scene task in a variant's arrays."""

    def __init__(self, mi: Any, task: SceneTask) -> None:
        self._mi = mi
        self._task = task
        self._per_second = _FIRST_LAUNCH / LONGEST_LAUNCH
        sources = [source for source in task.shaders if isinstance(source, ProgramSource)]
        self._geometry = Geometry(mi, read_asset(task.asset.path), task.worn)
        looks = Looks(mi, sources, self._geometry)
        light = lights_of(mi, task.lights, self._geometry.center, task.camera.pivot)
        shadows = any(source.shadows for source in sources)
        counts = _counts(task.sampling, light.sampled)
        self._estimator = Estimator(mi, self._geometry, looks, light, counts, task.sampling.bounces, shadows)

    def fits(self, task: SceneTask) -> bool:
        """Return whether frames of a task are frames of this scene, which differ in samples and seed at most."""
        own = self._task
        sampling = replace(
            task.sampling, samples=own.sampling.samples, error=own.sampling.error, seed=own.sampling.seed
        )
        camera = own.camera if own.camera.pivot == task.camera.pivot else task.camera
        return replace(task, sampling=sampling, camera=camera) == own

    def render(self, task: FrameTask, progress: Progress) -> RenderedFrame:
        """Render one frame. The halves have independent scrambles, so that their difference measures the error."""
        started = time.perf_counter()
        sampling, (width, height) = task.scene.sampling, task.scene.resolution
        gain = 2.0**task.exposure
        view = View.of(self._mi, task.scene.camera, task.pose, (width, height), self._geometry.center)
        smooth = self._denoiser(view) if sampling.denoise != "off" else None
        sums = np.zeros((2, height, width, 4))
        done, error = 0, math.nan
        result = None
        for number, size in enumerate(rounds(sampling)):
            for half in (0, 1):
                seed = sampling.seed * _SEEDS_PER_FRAME + 2 * number + half
                for share, rows in self._launches(view, seed, size):
                    sums[half].reshape(-1, 4)[rows] += share
                    progress(done + size * rows.stop // (width * height), sampling.samples, _known(error))
                done += size
            alpha = sums[..., 3].sum(axis=0) / done
            a, b = (2.0 / done) * sums[..., :3]
            error = raw_error = relmse_of_halves(a * gain, b * gain, alpha)
            if smooth is not None:
                result = denoised(a * gain, b * gain, alpha, smooth)
                error = result.relmse
            progress(done, sampling.samples, error)
            if sampling.error is not None and error <= sampling.error:
                break
        raw = None if result is None else (0.5 * (a + b)).astype(np.float32)
        if result is not None:
            a, b = result.a / gain, result.b / gain
        a, b, alpha = (array.astype(np.float32) for array in (a, b, alpha))
        seconds, measured = time.perf_counter() - started, None if result is None else raw_error
        return RenderedFrame(a, b, alpha, done, seconds, error, raw, measured)

    def _launches(self, view: View, seed: int, size: int) -> Iterator[tuple[Floats, slice]]:
        """Yield sums (n, 4) of radiance and coverage over `size` samples, and the n pixels that they are of."""
        mi, total = self._mi, view.width * view.height
        first = 0
        while first < total:
            started = time.perf_counter()
            most = min(self._per_second * LONGEST_LAUNCH, _MOST_SAMPLES) / size
            # Of a power of two: rays of other launches are in other packets of Embree, and differ in their last digit.
            # So frames do not depend on how long launches take, nor on the number of threads.
            count = 1 << int(math.log2(max(1.0, min(most, total - first))))
            numbers = [dr.opaque(mi.UInt32, each) for each in (seed, first, size.bit_length() - 1)]
            parts = self._estimator.pixels(view, count * size, *numbers)
            dr.eval(*parts)
            # By NumPy, whose order of summation does not depend on the size of a launch.
            sums = np.stack([np.asarray(each).reshape(count, size).sum(axis=1, dtype=np.float64) for each in parts], -1)
            self._per_second = count * size / max(time.perf_counter() - started, 1e-6)
            yield sums, slice(first, first + count)
            first += count

    def _denoiser(self, view: View) -> Callable[[NDArray[np.float32]], NDArray[np.float32]]:
        albedo, normal = (
            each.reshape(view.height, view.width, 3) for each in self._estimator.guides(view, _FEATURE_SAMPLES)
        )
        return denoiser(albedo, normal)


def _known(error: float) -> float | None:
    return None if math.isnan(error) else error


def _counts(sampling: Sampling, sampled: bool) -> Counts:
    """Return the numbers of directions: those of the job, or those that take the least time to an error."""
    brdf = 2 if sampling.brdf_samples is None else sampling.brdf_samples
    light = 4 if sampling.ibl_samples is None else sampling.ibl_samples
    if not sampled or light == 0:
        return Counts(max(brdf, 1), 0, 1, 0)
    # A path goes on as long as there is a direction of the BSDF.
    return Counts(brdf, light, 1, -(-light // 2))
