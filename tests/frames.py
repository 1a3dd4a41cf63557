"""How frames of simple scenes are seen in these tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from lookdev.asset import Asset, load_asset
from lookdev.light import Light
from lookdev.material import Layer, Look
from lookdev.render.results import Rendered
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Camera, Pose, Sampling, Scene

RenderScene = Callable[..., Rendered]

POSE = Pose(30.0, 75.0)


def orbit_camera(center: tuple[float, float, float], radius: float) -> Camera:
    """Return a camera that sees a bounding sphere whole."""
    return Camera(30.0, 20.0, center, 4.2 * radius)


def frames_of(worker: Worker, default: str = "exact") -> RenderScene:
    """Return a function that renders layers, the same over all of an asset or of a built-in one."""

    def render_one(
        which: str | Asset, layers: Sequence[Layer], light: Light, *, pose=POSE, size=48, backend=default, **given: Any
    ) -> Rendered:
        asset = load_asset(builtin=which) if isinstance(which, str) else which
        look, camera = Look("look", tuple(layers)), orbit_camera(asset.center, asset.radius)
        sampling = Sampling(**{"brdf_samples": 2, "ibl_samples": 4} | given)
        scene = scene_task(Scene.of_look(asset, look, light, (size, size), camera), sampling, backend)
        worker.start()
        return worker.render(one_frame(scene, pose, asset.name), lambda progress: None)

    return render_one
