"""Single frames of any asset, light and camera from the warm worker, and their comparison."""

from collections.abc import Callable
from typing import Any

from lookdev.asset import Asset
from lookdev.light import EnvironmentMap, prepare_light
from lookdev.material import Look
from lookdev.rendering.results import ProgressMessage, WorkerFrame
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import FrameTask, frame_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Camera, Pose, Sampling, Scene

# Samples of the light alone keep the generated shader, and its compilation, small.
SAMPLES = 16


class Stage:
    """Frames of a worker; `render` is one frame."""

    def __init__(self, worker: Worker) -> None:
        self.worker = worker

    def render(
        self, *given: Any, progress: Callable[[ProgressMessage], None] = lambda progress: None, **more: Any
    ) -> WorkerFrame:
        """Render the frame of `task`."""
        self.worker.start()
        return self.worker.render(self.task(*given, **more), progress)

    def task(
        self,
        asset: Asset,
        look: Look,
        light: EnvironmentMap,
        camera: Camera,
        pose: Pose = Pose(0.0, 0.0),  # noqa: B008  (frozen)
        resolution: tuple[int, int] = (80, 80),
        samples: int = SAMPLES,
        seed: int = 0,
        ibl_samples: int = 2,
    ) -> FrameTask:
        sampling = Sampling(samples, brdf_samples=2, ibl_samples=ibl_samples, bounces=1, seed=seed)
        dome = prepare_light(light, sampled=ibl_samples > 0)
        scene = Scene.of_look(asset, look, dome, resolution, camera)
        return frame_task(scene_task(scene, sampling), pose, "d1ge57")


def difference(one: WorkerFrame, other: WorkerFrame) -> float:
    """Return the squared difference of two pictures over the noise of their halves: near 1 for equal scenes."""
    squares = ((one.a + one.b) - (other.a + other.b)) ** 2 / 4.0
    noise = ((one.a - one.b) ** 2 + (other.a - other.b) ** 2) / 4.0
    return float(squares.sum() / noise.sum())
