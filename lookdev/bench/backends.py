"""The renderers of a cell: each backend in a separate warm process, whose memory is measured."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, replace
from functools import cache
from typing import Any

import numpy as np

from lookdev.arrays import Floats32
from lookdev.asset import Asset
from lookdev.bench.looks import LOOKS
from lookdev.bench.matrix import SCENES, Cell, Options
from lookdev.bench.measure import Candidate
from lookdev.bench.reference import Shot
from lookdev.bench.rigs import RIGS
from lookdev.light import Dome, EnvironmentMap, Light, load_environment, prepare_light
from lookdev.material import Look
from lookdev.plan.skips import Skip, scene_skips
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.results import Rendered
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import FrameTask, SceneTask, frame_task
from lookdev.rendering.worker import open_renderer
from lookdev.scene import Pose, Sampling, Scene

PATIENCE = 3600.0
"""Seconds. A part of a reference is one long frame, for which some backends report no progress."""

POSE = Pose(0.0, 0.0)


@cache
def bench_asset(scene: str) -> Asset:
    """Return the asset of a scene."""
    return SCENES[scene].make()


@cache
def bench_environment(ibl: str) -> EnvironmentMap:
    """Return a built-in map."""
    return load_environment(builtin=ibl)


@cache
def bench_light(ibl: str) -> Dome:
    """Return a built-in light."""
    return prepare_light(bench_environment(ibl))


def bench_lights(name: str, asset: Asset) -> tuple[Light, ...]:
    """Return the lights of a built-in map or of a rig around an asset."""
    return RIGS[name].around(asset) if name in RIGS else (bench_light(name),)


def bench_scene(
    asset: Asset,
    look: Look,
    lights: Sequence[Light],
    resolution: int,
    bounces: int,
    backend: str = "exact",
    *,
    denoise: bool = False,
) -> SceneTask:
    """Return a scene of one look, with the default sampling; `denoise` where its backend can, else never."""
    scene = Scene.of_look(asset, look, lights[0], (resolution, resolution))
    denoised = denoise and BACKENDS[backend].features
    sampling = Sampling(bounces=bounces, denoise="measured" if denoised else "off")
    return scene_task(replace(scene, lights=tuple(lights)), sampling, backend)


@contextmanager
def open_candidates(cell: Cell, options: Options) -> Iterator[list[Candidate]]:
    """Start a process for each backend that can render the cell, and end them all."""
    asset, look = bench_asset(cell.scene), LOOKS[cell.look].make()
    lights = bench_lights(cell.ibl, asset)
    with ExitStack() as stack:
        candidates = []
        for backend in options.backends_of(cell):
            bounces = SCENES[cell.scene].bounces
            scene = bench_scene(asset, look, lights, options.resolution, bounces, backend, denoise=options.denoise)
            render = stack.enter_context(open_renderer(PATIENCE))

            def shoot(
                samples: int,
                seed: int,
                scene: SceneTask = scene,
                render: Callable[[FrameTask], Rendered] = render,
                **sampling: Any,
            ) -> Shot:
                chosen = {"samples": samples, "seed": seed, "denoise": "off", **sampling}
                return shot_of(render(frame_task(scene, POSE, f"{samples}.{seed}", **chosen)))

            key = picture_key(scene, look, cell.ibl)
            denoises = BACKENDS[backend].features
            candidates.append(Candidate(backend, key, shoot, skips_of(cell, scene), denoises))
        yield candidates


def skips_of(cell: Cell, scene: SceneTask) -> tuple[str, ...]:
    """Return the skips of a scene, and why; none for backends that no job may name."""
    if not BACKENDS[scene.backend].in_jobs:
        return ()
    looks = [LOOKS[cell.look].make()] * len(scene.worn)
    found = scene_skips(scene, looks, Sampling(bounces=SCENES[cell.scene].bounces))
    return tuple(str(Skip(cell.look, cell.ibl, what, why)) for what, why in found)


def shot_of(rendered: Rendered) -> Shot:
    """Return the mean of a frame's halves, with its figures."""
    image = (rendered.a + rendered.b) * np.float32(0.5)

    def shot(image: Floats32, seconds: float, estimate: float | None, raw: Shot | None = None) -> Shot:
        known = None if estimate is None or math.isnan(estimate) else estimate
        figures = rendered.memory, rendered.blender, rendered.samples
        return Shot(image, rendered.alpha, seconds, *figures, known, raw)

    if rendered.raw is None or rendered.raw_seconds is None:
        return shot(image, rendered.seconds, rendered.relmse)
    return shot(image, rendered.seconds, rendered.relmse, shot(rendered.raw, rendered.raw_seconds, rendered.raw_relmse))


def picture_key(scene: SceneTask, look: Look, ibl: str) -> str:
    """Return a text of all that a picture depends on, without its sampling and the code of its shader.

    So a change of sampling or code is measured against the reference from before it, and a changed picture is a bias.
    """
    # The tables by which a map is sampled are left out.
    light = [each.digest for each in scene.lights] if ibl in RIGS else bench_environment(ibl).digest
    parts = {
        "asset": scene.asset.digest,
        "light": light,
        "camera": asdict(scene.camera),
        "pose": asdict(POSE),
        "resolution": scene.resolution,
        "bounces": scene.sampling.bounces,
        "look": hashlib.sha256(repr(look).encode()).hexdigest(),
        "backend": scene.backend,
        "version": BACKENDS[scene.backend].version(),
    }
    return json.dumps(parts, sort_keys=True)
