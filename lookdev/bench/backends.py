"""What renders a cell: each backend in a warm process of its own, so that its memory is its own too."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

from lookdev.asset import Asset, save_asset
from lookdev.batch.prepare import make_scene
from lookdev.bench.looks import LOOKS, BenchLook
from lookdev.bench.matrix import OURS, SCENES, Cell, Options
from lookdev.bench.measure import Candidate
from lookdev.bench.reference import Shot
from lookdev.codegen import PrincipledSource
from lookdev.job import JobRender
from lookdev.job.schema import Backend
from lookdev.light import Dome, EnvironmentMap, load_environment, prepare_light
from lookdev.plan import frame_sampling
from lookdev.plan.digest import RENDER_VERSION, blender_version
from lookdev.plan.skips import Skip, scene_skips
from lookdev.render.task import FrameTask, SceneTask
from lookdev.render.worker import WORKER_COMMAND, Rendered, renderer
from lookdev.scene.camera import Pose
from lookdev.scene.framing import frame_camera
from lookdev.scene.sampling import Sampling

COMMANDS: dict[str, Sequence[str]] = {
    **dict.fromkeys(OURS, WORKER_COMMAND),
    "principled": WORKER_COMMAND,
    "mitsuba": (sys.executable, "-m", "lookdev.bench.mitsuba_worker"),
}
PATIENCE = 3600.0
"""Seconds. A part of a reference is one long frame, and says nothing before its end in some backends."""

POSE = Pose(0.0, 0.0)


@cache
def bench_asset(scene: str) -> Asset:
    """Return the asset of a scene, made once."""
    return SCENES[scene].make()


@cache
def bench_environment(ibl: str) -> EnvironmentMap:
    """Return a built-in map, read once."""
    return load_environment(builtin=ibl)


@cache
def bench_light(ibl: str) -> Dome:
    """Return a built-in light, prepared once."""
    return prepare_light(bench_environment(ibl))


def bench_scene(
    asset: Asset, look: BenchLook, light: Dome, resolution: int, bounces: int, backend: Backend = "exact"
) -> SceneTask:
    """Return the scene for one of our backends, sampled as a job does that says nothing of it."""
    size = (resolution, resolution)
    camera = frame_camera(asset.center, asset.radius, size)
    sampling = frame_sampling(JobRender(bounces=bounces))
    slots = [look.make()] * len(asset.slots)
    return make_scene(asset, save_asset(asset), slots, light, camera, size, sampling, backend)


def sampled(sampling: Sampling, samples: int, seed: int) -> Sampling:
    """Return the sampling with so many samples, whatever error they leave."""
    return replace(sampling, samples=samples, error=None, seed=seed)


@contextmanager
def open_candidates(cell: Cell, options: Options) -> Iterator[list[Candidate]]:
    """Start a process for each backend that can render the cell, and end them all."""
    asset = bench_asset(cell.scene)
    look = LOOKS[cell.look]
    ours = {
        backend: bench_scene(
            asset, look, bench_light(cell.ibl), options.resolution, SCENES[cell.scene].bounces, backend
        )
        for backend in OURS
        if backend == "exact" or backend in options.backends
    }
    with ExitStack() as stack:
        candidates = []
        for backend in options.backends_of(cell):
            scene = ours[backend] if backend in ours else with_principled(ours["exact"], look)
            render = stack.enter_context(renderer(COMMANDS[backend], PATIENCE))

            def shoot(
                samples: int,
                seed: int,
                scene: SceneTask = scene,
                render: Callable[[FrameTask], Rendered] = render,
            ) -> Shot:
                here = replace(scene, sampling=sampled(scene.sampling, samples, seed))
                return shot_of(render(FrameTask(here, POSE, 0.0, f"{samples}.{seed}", (Path("frame.exr"),), {})))

            key = picture_key(backend, scene, look, bench_environment(cell.ibl))
            candidates.append(Candidate(backend, key, shoot, skips_of(cell, scene) if backend in ours else ()))
        yield candidates


def skips_of(cell: Cell, scene: SceneTask) -> tuple[str, ...]:
    """Say what a scene of ours leaves out because nobody would see it, and why."""
    looks = [LOOKS[cell.look].make()] * len(scene.shaders)
    found = scene_skips(scene, looks, JobRender(bounces=SCENES[cell.scene].bounces))
    return tuple(str(Skip(cell.look, cell.ibl, what, why)) for what, why in found)


def with_principled(scene: SceneTask, look: BenchLook) -> SceneTask:
    """Return the scene with Cycles' Principled BSDF in all slots, lit by Cycles itself."""
    assert look.principled is not None, "only such looks are asked for"
    source = PrincipledSource("principled", dict(look.principled))
    return replace(scene, shaders=(source,) * len(scene.shaders))


def shot_of(rendered: Rendered) -> Shot:
    """Return what is measured of a frame: the mean of its halves."""
    return Shot(
        (rendered.a + rendered.b) * np.float32(0.5), rendered.alpha, rendered.seconds, rendered.memory, rendered.blender
    )


def picture_key(backend: str, scene: SceneTask, look: BenchLook, light: EnvironmentMap) -> str:
    """Name all that a picture depends on, and nothing of how it is sampled or how the shader is written.

    So a change of the sampling, or of the code, is measured against the reference from before it: a picture that
    changed with it has a bias.
    """
    shown = repr(look.make()) if backend in OURS else json.dumps(look.principled, sort_keys=True)
    parts = {
        "asset": scene.asset_file.stem,
        "light": light.digest,
        "camera": asdict(scene.camera),
        "pose": asdict(POSE),
        "resolution": scene.resolution,
        "bounces": scene.sampling.bounces,
        "look": hashlib.sha256(shown.encode()).hexdigest(),
        "backend": backend,
        "version": version("mitsuba") if backend == "mitsuba" else f"{blender_version()} {RENDER_VERSION}",
    }
    return json.dumps(parts, sort_keys=True)
