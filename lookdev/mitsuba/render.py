"""A scene in Mitsuba's arrays, and frames of it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from lookdev.asset import read_asset
from lookdev.codegen import ProgramSource
from lookdev.codegen.source import LOBE_GROUPS
from lookdev.errors import RenderError
from lookdev.mitsuba.frozen import held_arrays, nothing_freed
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.integrator import Counts, Estimator
from lookdev.mitsuba.passes import CENTRAL, Features
from lookdev.mitsuba.rig import lights_of
from lookdev.mitsuba.surface import Looks
from lookdev.mitsuba.view import Rectangle, View
from lookdev.rendering.adaptive import Region
from lookdev.rendering.frame import Denoiser, Image, Progress, RenderedFrame, render_halves
from lookdev.rendering.oidn import denoiser
from lookdev.rendering.passes import LIGHTS, PASSES, light_layer, parts_of_light
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.scene import Sampling

Floats = NDArray[np.float64]

LONGEST_LAUNCH = 0.2
"""Seconds: the worker reports between launches, and kernels cannot be interrupted."""

_FIRST_LAUNCH = 1 << 16  # samples, before their time is known
_MOST_SAMPLES = 1 << 24  # of a launch: four numbers of each are stored
# Samples up to which the quick filter saves more time than the samples take that its error would need.
_QUICKLY_DENOISED = 64


class MitsubaScene:
    """A scene task in a variant's arrays; of the scene `before`, which is not rendered any more, it keeps the asset."""

    def __init__(self, mi: Any, task: SceneTask, before: MitsubaScene | None = None) -> None:
        self._mi = mi
        self._task = task
        self._per_second = _FIRST_LAUNCH / LONGEST_LAUNCH
        self._most_samples = _MOST_SAMPLES
        sources = [source for source in task.shaders if isinstance(source, ProgramSource)]
        if before is not None and (before._task.asset, before._task.device) == (task.asset, task.device):
            self._geometry: Geometry = before._geometry
        else:
            self._geometry = Geometry(mi, read_asset(task.asset.path))
        self._geometry.dress(task.worn, task.groups)
        looks = self._looks = Looks(mi, sources, self._geometry)
        of_lights = task.light_groups[: len(task.lights)]
        names = list(dict.fromkeys(of_lights))
        groups = [names.index(each) for each in of_lights]
        light = lights_of(mi, task.lights, task.lit, self._geometry.center, task.camera.pivot, groups)
        for spared in light.spared:
            self._geometry.casting(spared)  # made before it is used in a kernel
        shadows = any(source.shadows for source in sources)
        glossy = all(source.glossy for source in sources)
        counts = counts_of(task.sampling, light.sampled, glossy)
        wanted, bounces = task.sampling.passes, task.sampling.bounces
        lobes = [group for group in LOBE_GROUPS if any(group in source.recorded for source in sources)]
        sets = {"lobes": lobes, "direct": [*PASSES["direct"].arrays], LIGHTS: [light_layer(name) for name in names]}
        self._sets = [parts for name, parts in sets.items() if name in wanted and parts]
        # The last of a set of parts is what the others leave.
        self._recorded = [name for parts in self._sets for name in parts[:-1]]
        recorded, direct = lobes[:-1] if "lobes" in wanted else [], "direct" in wanted
        self._features = Features(mi, self._geometry, looks, bounces)
        self._estimator = Estimator(mi, self._geometry, looks, light, counts, bounces, shadows, recorded, direct)
        # Traced once: for many looks and lights this takes longer than the kernel.
        arrays = held_arrays(self._estimator)
        self._pixels = dr.freeze(self._estimator.pixels, state_fn=lambda *arguments: arrays)

    def fits(self, task: SceneTask) -> bool:
        """Return whether frames of a task are this scene's: they differ in samples, seed, camera, size at most."""
        own = self._task
        sampling = replace(
            task.sampling, samples=own.sampling.samples, error=own.sampling.error, seed=own.sampling.seed
        )
        camera = own.camera if own.camera.pivot == task.camera.pivot else task.camera
        return replace(task, sampling=sampling, camera=camera, resolution=own.resolution) == own

    def take(self, task: SceneTask) -> bool:
        """Become the scene of a task of which only constants of looks differ; return whether it is one."""
        if len(task.shaders) != len(self._task.shaders) or not self.fits(replace(task, shaders=self._task.shaders)):
            return False
        sources = [source for source in task.shaders if isinstance(source, ProgramSource)]
        if not self._looks.take(sources):
            return False
        self._task = replace(self._task, shaders=task.shaders)
        return True

    def render(self, task: FrameTask, progress: Progress) -> RenderedFrame:
        """Render one frame; what `progress` was called with last is repeated between launches."""
        view = View.of(self._mi, task.scene.camera, task.pose, task.scene.resolution, self._geometry.center)
        last: tuple[int, int, float | None] = (0, task.scene.sampling.samples, None)

        def report(done: int, of: int, relmse: float | None) -> None:
            nonlocal last
            last = done, of, relmse
            progress(*last)

        def render(seed: int, region: Region) -> tuple[Image, Image, Mapping[str, Image]]:
            height, width = region.rows.stop - region.rows.start, region.columns.stop - region.columns.start
            sums = np.zeros((height * width, 4 + 3 * len(self._recorded)))
            for part, pixels in self._launches(view, seed, region, height * width):
                sums[pixels] = part
                progress(*last)
            means = (sums / region.samples).reshape(height, width, -1)
            parts = self._parts(task.scene, means)
            return means[..., :3].astype(np.float32), means[..., 3].astype(np.float32), parts

        with nothing_freed():
            frame = render_halves(task, render, partial(self._denoiser, view, task.scene.sampling.samples), report)
        started = time.perf_counter()
        passes, names = self._passes(task, view, frame)
        seconds = time.perf_counter() - started
        return replace(
            frame,
            passes={**frame.passes, **passes},
            names=names,
            seconds=frame.seconds + seconds,
            raw_seconds=None if frame.raw_seconds is None else frame.raw_seconds + seconds,
        )

    def _parts(self, task: SceneTask, means: Floats) -> dict[str, Image]:
        """Return the parts of the light of means (H, W, 4 + 3 n): colour, coverage, and what was recorded."""
        beauty = means[..., :3]
        # Lobes that no look has, and lights that reach nothing, are black.
        names = parts_of_light(task.sampling.passes, task.names_of_light)
        parts = dict.fromkeys(sorted(names), np.zeros_like(beauty))
        for number, name in enumerate(self._recorded):
            parts[name] = means[..., 4 + 3 * number : 7 + 3 * number]
        for *others, last in self._sets:
            parts[last] = beauty - sum(parts[each] for each in others)
        return {name: part.astype(np.float32) for name, part in parts.items()}

    def _passes(self, task: FrameTask, view: View, frame: RenderedFrame) -> tuple[dict[str, Image], Mapping[str, Any]]:
        """Return the passes that are no parts of the light, and the names in mattes."""
        wanted = {*task.scene.sampling.passes}
        passes: dict[str, Image] = {}
        names: Mapping[str, Any] = {}
        if wanted & CENTRAL:
            passes |= self._features.central(view, task)
        if "albedo" in wanted:
            passes["albedo"], _ = self._features.guides(view)
        if "cryptomatte" in wanted:
            mattes, names = self._features.mattes(view, task, frame.alpha, frame.samples)
            passes |= mattes
        return passes, names

    def _launches(self, view: View, seed: int, region: Region, total: int) -> Iterator[tuple[Floats, slice]]:
        """Yield sums (n, 4) of radiance and coverage over the samples of n pixels of a region, and which these are."""
        mi, size = self._mi, region.samples
        place = Rectangle.of(mi, region)
        first = 0
        while first < total:
            most = min(self._per_second * LONGEST_LAUNCH, self._most_samples) / size
            # Of a power of two: rays of other launches are in other packets of Embree, and differ in their last digit.
            # So frames do not depend on how long launches take, nor on the number of threads.
            count = 1 << int(math.log2(max(1.0, min(most, total - first))))
            numbers = [dr.opaque(mi.UInt32, each) for each in (seed, first, size.bit_length() - 1)]
            try:
                lane = dr.arange(mi.UInt32, count * size)
                dr.eval(lane)
                parts = self._pixels(view, place, lane, *numbers)
                started = time.perf_counter()
                dr.eval(*parts)
                # By NumPy, whose order of summation does not depend on the size of a launch.
                found = [np.asarray(each).reshape(count, size).sum(axis=1, dtype=np.float64) for each in parts]
            except (MemoryError, RuntimeError) as error:
                if not _out_of_memory(error):
                    raise
                if count == 1:
                    raise RenderError(
                        f"out of memory, even with the {size} samples of a single pixel in a launch: fewer samples, "
                        "smaller geometry or textures, or more memory would be right"
                    ) from error
                self._most_samples = count * size // 2
                dr.flush_malloc_cache()
                continue
            self._per_second = count * size / max(time.perf_counter() - started, 1e-6)
            yield np.stack(found, axis=-1), slice(first, first + count)
            first += count

    def _denoiser(self, view: View, samples: int) -> Denoiser:
        return denoiser(*self._features.guides(view), quick=samples <= _QUICKLY_DENOISED)


def _out_of_memory(error: BaseException | None) -> bool:
    """Return whether an error, or one that it came from, is that of an allocation."""
    if error is None:
        return False
    return isinstance(error, MemoryError) or "out of memory" in str(error) or _out_of_memory(error.__cause__)


# In recesses a path that goes on adds one sample of what other parts reflect, however many directions were drawn where
# it began, as in `lookdev.codegen.osl.directions`: glossy looks take few at the first hit.
_COUNTS, _GLOSSY, _RESAMPLED = Counts(2, 4, 1, 4), Counts(1, 2, 1, 4), Counts(1, 4, 1, 8, resampled=True)


def counts_of(sampling: Sampling, sampled: bool, glossy: bool, resampled: bool = True) -> Counts:
    """Return the numbers of directions: those of the job, or those that take the least time to an error.

    `resampled`: the estimator can trace one of the light's directions for all.
    """
    usual = _COUNTS
    if glossy and sampling.bounces > 0:
        usual = _RESAMPLED if resampled and sampling.ibl_samples is None else _GLOSSY
    brdf = usual.brdf if sampling.brdf_samples is None else sampling.brdf_samples
    light = usual.light if sampling.ibl_samples is None else sampling.ibl_samples
    if not sampled or light == 0:
        return Counts(max(brdf, 1), 0, 1, 0)
    onward = usual.light_onward if sampling.ibl_samples is None else -(-light // 2)
    # A path goes on as long as there is a direction of the BSDF.
    return Counts(brdf, light, 1, onward, usual.resampled)
