"""Workers and scenes: a picture depends neither on earlier scenes, nor on shared shaders, nor on the machine."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from frames import POSE, orbit_camera
from frames import scene_of as framed

from lookdev.asset import Asset, Instance, Slot, load_asset, make_asset
from lookdev.asset.builtin import make_sphere
from lookdev.codegen.source import shared_programs
from lookdev.light import Dome
from lookdev.material import Layer, Look, Texture
from lookdev.rendering.backends import WORKER_COMMAND, job_backends
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import FrameTask, SceneTask, files_of_task, frame_task
from lookdev.rendering.worker import Worker, open_renderer
from lookdev.scene import Sampling, Scene

pytestmark = pytest.mark.cycles


GREY, RED = (
    Look(name, (Layer(name, "lambert", {"reflectance": color}),))
    for name, color in (("grey", (0.5, 0.5, 0.5)), ("red", (0.6, 0.1, 0.1)))
)


@pytest.fixture
def new_worker(tmp_path: Path) -> Iterator[Callable[[], Worker]]:
    with ExitStack() as stack:
        yield lambda: stack.enter_context(Worker(WORKER_COMMAND, tmp_path / "worker.log", tmp_path, 300.0))


@pytest.fixture(scope="module")
def scenes(light_of: Callable[[str], Dome]) -> dict[str, SceneTask]:
    """Return scenes of every backend that differ in asset, look or light: a card, and balls, which are instances."""
    plane, ball = load_asset(builtin="plane"), make_sphere(segments=32, rings=16)
    matrices = np.eye(4) + np.array([[[0, 0, 0, x], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]] for x in (-1.0, 0.5)])
    card = make_asset("card", plane.meshes, plane.instances, plane.slots)
    balls = make_asset("balls", ball.meshes, [Instance(0, matrix) for matrix in matrices], ball.slots)
    cases = [(card, GREY, "slopes"), (balls, GREY, "slopes"), (balls, RED, "slopes"), (balls, RED, "city")]
    return {
        f"{backend} {asset.name} {look.name} {light}": scene_task(
            framed(asset, look, (light_of(light),), 24), Sampling(samples=4), backend
        )
        for backend in ("exact", "nodes", "nodes-exact")
        # Nodes take a second for each look: everything changes between two scenes.
        for asset, look, light in (cases if backend == "exact" else cases[::3])
    }


def render(worker: Worker, scene: SceneTask) -> WorkerFrame:
    worker.start()
    return worker.render(frame_task(scene, POSE, "frame"), lambda progress: None)


def assert_same(one: WorkerFrame, other: WorkerFrame, label: str) -> None:
    for name in ("a", "b", "alpha"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), (label, name)
    assert one.alpha.any()


@pytest.mark.parametrize(
    "backends", [("exact", "nodes"), pytest.param(("exact", "nodes", "nodes-exact"), marks=pytest.mark.proof)]
)
def test_a_scene_shows_in_no_picture_of_another(
    backends: tuple[str, ...], worker: Worker, new_worker: Callable[[], Worker], scenes: dict[str, SceneTask]
) -> None:
    """The scenes before a scene differ between two workers; a new worker has none before its first."""
    order, other = [name for name in scenes if name.partition(" ")[0] in backends], new_worker()
    first = {name: render(worker, scenes[name]) for name in order}
    assert_same(render(worker, scenes[order[0]]), first[order[0]], f"{order[0]} again")
    # Scenes next to each other in the first order are not so in this one.
    for name in (name for start in range(5) for name in order[::-1][start::5]):
        assert_same(render(other, scenes[name]), first[name], name)


def test_a_scene_that_was_prepared_shows_in_no_picture(
    worker: Worker, new_worker: Callable[[], Worker], scenes: dict[str, SceneTask]
) -> None:
    card, balls = (scenes[f"exact {name} grey slopes"] for name in ("card", "balls"))
    plain = render(worker, balls)
    other = new_worker()
    other.launch()
    for ahead in (replace(card, asset=replace(card.asset, digest="0" * 64)), card):  # the first has no asset
        other.prepare(ahead)
    assert_same(render(other, balls), plain, "prepared")


@pytest.fixture(scope="module")
def balls() -> Asset:
    """Return three balls of two parts: one of the first, two instances of the second, one of them mirrored."""
    ball = make_sphere(segments=32, rings=16).meshes[0]
    meshes = [replace(ball, face_slots=np.full_like(ball.face_slots, slot)) for slot in (0, 1)]
    matrices = [np.eye(4) for _ in range(3)]
    for matrix, x in zip(matrices, (-2.2, 0.0, 2.2), strict=True):
        matrix[0, 3] = x
    matrices[2][1, 1] = -1.0
    instances = [Instance(number, matrix) for number, matrix in zip((0, 1, 1), matrices, strict=True)]
    return make_asset("balls", meshes, instances, [Slot("/a", "/a"), Slot("/b", "/b")])


def look(name: str, roughness: float, color: tuple[float, float, float], coat: float) -> Look:
    values = {"roughness": roughness, "baseColor": color, "clearcoat": coat, "metallic": 0.3}
    dust = Layer("dust", "disney", {"baseColor": color[::-1], "roughness": 0.9}, mask=0.5 * coat)
    return Look(name, (Layer("base", "disney", values), dust))


PAIRS = [
    (look("a", 0.3, (0.8, 0.2, 0.1), 0.4), look("b", 0.6, (0.1, 0.5, 0.7), 0.9)),
    (look("c", 0.5, (0.4, 0.7, 0.1), 0.7), look("d", 0.2, (0.6, 0.5, 0.4), 0.2)),
]


@pytest.fixture(scope="module")
def paired_scenes(balls: Asset, light_of: Callable[[str], Dome]) -> list[SceneTask]:
    """Return the scenes of two pairs of looks, with one program for all four looks."""
    camera = orbit_camera(balls.center, balls.radius)
    pair_scenes = [Scene.of_look(balls, pair[0], light_of("slopes"), (64, 32), camera) for pair in PAIRS]
    pair_scenes = [
        replace(scene, look_of_slot={"/a": a, "/b": b}) for scene, (a, b) in zip(pair_scenes, PAIRS, strict=True)
    ]
    tasks = [scene_task(scene, Sampling(samples=16), "exact") for scene in pair_scenes]
    shared = shared_programs(shader for task in tasks for shader in task.shaders)
    tasks = [replace(task, shaders=tuple(shared[shader] for shader in task.shaders)) for task in tasks]
    assert len({shader.program for task in tasks for shader in task.shaders}) == 1
    return tasks


def test_shared_programs_show_the_pictures_of_own_ones(worker: Worker, paired_scenes: list[SceneTask]) -> None:
    shaders = [tuple(replace(shader, varying=()) for shader in scene.shaders) for scene in paired_scenes]
    constant_scenes = [
        replace(scene, shaders=scene_shaders) for scene, scene_shaders in zip(paired_scenes, shaders, strict=True)
    ]
    expected = [render(worker, scene) for scene in constant_scenes]
    # Shown in one scene that is built once: first its own looks, then others, then its own again.
    frames = [render(worker, paired_scenes[number]) for number in (0, 1, 0)]
    assert np.array_equal(frames[0].a, frames[2].a)
    for ours, theirs in zip(frames, (expected[0], expected[1], expected[0]), strict=True):
        assert ours.alpha.any()
        # Another order of the same operations rounds otherwise.
        np.testing.assert_allclose(ours.a, theirs.a, rtol=2e-5, atol=1e-6)
    # The looks differ visibly, on each part.
    assert (np.abs(frames[0].a - frames[1].a).max(axis=(0, 2)).reshape(4, -1).max(axis=1)[[0, 1, 2]] > 0.05).all()


@pytest.mark.parametrize(
    "backends",
    [("exact", "nodes"), pytest.param(tuple(job_backends()), marks=pytest.mark.proof)],
    ids=["Cycles", "all"],
)
def test_a_task_needs_only_its_contents(
    backends: Sequence[str], light_of, tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    pixels = np.random.default_rng(7).integers(40, 255, (16, 16, 3)).astype(np.uint8)
    assert oiio.ImageBuf(pixels).write(str(tmp_path / "color.png"))
    chips = Texture(tmp_path / "color.png", "rgb", "sRGB")
    look = Look("chips", (Layer("Base", "disney", {"baseColor": chips, "roughness": 0.6}),))
    scene = Scene.of_look(load_asset(builtin="suzanne"), look, light_of("slopes"), (24, 24))
    tasks = [frame_task(scene_task(scene, Sampling(samples=4), backend), POSE, backend) for backend in backends]

    def render_here(task: FrameTask) -> WorkerFrame:
        worker: Worker = request.getfixturevalue(f"{'mitsuba' if task.scene.backend == 'mitsuba' else 'cycles'}_worker")
        worker.start()
        return worker.render(task, lambda progress: None)

    here = [render_here(task) for task in tasks]
    store = tmp_path / "cache" / "content"
    store.mkdir(parents=True)
    for content in {content for task in tasks for content in files_of_task(task)}:
        shutil.copyfile(content.path, store / content.path.name)
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    with open_renderer() as render_there:
        there = [render_there(task) for task in tasks]
    for task, ours, theirs in zip(tasks, here, there, strict=True):
        assert ours.a[ours.alpha == 1.0].mean() > 0.01
        for one, other in ((ours.a, theirs.a), (ours.b, theirs.b), (ours.alpha, theirs.alpha)):
            np.testing.assert_allclose(other, one, rtol=1e-5, atol=1e-6, err_msg=task.scene.backend)
