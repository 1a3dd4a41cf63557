"""The costs of frames in seconds, for the division of a plan and the time left of a run.

A cost is measured if the frame, or another frame of its scene, has been rendered before; otherwise it is estimated.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from lookdev.codegen.source import GeneratedSource, ShaderSource
from lookdev.plan.chunks import Costs
from lookdev.plan.plan import Plan
from lookdev.rendering.task import SceneTask

# These times are for two cores; only their ratios matter. tests/bench/farm_costs.py measures them.
_USUAL_SAMPLES = 256  # the typical number of samples per pixel of a frame with a target error
_SAMPLE = 1e-6  # seconds for one sample of one pixel without bounces
_BOUNCE = 0.5  # the cost of a bounce, relative to such a sample
_FRAME = 0.15  # seconds of a frame that do not depend on its samples
_DIRECTIONS = 8  # the typical number of directions at a shading point, from the BSDF and from the light together
_SHARED = 0.25  # the share of a sample's cost that does not depend on the number of directions
_TRANSMITTING = 1.8  # the cost of a look that transmits, relative to a reflecting look: paths go on inside
SCENE_SECONDS = 1.3
"""The time to prepare a scene."""
START_SECONDS = 4.0
"""The time from the start of a process to its first frame, without the preparation of the scene."""


def estimate_costs(plan: Plan) -> Costs:
    """Return the costs of a plan, estimated from the job alone, without use of files on disk."""
    scenes = [frame.task.scene for frame in plan.frames]
    return Costs(tuple(frame_costs(scenes, [None] * len(scenes))), SCENE_SECONDS, START_SECONDS)


def measure_costs(plan: Plan) -> Costs:
    """Return the costs of a plan, measured where possible.

    The cost of a frame on disk is the time in its header. Other frames of the same scene have the mean of these times.
    If no frame of a scene is on disk, its frames have the estimated cost, scaled by the ratio of measured to estimated
    costs of the other scenes.
    """
    scenes = [frame.task.scene for frame in plan.frames]
    return Costs(tuple(frame_costs(scenes, [frame.seconds for frame in plan.frames])), SCENE_SECONDS, START_SECONDS)


def frame_costs(scenes: Sequence[SceneTask], times: Sequence[float | None]) -> list[float]:
    """Return the cost of each frame in seconds, from the scene and the measured time of each frame.

    A time is None if it is unknown. The cost is then computed as in `measure_costs`.
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
    """Return the estimated cost of a frame of a scene, in seconds."""
    sampling, (width, height) = scene.sampling, scene.resolution
    samples = sampling.samples if sampling.error is None else min(sampling.samples, _USUAL_SAMPLES)
    look = fmean(_look_cost(source) for source in scene.shaders)
    return _FRAME + _SAMPLE * width * height * samples * (1.0 + _BOUNCE * sampling.bounces) * look


def _look_cost(source: GeneratedSource) -> float:
    """Return the cost of a sample of a look, relative to a look that reflects in `_DIRECTIONS` directions."""
    cost = 1.0
    if isinstance(source, ShaderSource):
        cost = _SHARED + (1.0 - _SHARED) * sum(source.directions) / _DIRECTIONS
    return cost * (_TRANSMITTING if source.transmits else 1.0)
