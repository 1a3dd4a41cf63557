"""A scene that takes the constants of another renders what that one would, bit for bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from frames import POSE

from lookdev.asset import load_asset
from lookdev.material import Layer, Look
from lookdev.render.scene import scene_task
from lookdev.render.task import SceneTask, one_frame
from lookdev.scene import Sampling, Scene

pytestmark = pytest.mark.mitsuba


@pytest.fixture
def task_of(llvm: str, light_of):
    light, asset = light_of("city"), load_asset(builtin="suzanne")

    def made(**inputs) -> SceneTask:
        base = {"baseColor": (0.5, 0.35, 0.2), "roughness": 0.3, "metallic": 0.4, **inputs}
        scene = Scene.of_look(asset, Look("edited", (Layer("base", "disney", base),)), light, (24, 18))
        return scene_task(scene, Sampling(samples=8, passes=("direct",)), "mitsuba")

    return made


def test_constants_are_taken_and_other_programs_are_not(task_of) -> None:
    from lookdev.mitsuba.load import load_mitsuba
    from lookdev.mitsuba.render import MitsubaScene

    mi, first, edited = load_mitsuba("cpu"), task_of(), task_of(roughness=0.7, baseColor=(0.1, 0.45, 0.25))

    def pictures(scene: MitsubaScene, task: SceneTask):
        frame = scene.render(one_frame(task, POSE, "frame"), lambda *progress: None)
        return np.stack([frame.a, frame.b, frame.passes["direct"]])

    scene = MitsubaScene(mi, first)
    before = pictures(scene, first)
    assert scene.take(edited)
    after = pictures(scene, edited)
    assert np.array_equal(after, pictures(MitsubaScene(mi, edited), edited))
    assert np.abs(after - before).max() > 0.01
    # A clear coat is another program; another size is none.
    assert not scene.take(task_of(clearcoat=1.0))
    assert np.array_equal(after, pictures(scene, edited))
    small = replace(edited, resolution=(12, 9))
    assert scene.fits(small)
    assert np.array_equal(pictures(scene, small), pictures(MitsubaScene(mi, small), small))
