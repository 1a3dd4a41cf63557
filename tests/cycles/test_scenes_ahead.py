"""A worker that has shown something else renders the same picture, to the bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from frames import POSE, orbit_camera

from lookdev.asset import Asset, Instance, load_asset, make_asset
from lookdev.asset.builtin import make_sphere
from lookdev.light import Dome
from lookdev.material import Layer, Look
from lookdev.render.backends import WORKER_COMMAND
from lookdev.render.results import Rendered
from lookdev.render.scene import scene_task
from lookdev.render.task import SceneTask, one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Sampling, Scene

pytestmark = pytest.mark.cycles

LOOK = Look("grey", (Layer("Grey", "disney", {"roughness": 0.5}),))
SIZE = (24, 24)


@pytest.fixture
def new_worker(tmp_path: Path) -> Iterator[Callable[[], Worker]]:
    with ExitStack() as stack:
        yield lambda: stack.enter_context(Worker(WORKER_COMMAND, tmp_path / "worker.log", tmp_path, 300.0))


@pytest.fixture
def assets() -> tuple[Asset, Asset]:
    """Return a card, and balls beside one another, which are instances."""
    card, ball = load_asset(builtin="plane"), make_sphere(segments=32, rings=16)
    places = np.eye(4) + np.array([[[0, 0, 0, x], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]] for x in (-1.0, 0.5)])
    instances = [Instance(0, place) for place in places]
    return make_asset("card", card.meshes, card.instances, card.slots), make_asset(
        "balls", ball.meshes, instances, ball.slots
    )


def scene_of(asset: Asset, light: Dome, backend: str, look: Look = LOOK) -> SceneTask:
    scene = Scene.of_look(asset, look, light, SIZE, orbit_camera(asset.center, asset.radius))
    return scene_task(scene, Sampling(samples=4), backend)


def render(worker: Worker, scene: SceneTask) -> Rendered:
    worker.start()
    return worker.render(one_frame(scene, POSE, "frame"), lambda progress: None)


def assert_same(one: Rendered, other: Rendered) -> None:
    for name in ("a", "b", "alpha"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert one.alpha.any()


@pytest.mark.parametrize("backend", ["exact", "nodes", "nodes-exact"])
def test_another_asset_in_the_same_look_needs_no_new_worker(
    new_worker: Callable[[], Worker], assets: tuple[Asset, Asset], light_of: Callable[[str], Dome], backend: str
) -> None:
    card, balls = (scene_of(asset, light_of("studio"), backend) for asset in assets)
    worker = new_worker()
    first, second, third = (render(worker, scene) for scene in (card, balls, card))
    assert_same(first, third)
    assert_same(second, render(new_worker(), balls))


@pytest.mark.parametrize("backend", ["exact", "nodes", "nodes-exact"])
def test_another_look_or_light_needs_no_new_worker(
    new_worker: Callable[[], Worker], assets: tuple[Asset, Asset], light_of: Callable[[str], Dome], backend: str
) -> None:
    red = Look("red", (Layer("Red", "pixar", {"surfaceColor": (0.6, 0.1, 0.1)}),))
    studio, city = light_of("studio"), light_of("city")
    scenes = [scene_of(assets[1], *each) for each in ((studio, backend), (studio, backend, red), (city, backend, red))]
    worker = new_worker()
    shown = [render(worker, scene) for scene in (*scenes, scenes[0])]
    assert_same(shown[0], shown[3])
    for scene, found in zip(scenes, shown, strict=False):
        assert_same(found, render(new_worker(), scene))


def test_a_scene_that_was_prepared_shows_in_no_picture(
    new_worker: Callable[[], Worker], assets: tuple[Asset, Asset], light_of: Callable[[str], Dome]
) -> None:
    card, balls = (scene_of(asset, light_of("studio"), "exact") for asset in assets)
    plain = render(new_worker(), balls)
    for ahead in (card, balls, replace(card, asset=replace(card.asset, digest="0" * 64))):  # the last has no asset
        worker = new_worker()
        worker.launch()
        worker.prepare(ahead)
        assert_same(render(worker, balls), plain)
