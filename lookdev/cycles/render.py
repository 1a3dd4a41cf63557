"""Renders a frame by Cycles: its rounds of samples, its denoiser, and its passes. The worker calls `render_frame`."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial

import numpy as np

from lookdev.arrays import Floats32
from lookdev.codegen.osl.catching import ASSET, BARE, GROUND
from lookdev.cycles import engine
from lookdev.cycles.passes import (
    RecordingPlan,
    prepare_recording,
    read_recorded,
    render_frame_passes,
)
from lookdev.cycles.scene import ALBEDOS, NORMALS, BlenderScene
from lookdev.rendering.adaptive import Region
from lookdev.rendering.catcher import combine_catcher_halves
from lookdev.rendering.frame import (
    FEATURE_SAMPLES,
    Denoiser,
    RenderedFrame,
    ReportSamples,
    combine_halves,
    half_of_seed,
    render_halves,
)
from lookdev.rendering.oidn import make_denoiser
from lookdev.rendering.passes import channels_of_passes
from lookdev.rendering.task import FrameTask
from lookdev.scene import Sampling


def render_frame(scene: BlenderScene, task: FrameTask, progress: ReportSamples) -> RenderedFrame:
    """Render one frame of a task in a scene that shows the task's scene."""
    started = time.perf_counter()
    scene.pose(task.scene.camera, task.pose)
    if scene.is_principled:
        return _render_principled(scene, task.scene.sampling, progress)
    engine.fill_sample_table(scene.scene)
    overhead = time.perf_counter() - started  # seconds that `render_halves` does not measure
    with prepare_recording(scene, task) as plan:
        render = partial(_render_region, scene, task, plan)
        combine = combine_catcher_halves if task.scene.has_catcher else combine_halves
        frame = render_halves(task, render, partial(_make_denoiser, scene, task), progress, combine)
    beauty = 0.5 * (frame.a + frame.b) if frame.raw is None else frame.raw
    frame = replace(frame, passes=task.scene.complete_parts(frame.passes, beauty))
    arrays: dict[str, Floats32] = {}
    names: dict[str, tuple[str, ...]] = {}
    if {*channels_of_passes(task.scene.sampling.passes, task.scene.light_group_names)} - {*frame.passes}:
        passes_start = time.perf_counter()
        arrays, names = render_frame_passes(scene, task, frame)
        overhead += time.perf_counter() - passes_start
    return frame.with_passes(arrays, names, overhead)


def _render_catcher_parts(
    scene: BlenderScene, samples: int, seed: int, box: engine.PixelBounds | None
) -> tuple[Floats32, Floats32, dict[str, Floats32]]:
    """Render a region of a frame with a shadow catcher, as `_render_region`, but in three renders.

    The renders show the asset, the ground with the asset, and the ground without the asset. The returned parts are the
    parts that `combine_catcher_halves` reads. Both renders of the ground have the same samples. Pixels of the ground
    that the asset does not change are therefore equal in every bit.
    """
    pictures = {}
    for part in (ASSET, GROUND, BARE):
        scene.select_catcher_part(part)
        pictures[part] = engine.render_passes(scene.scene, samples, seed, box)["Combined"][::-1]
    color, coverage = (pictures[ASSET][..., i] + pictures[GROUND][..., i] for i in (slice(3), 3))
    covered = np.repeat(pictures[GROUND][..., 3:], 3, axis=-1)
    return color, coverage, {"ground": pictures[GROUND][..., :3], "bare": pictures[BARE][..., :3], "covered": covered}


def _render_principled(scene: BlenderScene, sampling: Sampling, progress: ReportSamples) -> RenderedFrame:
    """Render a frame as a user of Cycles would: in one render, which is denoised with Cycles' own guides."""
    started = time.perf_counter()
    image = engine.render_whole(scene.scene, sampling.samples, sampling.seed)["Combined"][::-1]
    progress(sampling.samples, sampling.samples, None)
    rgb, alpha = np.ascontiguousarray(image[:, :, :3]), np.ascontiguousarray(image[:, :, 3])
    seconds = time.perf_counter() - started
    if sampling.denoise == "off":
        return RenderedFrame(rgb, rgb, alpha, sampling.samples, seconds, math.nan)
    features = engine.render_features(scene.scene, FEATURE_SAMPLES)
    albedo, normal = (features[f"Denoising {name}"][::-1] for name in ("Albedo", "Normal"))
    smooth = make_denoiser(albedo, normal)(rgb)
    denoised_seconds = time.perf_counter() - started
    return RenderedFrame(smooth, smooth, alpha, sampling.samples, denoised_seconds, math.nan, rgb, math.nan, seconds)


def _make_denoiser(scene: BlenderScene, task: FrameTask) -> Denoiser:
    """Render the albedos and normals of a frame, and return a denoiser that they guide."""

    def render_feature(feature: float) -> Floats32:
        """Render `NORMALS` or `ALBEDOS`, (H, W, 4)."""
        scene.set_controls(task.pose, 0, feature)
        return engine.render_passes(scene.scene, FEATURE_SAMPLES)["Combined"][::-1]

    # The render shows normals encoded in [0, 1], premultiplied, and black where there is no surface.
    normals = render_feature(NORMALS)
    return make_denoiser(render_feature(ALBEDOS)[..., :3], 2.0 * normals[..., :3] - normals[..., 3:])


def _render_region(
    scene: BlenderScene, task: FrameTask, plan: RecordingPlan, seed: int, region: Region
) -> tuple[Floats32, Floats32, dict[str, Floats32]]:
    """Render a region: return its colours (h, w, 3), its coverage (h, w), and recorded parts of the colours by name."""
    scene.set_controls(task.pose, seed, region.samples)
    # Blender counts rows from the bottom.
    height = task.scene.resolution[1]
    rows, columns = region.rows, region.columns
    box = None if region.is_whole_frame else (columns.start, height - rows.stop, columns.stop, height - rows.start)
    if task.scene.has_catcher:
        return _render_catcher_parts(scene, region.samples, seed, box)
    parts: dict[str, Floats32] = {}
    batches = plan[half_of_seed(seed)]
    # All batches render the same light, apart from noise: the last bits of a path's positions encode the data that the
    # path records, and the noise of later hits depends on those bits. The returned colours must be from the first
    # batch, so it is rendered last.
    for batch in reversed(batches or [()]):
        if task.scene.sampling.records_parts:
            scene.select_recorded_parts([number for _, number in batch])
        passes = engine.render_passes(scene.scene, region.samples, seed, box)
        parts |= read_recorded(batch, passes)
    color = passes["Combined"][::-1]
    return color[..., :3], passes["UV"][::-1, :, 2] if scene.has_portals else color[..., 3], parts
