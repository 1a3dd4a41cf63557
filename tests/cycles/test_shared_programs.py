"""Looks that differ in numbers alone share their shaders, and have the pictures of shaders of their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from frames import POSE, orbit_camera

from lookdev.asset import Asset, Instance, Slot, make_asset
from lookdev.asset.builtin import make_sphere
from lookdev.codegen.osl.share import shared_programs
from lookdev.light import Dome
from lookdev.material import Layer, Look
from lookdev.render.results import Rendered
from lookdev.render.scene import scene_task
from lookdev.render.task import SceneTask, one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Sampling, Scene

pytestmark = pytest.mark.cycles


@pytest.fixture(scope="module")
def balls() -> Asset:
    """Three balls of two parts: one of the first, two instances of the second, of which one is mirrored."""
    ball = make_sphere(segments=32, rings=16).meshes[0]
    meshes = [replace(ball, face_slots=np.full_like(ball.face_slots, slot)) for slot in (0, 1)]
    places = [np.eye(4) for _ in range(3)]
    for place, x in zip(places, (-2.2, 0.0, 2.2), strict=True):
        place[0, 3] = x
    places[2][1, 1] = -1.0
    instances = [Instance(number, place) for number, place in zip((0, 1, 1), places, strict=True)]
    return make_asset("balls", meshes, instances, [Slot("/a", "/a"), Slot("/b", "/b")])


def look(name: str, roughness: float, color: tuple[float, float, float], coat: float) -> Look:
    values = {"roughness": roughness, "baseColor": color, "clearcoat": coat, "metallic": 0.3}
    dust = Layer("dust", "disney", {"baseColor": color[::-1], "roughness": 0.9}, mask=0.5 * coat)
    return Look(name, (Layer("base", "disney", values), dust))


LOOKS = [
    (look("a", 0.3, (0.8, 0.2, 0.1), 0.4), look("b", 0.6, (0.1, 0.5, 0.7), 0.9)),
    (look("c", 0.5, (0.4, 0.7, 0.1), 0.7), look("d", 0.2, (0.6, 0.5, 0.4), 0.2)),
]


@pytest.fixture(scope="module")
def scenes(balls: Asset, light_of: Callable[[str], Dome]) -> list[SceneTask]:
    """The scenes of two pairs of looks, one program for all four."""
    camera = orbit_camera(balls.center, balls.radius)
    shown = [Scene.of_look(balls, pair[0], light_of("studio"), (64, 32), camera) for pair in LOOKS]
    shown = [replace(each, wears={"/a": a, "/b": b}) for each, (a, b) in zip(shown, LOOKS, strict=True)]
    tasks = [scene_task(scene, Sampling(samples=16), "exact") for scene in shown]
    shared = shared_programs(shader for task in tasks for shader in task.shaders)
    tasks = [replace(task, shaders=tuple(shared[each] for each in task.shaders)) for task in tasks]
    assert len({shader.program for task in tasks for shader in task.shaders}) == 1
    return tasks


def rendered(worker: Worker, scene: SceneTask) -> Rendered:
    worker.start()
    return worker.render(one_frame(scene, POSE, "frame"), lambda progress: None)


def test_shared_programs_show_the_pictures_of_own_ones(worker: Worker, scenes: list[SceneTask]) -> None:
    own = [replace(scene, shaders=tuple(replace(each, varying=()) for each in scene.shaders)) for scene in scenes]
    expected = [rendered(worker, scene) for scene in own]
    # Shown in one scene that is built once: first its own looks, then others, then its own again.
    found = [rendered(worker, scenes[number]) for number in (0, 1, 0)]
    assert np.array_equal(found[0].a, found[2].a)
    for ours, theirs in zip(found, (expected[0], expected[1], expected[0]), strict=True):
        assert ours.alpha.any()
        # Another order of the same operations rounds otherwise.
        np.testing.assert_allclose(ours.a, theirs.a, rtol=2e-5, atol=1e-6)
    # The looks differ visibly, on each part.
    assert (np.abs(found[0].a - found[1].a).max(axis=(0, 2)).reshape(4, -1).max(axis=1)[[0, 1, 2]] > 0.05).all()
