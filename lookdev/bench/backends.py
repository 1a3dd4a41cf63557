"""The renderers of a cell: each backend in a separate warm process, whose memory is measured."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np

from lookdev.arrays import Floats32
from lookdev.bench.benchmark import OpenRenderer, RenderFrame, open_process
from lookdev.bench.measure import Candidate
from lookdev.bench.options import Cell, Options
from lookdev.bench.reference import Render, Shot
from lookdev.bench.subjects import LOOKS, POSE, SCENES, bench_asset, bench_lights, bench_scene, picture_key
from lookdev.plan.skips import Skip, scene_skips
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.results import Rendered
from lookdev.rendering.task import SceneTask, frame_task
from lookdev.scene import Pose, Sampling


@contextmanager
def open_candidates(cell: Cell, options: Options, opened: OpenRenderer = open_process) -> Iterator[list[Candidate]]:
    """Start a process for each backend that can render the cell, and end them all."""
    asset, look = bench_asset(cell.scene), LOOKS[cell.look].make()
    lights, bounces = bench_lights(cell.ibl, asset), SCENES[cell.scene].bounces
    with ExitStack() as stack:
        candidates = []
        for backend in options.backends_of(cell):
            scene = bench_scene(asset, look, lights, options.resolution, bounces, backend, denoise=options.denoise)
            shoot = shooter(stack.enter_context(opened()), scene)
            key, denoises = picture_key(scene, look, cell.ibl), BACKENDS[backend].features
            candidates.append(Candidate(backend, key, shoot, skips_of(cell, scene), denoises))
        yield candidates


def shooter(render: RenderFrame, scene: SceneTask, pose: Pose = POSE) -> Render:
    """Return a function that renders a scene, raw unless it is told otherwise."""

    def shoot(samples: int, seed: int, **sampling: Any) -> Shot:
        fields = {"samples": samples, "seed": seed, "error": None, "denoise": "off", **sampling}
        return shot_of(render(frame_task(scene, pose, f"{samples}.{seed}", **fields)))

    return shoot


def skips_of(cell: Cell, scene: SceneTask) -> tuple[str, ...]:
    """Return the skips of a scene, and why; none for backends that no job may name."""
    if not BACKENDS[scene.backend].in_jobs:
        return ()
    looks = [LOOKS[cell.look].make()] * len(scene.worn)
    skips = scene_skips(scene, looks, Sampling(bounces=SCENES[cell.scene].bounces))
    return tuple(str(Skip(cell.look, cell.ibl, skipped, reason)) for skipped, reason in skips)


def shot_of(rendered: Rendered) -> Shot:
    """Return the mean of a frame's halves, with its figures."""

    def shot(image: Floats32, seconds: float, estimate: float | None, raw: Shot | None = None) -> Shot:
        known = None if estimate is None or math.isnan(estimate) else estimate
        figures = rendered.memory, rendered.blender, rendered.samples
        return Shot(image, rendered.alpha, seconds, *figures, known, raw)

    raw = None
    if rendered.raw is not None and rendered.raw_seconds is not None:
        raw = shot(rendered.raw, rendered.raw_seconds, rendered.raw_relmse)
    return shot((rendered.a + rendered.b) * np.float32(0.5), rendered.seconds, rendered.relmse, raw)
