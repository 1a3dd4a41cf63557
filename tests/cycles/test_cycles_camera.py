"""Cameras in Cycles: frames of any camera agree with the reference, and a turned asset covers what it is framed to."""

from __future__ import annotations

import numpy as np
import pytest

from lookdev.asset import Asset, load_asset
from lookdev.asset.silhouette import outline
from lookdev.asset.store import make_asset
from lookdev.checks.finding import Finding
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.light import Dome
from lookdev.material import Layer, Look
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels
from lookdev.render.results import Rendered
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Camera, Lens, Pose, Sampling, Scene, frame_fill

pytestmark = pytest.mark.cycles

POSE = Pose(30.0, 75.0)
SIZE, SAMPLES, SEEDS, BOUNCES = (48, 36), 32, 12, 2
PAINT = Look("paint", (Layer("Base", "disney", {"baseColor": (0.6, 0.3, 0.2), "roughness": 0.4}),))
LACE = Look("lace", (Layer("Base", "pixar", {"surfaceColor": (0.6, 0.3, 0.2), "roughness": 0.4, "presence": 0.5}),))


def cameras(asset: Asset) -> dict[str, Camera]:
    (x, y, z), r = asset.center, asset.radius
    tilted = {"azimuth": 50.0, "roll": 25.0, "axis": (x + 0.3 * r, y + 0.2 * r), "shift": (0.1, -0.07)}
    aside = (x + 0.2 * r, y - 0.1 * r, z + 0.1 * r)
    return {
        "tilted": Camera(40.0, 15.0, aside, 3.5 * r, **tilted),
        "on its side": Camera(40.0, 0.0, asset.center, 3.5 * r, roll=90.0),
        "lens": Camera(30.0, 20.0, asset.center, 4.2 * r, lens=Lens(0.5 * r, 3.6 * r)),
        "tilted lens": Camera(40.0, 15.0, aside, 3.5 * r, **tilted, lens=Lens(0.6 * r, 3.0 * r)),
    }


def shot(worker: Worker, scene: Scene, pose: Pose, backend: str = "exact", **sampling: int) -> Rendered:
    worker.start()
    task = scene_task(scene, Sampling(brdf_samples=2, ibl_samples=4, **sampling), backend)
    return worker.render(one_frame(task, pose, "camera"), lambda progress: None)


@pytest.mark.parametrize(
    ("name", "look"), [("tilted", PAINT), ("on its side", PAINT), ("tilted lens", PAINT), ("lens", LACE)]
)
def test_a_frame_agrees_with_the_reference(name: str, look: Look, worker: Worker, light_of) -> None:
    asset, light = load_asset(builtin="suzanne"), light_of("forest")
    camera = cameras(asset)[name]
    scene = Scene.of_look(asset, look, light, SIZE, camera)
    frames = [shot(worker, scene, POSE, samples=SAMPLES, bounces=BOUNCES, seed=seed) for seed in range(SEEDS)]
    found = agreement(frames, asset, look, light, camera)
    assert found.passed, "\n".join((found.summary, *found.details))
    # Another camera, as one without its lens, its shift or its axis, shows another picture.
    plain = Camera(camera.fov, camera.elevation, camera.target, camera.distance, camera.azimuth)
    assert not agreement(frames, asset, look, light, plain).passed


def agreement(frames: list[Rendered], asset: Asset, look: Look, light: Dome, camera: Camera) -> Finding:
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    alpha = np.mean([frame.alpha for frame in frames], axis=0)
    pixels = choose_pixels(alpha, 100, seed=1)
    scene = MeshScene(asset, [look] * len(asset.slots))
    reference = frame_pixels(scene, [light], camera, POSE, SIZE, pixels, bounces=BOUNCES)
    return check_frame(asset.name, halves, alpha, SEEDS * SAMPLES, pixels, reference)


@pytest.mark.parametrize("name", ["tilted", "tilted lens"])
def test_every_backend_has_the_same_camera(name: str, worker: Worker, light_of) -> None:
    asset = load_asset(builtin="suzanne")
    scene = Scene.of_look(asset, PAINT, light_of("white"), SIZE, cameras(asset)[name])
    exact, *others = (
        shot(worker, scene, POSE, backend, samples=1024, bounces=0).alpha
        for backend in ("exact", "nodes", "nodes-exact")
    )
    for alpha in others:
        # The standard error of 1024 samples of a coverage is at most 1/64 of a pixel; both have one.
        assert np.abs(alpha - exact).max() < 5.0 * np.sqrt(2.0) / 64.0


def stretched(asset: Asset, *scale: float) -> Asset:
    instance = asset.instances[0]
    matrix = np.diag([*scale, 1.0]) @ instance.matrix
    return make_asset("stretched", asset.meshes, [type(instance)(instance.mesh, matrix)], asset.slots)


@pytest.mark.parametrize(
    ("name", "scale", "elevation"),
    [
        ("suzanne", (1.0, 1.0, 1.0), 20.0),
        ("plane", (10.0, 1.0, 0.02), 0.0),
        ("plane", (1.0, 1.0, 1.0), 10.0),
        ("sphere", (1.0, 2.0, 0.01), -35.0),
    ],
)
def test_a_turntable_covers_what_it_is_framed_to(name: str, scale, elevation: float, worker: Worker, light_of) -> None:
    asset, size, frames = stretched(load_asset(builtin=name), *scale), (100, 80), 40
    camera = frame_fill(outline(asset), size, elevation=elevation)
    scene = Scene.of_look(asset, PAINT, light_of("white"), size, camera)
    alphas = [
        shot(worker, scene, Pose(360.0 * number / frames, 0.0), samples=16, bounces=0).alpha for number in range(frames)
    ]
    rows, columns = np.nonzero(np.max(alphas, axis=0) > 0.0)
    width, height = (np.ptp(each) + 1 for each in (columns, rows))
    assert width == pytest.approx(70, abs=1) or height == pytest.approx(56, abs=1)
    assert width <= 71
    assert height <= 57
    # Equal margins, to a pixel.
    assert abs(columns.min() + columns.max() - 99) <= 1
    assert abs(rows.min() + rows.max() - 79) <= 1
