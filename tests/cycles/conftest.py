"""A warm render worker, and frames of simple scenes from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from frames import POSE, RenderScene, orbit_camera

from lookdev.asset import Asset, load_asset
from lookdev.light import Dome, load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.render.backends import WORKER_COMMAND
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.worker import Rendered, Worker
from lookdev.scene import Sampling, Scene


@pytest.fixture(scope="session")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    folder = tmp_path_factory.mktemp("worker")
    with Worker(WORKER_COMMAND, folder / "worker.log", folder, 300.0) as process:
        yield process


@pytest.fixture(scope="session")
def light_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Dome]:
    """Return a function that prepares a built-in light, or ``slopes``.

    The colour of ``slopes`` varies slowly, by a factor of three: unsampled, small lamps make noise that is not
    Student's. Its first and last row are alike: at a pole Cycles' world interpolates between them.
    """
    azimuth, height = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 129)[:-1], np.linspace(1.0, -1.0, 64))
    channels = (1.0 + 0.5 * np.sin(azimuth), 1.0 + 0.5 * np.cos(azimuth), 1.0 + 0.5 * np.cos(np.pi * height))
    slopes = tmp_path_factory.mktemp("light") / "slopes.exr"
    assert oiio.ImageBuf(np.stack(channels, axis=-1).astype(np.float32)).write(str(slopes))
    return lambda name: prepare_light(load_environment(slopes) if name == "slopes" else load_environment(builtin=name))


@pytest.fixture(scope="session")
def render(worker: Worker) -> RenderScene:
    """Return a function that renders layers, the same over all of an asset or of a built-in one."""

    def render_one(
        which: str | Asset, layers: Sequence[Layer], light: Dome, *, pose=POSE, size=48, backend="exact", **given: Any
    ) -> Rendered:
        asset = load_asset(builtin=which) if isinstance(which, str) else which
        look, camera = Look("look", tuple(layers)), orbit_camera(asset.center, asset.radius)
        sampling = Sampling(**{"brdf_samples": 2, "ibl_samples": 4} | given)
        scene = scene_task(Scene.of_look(asset, look, light, (size, size), camera), sampling, backend)
        worker.start()
        return worker.render(one_frame(scene, pose, asset.name), lambda progress: None)

    return render_one
