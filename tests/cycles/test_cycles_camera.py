"""Cameras in Cycles: frames of any camera agree with the reference, and a rotating asset fills its framing."""

from dataclasses import replace

import numpy as np
import pytest
from agreement import assert_scene_agreement, check_scene
from frames import render_seeds
from looks import quick_among

from lookdev.asset import Asset, load_asset, make_asset
from lookdev.asset.silhouette import hull_points
from lookdev.material import Layer, Look
from lookdev.rendering.worker import Worker
from lookdev.scene import Camera, Lens, Pose, Scene, frame_fill

pytestmark = pytest.mark.cycles

SAMPLING = {"brdf_samples": 2, "ibl_samples": 4}
SIZE, SAMPLES, SEEDS, BOUNCES = (48, 36), 32, 12, 2
PAINT = Look("paint", (Layer("Base", "disney", {"baseColor": (0.6, 0.3, 0.2), "roughness": 0.4}),))
BLACK = Look("black", (Layer("Base", "lambert", {"reflectance": (0.0, 0.0, 0.0)}),))
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


SHOTS = [("tilted", PAINT), ("on its side", PAINT), ("tilted lens", PAINT), ("lens", LACE)]


@pytest.mark.parametrize(("name", "look"), quick_among(SHOTS, [("tilted lens", PAINT)]))
def test_a_frame_agrees_with_the_reference(name: str, look: Look, worker: Worker, light_of, stored_reference) -> None:
    # In light that changes slowly, lace out of focus shows next to nothing of its lens.
    asset, light = load_asset(builtin="suzanne"), light_of("forest" if look is LACE else "slopes")
    camera = cameras(asset)[name]
    scene = Scene.of_look(asset, look, light, SIZE, camera)
    frames = render_seeds(worker, scene, range(SEEDS), **SAMPLING, samples=SAMPLES, bounces=BOUNCES)
    assert_scene_agreement(f"camera {name}", frames, scene, SAMPLES, stored_reference, bounces=BOUNCES)
    # Another camera, as one without its lens, its shift or its axis, shows another picture.
    plain = Camera(camera.fov, camera.elevation, camera.target, camera.distance, camera.azimuth)
    wrong, other = replace(scene, camera=plain), f"camera not {name}"
    assert not check_scene(other, frames, wrong, SAMPLES, stored_reference, bounces=BOUNCES).passed


@pytest.mark.parametrize("name", [pytest.param("tilted", marks=pytest.mark.proof), "tilted lens"])
def test_every_backend_has_the_same_camera(name: str, worker: Worker, light_of) -> None:
    asset, samples = load_asset(builtin="suzanne"), 256
    scene = Scene.of_look(asset, BLACK, light_of("white"), SIZE, cameras(asset)[name])
    exact, *others = (
        render_seeds(worker, scene, backend=backend, samples=samples, bounces=0)[0].alpha.astype(np.float64)
        for backend in ("exact", "nodes", "nodes-exact")
    )
    edge = (exact > 0.0) & (exact < 1.0)
    assert np.count_nonzero(edge) > 100
    for alpha in others:
        # The standard error of a coverage c is at most that of independent samples, (c (1 - c) / n)^1/2; both have one.
        mean = (alpha + exact)[edge] / 2.0
        variance = 2.0 * np.maximum(mean * (1.0 - mean), 1.0 / samples) / samples
        assert np.mean((alpha - exact)[edge] ** 2 / variance) < 1.0 + 4.0 * np.sqrt(2.0 / np.count_nonzero(edge))
        assert np.abs(alpha - exact).max() < 5.0 * np.sqrt(0.5 / samples)


def stretch(asset: Asset, *scale: float) -> Asset:
    instances = [replace(instance, matrix=np.diag([*scale, 1.0]) @ instance.matrix) for instance in asset.instances]
    return make_asset("stretched", asset.meshes, instances, asset.slots)


CARD = ("plane", (1.0, 1.0, 1.0), 10.0)
OTHERS = [("suzanne", (1.0, 1.0, 1.0), 20.0), ("plane", (10.0, 1.0, 0.02), 0.0), ("sphere", (1.0, 2.0, 0.01), -35.0)]


@pytest.mark.parametrize(("name", "scale", "elevation"), quick_among([CARD, *OTHERS], [CARD]))
def test_a_turntable_covers_what_it_is_framed_to(name: str, scale, elevation: float, worker: Worker, light_of) -> None:
    asset, size = stretch(load_asset(builtin=name), *scale), (100, 80)
    camera = frame_fill(hull_points(asset.meshes, asset.instances), size, elevation=elevation)
    scene = Scene.of_look(asset, BLACK, light_of("white"), size, camera)
    # After half a turn, a plane about its axis covers what it covered before.
    alphas = [
        render_seeds(worker, scene, pose=Pose(angle, 0.0), samples=16, bounces=0)[0].alpha
        for angle in np.arange(0.0, 180.0 if name == "plane" else 360.0, 9.0).tolist()
    ]
    rows, columns = np.nonzero(np.max(alphas, axis=0) > 0.0)
    width, height = (np.ptp(indices) + 1 for indices in (columns, rows))
    assert width == pytest.approx(70, abs=1) or height == pytest.approx(56, abs=1)
    assert width <= 71
    assert height <= 57
    # Equal margins, to a pixel.
    assert abs(columns.min() + columns.max() - 99) <= 1
    assert abs(rows.min() + rows.max() - 79) <= 1
