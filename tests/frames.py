"""Renders frames of simple scenes for tests, by a render worker: one asset, one look, a standard pose and camera."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from lookdev.asset import Asset, load_asset
from lookdev.codegen.source import ShaderSource
from lookdev.light import Light
from lookdev.material import Layer, Look
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import frame_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Camera, Film, Pose, Sampling, Scene

RenderScene = Callable[..., WorkerFrame]

POSE = Pose(30.0, 75.0)


def orbit_camera(center: tuple[float, float, float], radius: float) -> Camera:
    """Return a camera that sees all of a bounding sphere."""
    return Camera(30.0, 20.0, center, 4.2 * radius)


def scene_of(asset: Asset, look: Look, lights: Sequence[Light], size: int) -> Scene:
    """Return a scene whose slots all have one look, in a square frame."""
    looks = {slot.path: look for slot in asset.slots}
    return Scene(asset, looks, tuple(lights), orbit_camera(asset.center, asset.radius), Film((size, size)))


def render_seeds(
    worker: Worker,
    scene: Scene,
    seeds: Sequence[int] = (0,),
    *,
    pose: Pose = POSE,
    backend: str = "exact",
    alter: Callable[[str], str] | None = None,
    **sampling: Any,
) -> list[WorkerFrame]:
    """Render a frame with each seed; `sampling` are fields of `Sampling`.

    `alter` gets the text of a generated shader, and returns the text to run in its place.
    """
    task = scene_task(scene, Sampling(**sampling), backend)
    if alter is not None:
        shaders = [
            replace(shader, osl=alter(shader.osl)) for shader in task.shaders if isinstance(shader, ShaderSource)
        ]
        task = replace(task, shaders=tuple(shaders))
    worker.start()
    return [
        worker.render(frame_task(task, pose, f"{scene.asset.name} {seed}", seed=seed), lambda progress: None)
        for seed in seeds
    ]


def replaced(given: str, planted: str) -> Callable[[str], str]:
    """Return a function that replaces `given` by `planted`, a fault, in the text of a shader."""

    def alter(osl: str) -> str:
        assert given in osl
        return osl.replace(given, planted)

    return alter


def frames_of(worker: Worker, default: str = "exact") -> RenderScene:
    """Return a function that renders an asset, or the built-in asset with a name, with the same layers everywhere."""

    def render_one(
        shape: str | Asset, layers: Sequence[Layer], light: Light, *, pose=POSE, size=48, backend=default, **fields: Any
    ) -> WorkerFrame:
        asset = load_asset(builtin=shape) if isinstance(shape, str) else shape
        look, camera = Look("look", tuple(layers)), orbit_camera(asset.center, asset.radius)
        sampling = Sampling(**{"brdf_samples": 2, "ibl_samples": 4} | fields)
        scene = scene_task(Scene.of_look(asset, look, light, (size, size), camera), sampling, backend)
        worker.start()
        return worker.render(frame_task(scene, pose, asset.name), lambda progress: None)

    return render_one
