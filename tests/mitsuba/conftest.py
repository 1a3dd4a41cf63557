"""Frames of scenes from the warm worker of Mitsuba."""

import pytest
from mitsuba_scenes import RenderSeeds

from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import SceneTask, frame_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Pose, Sampling, Scene


@pytest.fixture(scope="session")
def worker(mitsuba_worker: Worker) -> Worker:
    return mitsuba_worker


@pytest.fixture(scope="session")
def render_seeds(mitsuba_worker: Worker) -> RenderSeeds:
    """Return a function that renders frames of a scene, of seeds from 0 on."""

    def render(scene: Scene | SceneTask, pose: Pose, seeds: int, **sampling: object) -> list[WorkerFrame]:
        task = scene if isinstance(scene, SceneTask) else scene_task(scene, Sampling(**sampling), "mitsuba")  # type: ignore[arg-type]
        mitsuba_worker.start()
        frames = (frame_task(task, pose, f"{seed}", seed=seed) for seed in range(seeds))
        return [mitsuba_worker.render(frame, lambda progress: None) for frame in frames]

    return render
