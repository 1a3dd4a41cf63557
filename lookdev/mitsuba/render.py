"""Renders the frames of a scene in Mitsuba: launches the kernel of the path tracer for parts of a frame.

A launch computes the samples of some pixels. Halves of a frame, and their regions, are described in
`lookdev.rendering.adaptive`.
"""

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
"""The planned seconds of a launch. Kernels cannot be interrupted, and the worker reports progress between launches."""

_FIRST_LAUNCH_SAMPLES = 1 << 16  # samples in the first launch, before the time of a sample is measured
_MAX_LAUNCH_SAMPLES = 1 << 24  # the most samples in a launch: for each, four numbers or more are stored
# The most samples per pixel for which the denoiser's quick mode is used. This mode has a larger error. The additional
# samples that compensate it take less time than the mode saves.
_QUICK_FILTER_SAMPLES = 64


class MitsubaScene:
    """A scene in a variant's arrays. It takes over the geometry of a `previous` scene with the same asset.

    The previous scene must not be used afterwards.
    """

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
        # The last part of each set is not recorded, because it is the beauty minus the other parts.
        self._recorded = [name for parts in task.part_sets for name in parts[:-1]]
        light = scene_lights(mi, task, self._geometry)
        self._features = Features(looks, task.sampling.bounces)
        groups = [name for name in self._recorded if name in LOBE_GROUPS]
        self._estimator = Estimator(looks, light, task.sampling, groups)
        # The function is frozen, so that it is traced only once. With many looks and lights, tracing takes longer than
        # the kernel itself.
        arrays = collect_arrays(self._estimator)
        self._render_pixels = dr.freeze(self._estimator.render_pixels, state_fn=lambda *arguments: arrays)

    def matches(self, task: SceneTask) -> bool:
        """Return whether this scene can render a task.

        The task may have other samples, another target error or seed, another resolution, or another camera with the
        same pivot.
        """
        scene = self._task
        sampling = replace(
            task.sampling, samples=scene.sampling.samples, error=scene.sampling.error, seed=scene.sampling.seed
        )
        camera = scene.camera if scene.camera.pivot == task.camera.pivot else task.camera
        return replace(task, sampling=sampling, camera=camera, resolution=scene.resolution) == scene

    def update(self, task: SceneTask) -> bool:
        """Change to a task that differs only in constants of looks; for other tasks, do nothing and return False."""
        if len(task.shaders) != len(self._task.shaders) or not self.matches(replace(task, shaders=self._task.shaders)):
            return False
        if not self._looks.update(task):
            return False
        self._task = replace(self._task, shaders=task.shaders)
        return True

    def render(self, task: FrameTask, progress: ReportSamples) -> RenderedFrame:
        """Render one frame. `progress` is also called after each launch, with the same figures as before."""
        view = KernelView.of(self._mi, task.scene.camera, task.pose, task.scene.resolution, self._geometry.center)
        latest_report: tuple[int, int, float | None] = (0, task.scene.sampling.samples, None)

        def report(finished: int, planned: int, relmse: float | None) -> None:
            nonlocal latest_report
            latest_report = finished, planned, relmse
            progress(*latest_report)

        def render(seed: int, region: Region) -> tuple[Floats32, Floats32, Mapping[str, Floats32]]:
            """Render a region of a half, as `lookdev.rendering.frame.RenderRegion`."""
            height, width = region.rows.stop - region.rows.start, region.columns.stop - region.columns.start
            sums = np.zeros((height * width, 4 + 3 * len(self._recorded)))
            for pixel_sums, pixels in self._render_launches(view, seed, region, height * width):
                sums[pixels] = pixel_sums
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
        """Return the parts of the light by name, (H, W, 3) each.

        `means` (H, W, 4 + 3 n) are means over samples: three channels of colour, the coverage, and three channels of
        each of the n recorded parts.
        """
        recorded = {name: means[..., 4 + 3 * n : 7 + 3 * n] for n, name in enumerate(self._recorded)}
        parts = task.complete_parts(recorded, means[..., :3])
        return {name: part.astype(np.float32) for name, part in parts.items()}

    def _passes(
        self, task: FrameTask, view: KernelView, frame: RenderedFrame
    ) -> tuple[dict[str, Floats32], Mapping[str, tuple[str, ...]]]:
        """Return the passes that are not parts of the light, by name, and the names in cryptomattes."""
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
        """Render the pixels of a region in several launches. Pixels are numbered row by row, up to `total`.

        Yields, for each launch, sums over samples (n, 4 + 3 parts) of n pixels, with channels as in `_light_parts`, and
        the slice of these pixels.
        """
        mi, size = self._mi, region.samples
        rectangle = FramePart.of(mi, region)
        first = 0
        while first < total:
            limit = min(self._samples_per_second * MAX_LAUNCH_SECONDS, self._max_launch_samples) / size
            # The number of pixels is a power of two. Rays are then always in the same packets of Embree, on which the
            # last digits of results depend. So frames depend neither on the time that launches take nor on the number
            # of threads.
            count = 1 << int(math.log2(max(1.0, min(limit, total - first))))
            numbers = [dr.opaque(mi.UInt32, number) for number in (seed, first, size.bit_length() - 1)]
            try:
                lane = dr.arange(mi.UInt32, count * size)
                dr.eval(lane)
                channels = self._render_pixels(view, rectangle, lane, *numbers)
                start = time.perf_counter()
                dr.eval(*channels)
                # NumPy sums up the samples of a pixel in an order that does not depend on the size of a launch.
                sums = [np.asarray(channel).reshape(count, size).sum(axis=1, dtype=np.float64) for channel in channels]
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
        """Return a denoiser that the albedos and normals of the view guide; `samples` is the task's sample count."""
        return make_denoiser(*self._features.guides(view), quick=samples <= _QUICK_FILTER_SAMPLES)


def _is_out_of_memory(error: BaseException | None) -> bool:
    """Return whether an error, or one of its causes, is a failed allocation."""
    if error is None:
        return False
    return isinstance(error, MemoryError) or "out of memory" in str(error) or _is_out_of_memory(error.__cause__)
