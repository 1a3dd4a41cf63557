"""A frame: two independent halves, in rounds until they reach the target error, denoised if that is wanted."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookdev.cycles import engine
from lookdev.cycles.scene import ALBEDOS, NORMALS, Scene
from lookdev.metrics import relmse_of_halves
from lookdev.render.adaptive import Half, Region, mean_samples, next_round
from lookdev.render.denoise import Denoised, denoised
from lookdev.render.oidn import denoiser
from lookdev.render.task import FrameTask
from lookdev.scene import Sampling

Image = NDArray[np.float32]

# Seeds of one frame's rounds and halves: those of neighbouring `seed` values never coincide.
_SEEDS_PER_FRAME = 64
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
    if sampling.error is not None:
        engine.fill_tables(scene.scene)
    halves = Half(width, height, gain), Half(width, height, gain)
    a = b = alpha = np.zeros(0)
    error = raw_error = math.inf
    before = time.perf_counter()
    smooth = _denoiser(scene, task) if sampling.denoise != "off" else None
    denoising = time.perf_counter() - before
    result: Denoised | None = None
    done = number = 0
    while any(regions := next_round(sampling, halves, number, error)):
        for which, half in enumerate(halves):
            seed = sampling.seed * _SEEDS_PER_FRAME + 2 * number + which
            for region in regions[which]:
                half.add(region, *_rendered(scene, task, seed, region))
            done = round(2.0 * mean_samples(halves))
            progress(done, sampling.samples, error if number else None)
        number += 1
        a, b, alpha = halves[0].color, halves[1].color, 0.5 * (halves[0].alpha + halves[1].alpha)
        error = raw_error = relmse_of_halves(a * gain, b * gain, alpha)
        if smooth is not None:
            before = time.perf_counter()
            result = denoised(a * gain, b * gain, alpha, smooth)
            error = result.relmse
            denoising += time.perf_counter() - before
        progress(done, sampling.samples, error)
    raw = None if result is None else (0.5 * (a + b)).astype(np.float32)
    if result is not None:
        a, b = result.a / gain, result.b / gain
    shown = (a.astype(np.float32), b.astype(np.float32), alpha.astype(np.float32))
    seconds = time.perf_counter() - started
    if result is None:
        return RenderedFrame(*shown, done, seconds, error)
    return RenderedFrame(*shown, done, seconds, error, raw, raw_error, seconds - denoising)


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


def _rendered(scene: Scene, task: FrameTask, seed: int, region: Region) -> tuple[Image, Image]:
    """Return the colours and the coverage of a region."""
    scene.control(task.pose, seed, region.samples)
    # Blender counts rows from the bottom.
    height = task.scene.resolution[1]
    rows, columns = region.rows, region.columns
    box = None if region.whole else (columns.start, height - rows.stop, columns.stop, height - rows.start)
    passes = engine.render_passes(scene.scene, region.samples, seed, box)
    color = passes["Combined"][::-1]
    return color[..., :3], passes["UV"][::-1, :, 2] if scene.by_portals else color[..., 3]
