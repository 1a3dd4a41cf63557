"""A scene in Mitsuba's arrays, and the rendering of its frames."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import drjit as dr
import numpy as np

from lookdev.arrays import Floats, Floats32
from lookdev.asset import read_asset
from lookdev.codegen.source import LOBE_GROUPS
from lookdev.errors import RenderError
from lookdev.mitsuba.frozen import collect_arrays, pause_garbage_collection
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.integrator import Estimator
from lookdev.mitsuba.passes import CENTER_PASSES, Features
from lookdev.mitsuba.rig import scene_lights
from lookdev.mitsuba.surface import SceneLooks
from lookdev.mitsuba.types import Mitsuba
from lookdev.mitsuba.view import FramePart, KernelView
from lookdev.rendering.adaptive import Region
from lookdev.rendering.frame import Denoiser, RenderedFrame, ReportSamples, render_halves
from lookdev.rendering.oidn import make_denoiser
from lookdev.rendering.task import FrameTask, SceneTask

MAX_LAUNCH_SECONDS = 0.2
"""Seconds of a launch: the worker reports between launches, and kernels cannot be interrupted."""

_FIRST_LAUNCH_SAMPLES = 1 << 16  # samples, before the time of a sample is measured
_MAX_LAUNCH_SAMPLES = 1 << 24  # samples in a launch: four numbers of each are stored
# Samples up to which the quick filter is used: it saves more time than the samples take that compensate its error.
_QUICK_FILTER_SAMPLES = 64


class MitsubaScene:
    """A scene task in a variant's arrays. It takes over the asset of the `previous` scene, which then is not used."""

    def __init__(self, mi: Mitsuba, task: SceneTask, previous: MitsubaScene | None = None) -> None:
        self._mi = mi
        self._task = task
        self._samples_per_second = _FIRST_LAUNCH_SAMPLES / MAX_LAUNCH_SECONDS
        self._max_launch_samples = _MAX_LAUNCH_SAMPLES
        if previous is not None and (previous._task.asset, previous._task.device) == (task.asset, task.device):
            self._geometry: Geometry = previous._geometry
        else:
            self._geometry = Geometry(mi, read_asset(task.asset.path))
        self._geometry.assign_looks(task.slot_shaders, task.groups)
        looks = self._looks = SceneLooks(mi, task, self._geometry)
        # The last of a set of parts is the beauty minus the others.
        self._recorded = [name for parts in task.part_sets for name in parts[:-1]]
        light = scene_lights(mi, task, self._geometry)
        self._features = Features(looks, task.sampling.bounces)
        groups = [name for name in self._recorded if name in LOBE_GROUPS]
        self._estimator = Estimator(looks, light, task.sampling, groups)
        # Frozen, so that it is traced once: with many looks and lights, tracing takes longer than the kernel.
        arrays = collect_arrays(self._estimator)
        self._render_pixels = dr.freeze(self._estimator.render_pixels, state_fn=lambda *arguments: arrays)

    def matches(self, task: SceneTask) -> bool:
        """Return whether this scene renders a task: only samples, seed, camera and resolution may differ."""
        scene = self._task
        sampling = replace(
            task.sampling, samples=scene.sampling.samples, error=scene.sampling.error, seed=scene.sampling.seed
        )
        camera = scene.camera if scene.camera.pivot == task.camera.pivot else task.camera
        return replace(task, sampling=sampling, camera=camera, resolution=scene.resolution) == scene

    def update(self, task: SceneTask) -> bool:
        """Change to a task that differs in constants of looks alone, and return True; return False for other tasks."""
        if len(task.shaders) != len(self._task.shaders) or not self.matches(replace(task, shaders=self._task.shaders)):
            return False
        if not self._looks.update(task):
            return False
        self._task = replace(self._task, shaders=task.shaders)
        return True

    def render(self, task: FrameTask, progress: ReportSamples) -> RenderedFrame:
        """Render one frame; between launches, `progress` is called with the latest figures again."""
        view = KernelView.of(self._mi, task.scene.camera, task.pose, task.scene.resolution, self._geometry.center)
        latest_report: tuple[int, int, float | None] = (0, task.scene.sampling.samples, None)

        def report(finished: int, planned: int, relmse: float | None) -> None:
            nonlocal latest_report
            latest_report = finished, planned, relmse
            progress(*latest_report)

        def render(seed: int, region: Region) -> tuple[Floats32, Floats32, Mapping[str, Floats32]]:
            height, width = region.rows.stop - region.rows.start, region.columns.stop - region.columns.start
            sums = np.zeros((height * width, 4 + 3 * len(self._recorded)))
            for part, pixels in self._render_launches(view, seed, region, height * width):
                sums[pixels] = part
                progress(*latest_report)
            means = (sums / region.samples).reshape(height, width, -1)
            parts = self._light_parts(task.scene, means)
            return means[..., :3].astype(np.float32), means[..., 3].astype(np.float32), parts

        with pause_garbage_collection():
            frame = render_halves(task, render, partial(self._denoiser, view, task.scene.sampling.samples), report)
        start = time.perf_counter()
        passes, names = self._passes(task, view, frame)
        return frame.with_passes(passes, names, time.perf_counter() - start)

    def _light_parts(self, task: SceneTask, means: Floats) -> dict[str, Floats32]:
        """Return the parts of the light, from means (H, W, 4 + 3 n) of colour, coverage, and recorded parts."""
        recorded = {name: means[..., 4 + 3 * n : 7 + 3 * n] for n, name in enumerate(self._recorded)}
        parts = task.complete_parts(recorded, means[..., :3])
        return {name: part.astype(np.float32) for name, part in parts.items()}

    def _passes(
        self, task: FrameTask, view: KernelView, frame: RenderedFrame
    ) -> tuple[dict[str, Floats32], Mapping[str, tuple[str, ...]]]:
        """Return the passes that are not parts of the light, and the names in mattes."""
        requested = {*task.scene.sampling.passes}
        passes: dict[str, Floats32] = {}
        names: Mapping[str, tuple[str, ...]] = {}
        if requested & CENTER_PASSES:
            passes |= self._features.center_passes(view, task)
        if "albedo" in requested:
            passes["albedo"], _ = self._features.guides(view)
        if "cryptomatte" in requested:
            mattes, names = self._features.mattes(view, task, frame.alpha, frame.samples)
            passes |= mattes
        return passes, names

    def _render_launches(
        self, view: KernelView, seed: int, region: Region, total: int
    ) -> Iterator[tuple[Floats, slice]]:
        """Yield sums (n, 4 + 3 parts) over the samples of n pixels of a region, and the slice of these pixels."""
        mi, size = self._mi, region.samples
        rectangle = FramePart.of(mi, region)
        first = 0
        while first < total:
            limit = min(self._samples_per_second * MAX_LAUNCH_SECONDS, self._max_launch_samples) / size
            # A power of two: rays are then always in the same packets of Embree, on which the last digits depend. So
            # frames do not depend on the time that launches take, or on the number of threads.
            count = 1 << int(math.log2(max(1.0, min(limit, total - first))))
            numbers = [dr.opaque(mi.UInt32, number) for number in (seed, first, size.bit_length() - 1)]
            try:
                lane = dr.arange(mi.UInt32, count * size)
                dr.eval(lane)
                parts = self._render_pixels(view, rectangle, lane, *numbers)
                start = time.perf_counter()
                dr.eval(*parts)
                # Summed by NumPy, in an order that does not depend on the size of a launch.
                sums = [np.asarray(part).reshape(count, size).sum(axis=1, dtype=np.float64) for part in parts]
            except (MemoryError, RuntimeError) as error:
                if not _is_out_of_memory(error):
                    raise
                if count == 1:
                    raise RenderError(
                        f"out of memory, even with the {size} samples of a single pixel in a launch: fewer samples, "
                        "smaller geometry or textures, or more memory would be right"
                    ) from error
                self._max_launch_samples = count * size // 2
                dr.flush_malloc_cache()
                continue
            self._samples_per_second = count * size / max(time.perf_counter() - start, 1e-6)
            yield np.stack(sums, axis=-1), slice(first, first + count)
            first += count

    def _denoiser(self, view: KernelView, samples: int) -> Denoiser:
        return make_denoiser(*self._features.guides(view), quick=samples <= _QUICK_FILTER_SAMPLES)


def _is_out_of_memory(error: BaseException | None) -> bool:
    """Return whether an error, or one of its causes, is a failed allocation."""
    if error is None:
        return False
    return isinstance(error, MemoryError) or "out of memory" in str(error) or _is_out_of_memory(error.__cause__)
