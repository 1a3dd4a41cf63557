"""A task runs where only the files that it names have been copied to the cache, as on another machine."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.asset import load_asset
from lookdev.material import Layer, Look, Texture
from lookdev.render.backends import job_backends
from lookdev.render.results import Rendered
from lookdev.render.scene import scene_task
from lookdev.render.task import contents, one_frame
from lookdev.render.worker import renderer
from lookdev.scene import Pose, Sampling, Scene

pytestmark = pytest.mark.cycles


@pytest.mark.parametrize("backend", job_backends())
def test_a_task_needs_only_its_contents(
    backend: str, light_of, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pixels = np.random.default_rng(7).integers(40, 255, (16, 16, 3)).astype(np.uint8)
    assert oiio.ImageBuf(pixels).write(str(tmp_path / "color.png"))
    chips = Texture(tmp_path / "color.png", "rgb", "sRGB")
    look = Look("chips", (Layer("Base", "disney", {"baseColor": chips, "roughness": 0.6}),))
    scene = Scene.of_look(load_asset(builtin="suzanne"), look, light_of("studio"), (24, 24))
    task = one_frame(scene_task(scene, Sampling(samples=4), backend), Pose(30.0, 75.0), "frame")

    def render() -> Rendered:
        with renderer() as render:
            return render(task)

    here = render()
    store = tmp_path / "cache" / "content"
    store.mkdir(parents=True)
    for content in contents(task):
        shutil.copyfile(content.path, store / content.path.name)
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    there = render()
    assert here.a[here.alpha == 1.0].mean() > 0.01
    for one, other in ((here.a, there.a), (here.b, there.b), (here.alpha, there.alpha)):
        np.testing.assert_allclose(other, one, rtol=1e-5, atol=1e-6)
