"""Frames of Cycles."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial

import numpy as np

from lookdev.codegen.osl.catching import ASSET, BARE, GROUND
from lookdev.cycles import engine
from lookdev.cycles.passes import Passes, Plan, completed, record_of, recording, render_frame_passes
from lookdev.cycles.scene import ALBEDOS, NORMALS, Scene
from lookdev.rendering.adaptive import Region
from lookdev.rendering.catcher import caught_pictures
from lookdev.rendering.frame import (
    FEATURE_SAMPLES,
    Denoiser,
    Image,
    Progress,
    RenderedFrame,
    half_of,
    plain_pictures,
    render_halves,
)
from lookdev.rendering.oidn import denoiser
from lookdev.rendering.passes import arrays_of
from lookdev.rendering.task import FrameTask
from lookdev.scene import Sampling


def render_frame(scene: Scene, task: FrameTask, progress: Progress) -> RenderedFrame:
    """Render one frame of a scene."""
    started = time.perf_counter()
    scene.pose(task.scene.camera, task.pose)
    if scene.by_user:
        return _frame_of_user(scene, task.scene.sampling, progress)
    engine.fill_tables(scene.scene)
    before = time.perf_counter() - started
    with recording(scene, task) as plan:
        render = partial(_rendered, scene, task, plan)
        pictures = caught_pictures if task.scene.catches else plain_pictures
        frame = render_halves(task, render, partial(_denoiser, scene, task), progress, pictures)
    frame = replace(frame, passes=completed(task, frame))
    made = Passes({}, {})
    if {*arrays_of(task.scene.sampling.passes, task.scene.names_of_light)} - {*frame.passes}:
        begun = time.perf_counter()
        made = render_frame_passes(scene, task, frame.alpha, frame.samples)
        before += time.perf_counter() - begun
    return replace(
        frame,
        seconds=frame.seconds + before,
        passes={**frame.passes, **made.arrays},
        names=made.names,
        raw_seconds=None if frame.raw_seconds is None else frame.raw_seconds + before,
    )


def _caught(scene: Scene, samples: int, seed: int, box: engine.Box | None) -> tuple[Image, Image, dict[str, Image]]:
    """Return what `_rendered` does, with the parts of which `caught_pictures` makes a frame.

    The samples of the ground are the same with the asset and without: what it does not change differs in no bit.
    """
    shown = {}
    for part in (ASSET, GROUND, BARE):
        scene.catch(part)
        shown[part] = engine.render_passes(scene.scene, samples, seed, box)["Combined"][::-1]
    color, coverage = (shown[ASSET][..., i] + shown[GROUND][..., i] for i in (slice(3), 3))
    covered = np.repeat(shown[GROUND][..., 3:], 3, axis=-1)
    return color, coverage, {"ground": shown[GROUND][..., :3], "bare": shown[BARE][..., :3], "covered": covered}


def _frame_of_user(scene: Scene, sampling: Sampling, progress: Progress) -> RenderedFrame:
    started = time.perf_counter()
    image = engine.render_whole(scene.scene, sampling.samples, sampling.seed)["Combined"][::-1]
    progress(sampling.samples, sampling.samples, None)
    rgb, alpha = np.ascontiguousarray(image[:, :, :3]), np.ascontiguousarray(image[:, :, 3])
    seconds = time.perf_counter() - started
    if sampling.denoise == "off":
        return RenderedFrame(rgb, rgb, alpha, sampling.samples, seconds, math.nan)
    features = engine.render_features(scene.scene, FEATURE_SAMPLES)
    albedo, normal = (features[f"Denoising {name}"][::-1] for name in ("Albedo", "Normal"))
    smooth = denoiser(albedo, normal)(rgb)
    taken = time.perf_counter() - started
    return RenderedFrame(smooth, smooth, alpha, sampling.samples, taken, math.nan, rgb, math.nan, seconds)


def _denoiser(scene: Scene, task: FrameTask) -> Denoiser:
    """Return a denoiser that is guided by the albedos and normals of the frame."""

    def shown(feature: float) -> Image:
        scene.control(task.pose, 0, feature)
        return engine.render_passes(scene.scene, FEATURE_SAMPLES)["Combined"][::-1]

    # Normals are shown in [0, 1], and black where there is no surface.
    normals = shown(NORMALS)
    return denoiser(shown(ALBEDOS)[..., :3], 2.0 * normals[..., :3] - normals[..., 3:])


def _rendered(
    scene: Scene, task: FrameTask, plan: Plan, seed: int, region: Region
) -> tuple[Image, Image, dict[str, Image]]:
    """Return the colours and the coverage of a region, and the recorded parts of colours."""
    scene.control(task.pose, seed, region.samples)
    # Blender counts rows from the bottom.
    height = task.scene.resolution[1]
    rows, columns = region.rows, region.columns
    box = None if region.whole else (columns.start, height - rows.stop, columns.stop, height - rows.start)
    if task.scene.catches:
        return _caught(scene, region.samples, seed, box)
    parts: dict[str, Image] = {}
    batches = plan[half_of(seed)]
    # Reversed, as the light is that of the first: what paths carry is in the last bits of the places that they reach,
    # which the noise of later hits depends on.
    for batch in reversed(batches or [()]):
        if task.scene.sampling.recorded:
            scene.record([number for _, number in batch])
        passes = engine.render_passes(scene.scene, region.samples, seed, box)
        parts |= record_of(batch, passes)
    color = passes["Combined"][::-1]
    return color[..., :3], passes["UV"][::-1, :, 2] if scene.by_portals else color[..., 3], parts
