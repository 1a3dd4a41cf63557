"""The costs of frames: measured if they or others of their scenes were rendered before, otherwise estimated."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from lookdev.codegen.source import GeneratedSource, ShaderSource
from lookdev.plan.chunks import Costs
from lookdev.plan.plan import Plan
from lookdev.rendering.task import SceneTask

# Seconds on two cores; only their ratios matter. tests/bench/farm_costs.py measures them.
_USUAL_SAMPLES = 256  # samples a pixel of a frame with a target error
_SAMPLE = 1e-6  # seconds of a sample of a pixel without bounces
_BOUNCE = 0.5  # cost of a bounce, relative to that sample
_FRAME = 0.15  # seconds of a frame that do not depend on its samples
_DIRECTIONS = 8  # usual number of directions of a look at a hit, of its BSDF and of the light together
_SHARED = 0.25  # share of a sample's cost that does not depend on the directions
_TRANSMITTING = 1.8  # cost of a look that transmits, relative to one that only reflects: paths go on inside
SCENE_SECONDS = 1.3
"""Seconds to prepare a scene."""
START_SECONDS = 4.0
"""Seconds from the start of a process to its first frame, without those that prepare the scene."""


def estimate_costs(plan: Plan) -> Costs:
    """Return the costs of a plan's frames, estimated from the job alone; files on disk do not count."""
    scenes = [frame.task.scene for frame in plan.frames]
    return Costs(tuple(frame_costs(scenes, [None] * len(scenes))), SCENE_SECONDS, START_SECONDS)


def measure_costs(plan: Plan) -> Costs:
    """Return the costs of a plan's frames, measured where possible.

    A frame on disk costs the time in its header, and another frame of its scene the mean of these times. A frame of a
    scene without frames on disk costs its estimate, scaled by the ratio of times to estimates of the other scenes.
    """
    scenes = [frame.task.scene for frame in plan.frames]
    return Costs(tuple(frame_costs(scenes, [frame.seconds for frame in plan.frames])), SCENE_SECONDS, START_SECONDS)


def frame_costs(scenes: Sequence[SceneTask], times: Sequence[float | None]) -> list[float]:
    """Return the cost of each frame, seconds: its time, or if that is None the cost of a frame of its scene.

    That is the mean of the scene's times, or, without any, its estimate scaled as in `measure_costs`.
    """
    scene_times: dict[int, list[float]] = {}
    for scene, seconds in zip(scenes, times, strict=True):
        seconds_of_scene = scene_times.setdefault(id(scene), [])
        if seconds is not None:
            seconds_of_scene.append(seconds)
    estimates = {id(scene): estimate(scene) for scene in {id(scene): scene for scene in scenes}.values()}
    means = {key: fmean(seconds) for key, seconds in scene_times.items() if seconds}
    ratio = sum(means.values()) / sum(estimates[key] for key in means) if means else 1.0
    scene_costs = {key: means[key] if key in means else ratio * estimates[key] for key in scene_times}
    return [
        scene_costs[id(scene)] if seconds is None else seconds for scene, seconds in zip(scenes, times, strict=True)
    ]


def estimate(scene: SceneTask) -> float:
    """Return the estimated cost of a frame of a scene, seconds."""
    sampling, (width, height) = scene.sampling, scene.resolution
    samples = sampling.samples if sampling.error is None else min(sampling.samples, _USUAL_SAMPLES)
    look = fmean(_look_cost(source) for source in scene.shaders)
    return _FRAME + _SAMPLE * width * height * samples * (1.0 + _BOUNCE * sampling.bounces) * look


def _look_cost(source: GeneratedSource) -> float:
    """Return the cost of a sample of a look, relative to that of a usual look."""
    cost = 1.0
    if isinstance(source, ShaderSource):
        cost = _SHARED + (1.0 - _SHARED) * sum(source.directions) / _DIRECTIONS
    return cost * (_TRANSMITTING if source.transmits else 1.0)
