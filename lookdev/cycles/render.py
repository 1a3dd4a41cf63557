"""A frame: two independent halves, in rounds until they reach the target error, denoised if that is wanted."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookdev.cycles import engine
from lookdev.cycles.scene import ALBEDOS, NORMALS, Scene
from lookdev.metrics import relmse_of_halves
from lookdev.render.denoise import Denoised, denoised
from lookdev.render.oidn import denoiser
from lookdev.render.task import FrameTask
from lookdev.scene import Sampling

Image = NDArray[np.float32]

# Seeds of one frame's rounds and halves: those of neighbouring `seed` values never coincide.
_SEEDS_PER_FRAME = 64
# Samples of a half in the first round towards a target error.
_FIRST_ROUND = 8
# Samples of the pictures that guide a denoiser: they have no noise but that of edges, lenses and textures.
_FEATURE_SAMPLES = 16


@dataclass(frozen=True)
class RenderedFrame:
    """Half renders (H, W, 3), coverage (H, W), rows top-down, exposure not applied; samples over both halves.

    A frame as a user of Cycles would have it is one render: `a` and `b` are equal, and `relmse` is nan. `raw` is the
    mean of the halves before they were denoised, `raw_relmse` its error, `raw_seconds` what it took.
    """

    a: Image
    b: Image
    alpha: Image
    samples: int
    seconds: float
    relmse: float
    raw: Image | None = None
    raw_relmse: float | None = None
    raw_seconds: float | None = None


Progress = Callable[[int, int, float | None], None]
"""Called with the samples done, the samples planned, and the relMSE so far."""


def render_frame(scene: Scene, task: FrameTask, progress: Progress) -> RenderedFrame:
    """Render one frame of a scene.

    The halves have independent scrambles and seeds, so that their difference measures the error of their mean.
    """
    started = time.perf_counter()
    sampling = task.scene.sampling
    width, height = task.scene.resolution
    gain = 2.0**task.exposure
    scene.pose(task.scene.camera, task.pose)
    if scene.by_user:
        return _frame_of_user(scene, sampling, progress)
    sums = np.zeros((2, height, width, 3))
    coverage = np.zeros((height, width))
    done = 0
    error = raw_error = math.nan
    before = time.perf_counter()
    smooth = _denoiser(scene, task) if sampling.denoise != "off" else None
    denoising = time.perf_counter() - before
    result: Denoised | None = None
    for number, size in enumerate(_rounds(sampling)):
        for half in (0, 1):
            seed = sampling.seed * _SEEDS_PER_FRAME + 2 * number + half
            scene.control(task.pose, seed, size)
            passes = engine.render_passes(scene.scene, size, seed)
            sums[half] += size * passes["Combined"][::-1, :, :3]
            coverage += size * (passes["UV"][::-1, :, 2] if scene.by_portals else passes["Combined"][::-1, :, 3])
            done += size
            progress(done, sampling.samples, None if math.isnan(error) else error)
        a, b = (2.0 / done) * sums
        error = raw_error = relmse_of_halves(a * gain, b * gain, coverage)
        if smooth is not None:
            before = time.perf_counter()
            result = denoised(a * gain, b * gain, coverage / done, smooth)
            error = result.relmse
            denoising += time.perf_counter() - before
        progress(done, sampling.samples, error)
        if sampling.error is not None and error <= sampling.error:
            break
    raw = None if result is None else (0.5 * (a + b)).astype(np.float32)
    if result is not None:
        a, b = result.a / gain, result.b / gain
    a, b, alpha = (array.astype(np.float32) for array in (a, b, coverage / done))
    seconds = time.perf_counter() - started
    if result is None:
        return RenderedFrame(a, b, alpha, done, seconds, error)
    return RenderedFrame(a, b, alpha, done, seconds, error, raw, raw_error, seconds - denoising)


def _frame_of_user(scene: Scene, sampling: Sampling, progress: Progress) -> RenderedFrame:
    started = time.perf_counter()
    image = engine.render_whole(scene.scene, sampling.samples, sampling.seed)["Combined"][::-1]
    progress(sampling.samples, sampling.samples, None)
    rgb, alpha = np.ascontiguousarray(image[:, :, :3]), np.ascontiguousarray(image[:, :, 3])
    seconds = time.perf_counter() - started
    if sampling.denoise == "off":
        return RenderedFrame(rgb, rgb, alpha, sampling.samples, seconds, math.nan)
    features = engine.render_features(scene.scene, _FEATURE_SAMPLES)
    albedo, normal = (features[f"Denoising {name}"][::-1] for name in ("Albedo", "Normal"))
    smooth = denoiser(albedo, normal)(rgb)
    taken = time.perf_counter() - started
    return RenderedFrame(smooth, smooth, alpha, sampling.samples, taken, math.nan, rgb, math.nan, seconds)


def _denoiser(scene: Scene, task: FrameTask) -> Callable[[Image], Image]:
    """Return a denoiser that is guided by the albedos and normals of the frame."""

    def shown(feature: float) -> Image:
        scene.control(task.pose, 0, feature)
        return engine.render_passes(scene.scene, _FEATURE_SAMPLES)["Combined"][::-1]

    # Normals are shown in [0, 1], and black where there is no surface.
    normals = shown(NORMALS)
    return denoiser(shown(ALBEDOS)[..., :3], 2.0 * normals[..., :3] - normals[..., 3:])


def _rounds(sampling: Sampling) -> Iterator[int]:
    """Yield the samples a pixel of each half by rounds: powers of two, as only such blocks are stratified.

    The fewest rounds with the sum that is set; with a target error, each round doubles the total up to the sum.
    """
    left = sampling.samples // 2
    size = _FIRST_ROUND if sampling.error is not None else left
    while left:
        size = 1 << (min(size, left).bit_length() - 1)
        yield size
        left -= size
        if sampling.error is not None:
            size = max(size, sampling.samples // 2 - left)
