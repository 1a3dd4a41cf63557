"""What frames cost: measured where they, or others of their scenes, were rendered before; estimated elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from lookdev.codegen import ShaderSource, Source
from lookdev.plan.chunks import Costs
from lookdev.plan.plan import Plan
from lookdev.rendering.task import SceneTask

# Seconds on two cores; what counts is how they compare. tests/bench/farm_costs.py measures them.
_USUAL_SAMPLES = 256  # that frames with a target error take
_SAMPLE = 1e-6  # of a sample of a pixel without bounces
_BOUNCE = 0.5  # of it, for each bounce
_FRAME = 0.15  # of a frame besides
_DIRECTIONS = 8  # that a look usually takes at a hit, of its BSDF and of the light
_SHARED = 0.25  # of a sample's cost, whatever the directions
_TRANSMITTING = 1.8  # times the cost of a look that only reflects: paths go on inside
SCENE = 1.3
"""Seconds to prepare a scene."""
START = 4.0
"""Seconds of a process to its first frame, but for what preparing the scene takes."""


def estimated(plan: Plan) -> Costs:
    """Return the costs of a plan's frames by the job alone, whatever is on disk."""
    scenes = [frame.task.scene for frame in plan.frames]
    return Costs(tuple(filled(scenes, [None] * len(scenes))), SCENE, START)


def measured(plan: Plan) -> Costs:
    """Return the costs of a plan's frames.

    Those on disk have their times in their headers. A scene's mean stands for its other frames; for scenes of which
    there are none, the estimate, in the ratio that measured scenes have to theirs.
    """
    scenes = [frame.task.scene for frame in plan.frames]
    return Costs(tuple(filled(scenes, [frame.seconds for frame in plan.frames])), SCENE, START)


def filled(scenes: Sequence[SceneTask], measured: Sequence[float | None]) -> list[float]:
    """Return the cost of each frame: its time where it was measured, else that of its scene."""
    known: dict[int, list[float]] = {}
    for scene, seconds in zip(scenes, measured, strict=True):
        of_scene = known.setdefault(id(scene), [])
        if seconds is not None:
            of_scene.append(seconds)
    guessed = {id(scene): estimate(scene) for scene in {id(scene): scene for scene in scenes}.values()}
    taken = [(fmean(each), guessed[scene]) for scene, each in known.items() if each]
    ratio = sum(seconds for seconds, _ in taken) / sum(guess for _, guess in taken) if taken else 1.0
    usual = {scene: fmean(each) if each else ratio * guessed[scene] for scene, each in known.items()}
    return [usual[id(scene)] if seconds is None else seconds for scene, seconds in zip(scenes, measured, strict=True)]


def estimate(scene: SceneTask) -> float:
    """Return the cost of a frame by what is rendered, seconds."""
    sampling, (width, height) = scene.sampling, scene.resolution
    samples = sampling.samples if sampling.error is None else min(sampling.samples, _USUAL_SAMPLES)
    look = fmean(_of_look(source) for source in scene.shaders)
    return _FRAME + _SAMPLE * width * height * samples * (1.0 + _BOUNCE * sampling.bounces) * look


def _of_look(source: Source) -> float:
    """Return the cost of a look's samples in that of a usual one's."""
    cost = 1.0
    if isinstance(source, ShaderSource):
        cost = _SHARED + (1.0 - _SHARED) * sum(source.directions) / _DIRECTIONS
    return cost * (_TRANSMITTING if source.transmits else 1.0)
