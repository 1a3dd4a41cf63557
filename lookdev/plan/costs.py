"""What frames cost, before they are rendered."""

from __future__ import annotations

from collections.abc import Sequence

from lookdev.plan.chunks import Costs
from lookdev.render.task import SceneTask

_USUAL_SAMPLES = 256  # that frames with a target error take
_PER_SAMPLE = 2e-6  # seconds of a sample of a pixel, a slot for each look on two cores
_FRAME = 0.2  # seconds of a frame besides
_SCENE = 4.0  # to prepare a scene
_START = 6.0  # of a process, to its first frame


def estimated(scenes: Sequence[SceneTask]) -> Costs:
    """Return the costs of frames by their scenes alone: what every machine finds for a job."""
    known: dict[int, float] = {}
    for scene in scenes:
        if id(scene) not in known:
            known[id(scene)] = _of_frame(scene)
    return Costs(tuple(known[id(scene)] for scene in scenes), _SCENE, _START)


def _of_frame(scene: SceneTask) -> float:
    width, height = scene.resolution
    sampling = scene.sampling
    samples = sampling.samples if sampling.error is None else min(sampling.samples, _USUAL_SAMPLES)
    return _FRAME + _PER_SAMPLE * width * height * samples * (1.0 + 0.5 * sampling.bounces)
