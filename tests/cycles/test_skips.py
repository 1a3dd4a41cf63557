"""Skips do not change pictures: frames with a skip are compared with frames of an equivalent scene without it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from frames import POSE, orbit_camera

from lookdev.asset import Asset
from lookdev.asset.builtin import make_sphere
from lookdev.light import Dome, Emission, RectLight, Shaping, SphereLight
from lookdev.light.dome.environment import write_exr
from lookdev.material import Layer, Look, Texture
from lookdev.plan.poses import canonical_pose
from lookdev.plan.setup import make_setup
from lookdev.plan.skips import scene_skips
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import SceneTask, frame_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Pose, Sampling, Scene

pytestmark = pytest.mark.cycles

COAT = Layer("Paint", "disney", {"baseColor": (0.6, 0.1, 0.05), "roughness": 0.3, "clearcoat": 0.7})
CHALK = Layer("Chalk", "lambert", {"reflectance": (0.6, 0.5, 0.3)})
SAMPLING = Sampling(samples=64, bounces=4)


def scene_of(asset: Asset, layer: Layer, light: Dome) -> Scene:
    camera = orbit_camera(asset.center, asset.radius)
    return Scene.of_look(asset, Look("look", (layer,)), light, (48, 48), camera)


def assert_skips_keep_picture(worker: Worker, short: Scene, full: Scene, skips: set[str], **sampling: int) -> None:
    """Check that a scene with skips has the same picture as an equivalent scene without them."""
    tasks = [scene_task(short, SAMPLING), scene_task(full, replace(SAMPLING, **sampling))]
    assert skips <= skip_names(short, tasks[0])
    assert not skips & skip_names(full, tasks[1])
    assert_equal_means(*(render_task(worker, task, seed=str(number)) for number, task in enumerate(tasks)))


def render_task(worker: Worker, task: SceneTask, pose: Pose = POSE, seed: str = "a") -> WorkerFrame:
    worker.start()
    return worker.render(frame_task(task, pose, seed), lambda progress: None)


def assert_equal_means(a: WorkerFrame, b: WorkerFrame) -> None:
    """Check that the mean relative difference is within the noise of both, which is at most 1e-3."""
    inside = (a.alpha == 1.0) & (b.alpha == 1.0)
    mean_a, mean_b = ((frame.a + frame.b)[inside].astype(float) / 2 for frame in (a, b))
    weight = 1.0 / ((mean_a + mean_b) / 2 + 0.1)
    variance = sum((frame.a - frame.b)[inside].astype(float) ** 2 / 4 for frame in (a, b))
    noise = np.sqrt((weight**2 * variance).sum()) / weight.size
    assert noise < 1e-3
    assert abs((weight * (mean_a - mean_b)).mean()) < 4.0 * noise + 1e-6


def skip_names(scene: Scene, task: SceneTask) -> set[str]:
    return {name for name, _ in scene_skips(task, scene.looks, SAMPLING)}


@pytest.fixture(scope="module")
def sphere() -> Asset:
    return make_sphere(96, 48)


@pytest.mark.parametrize("layer", [pytest.param(COAT, marks=pytest.mark.proof), CHALK], ids=lambda layer: layer.model)
def test_a_convex_asset_needs_no_bounces_and_no_shadow_rays(
    layer: Layer, worker: Worker, sphere: Asset, light_of: Callable[[str], Dome]
) -> None:
    full = replace(sphere, convex=False)
    scenes = [scene_of(asset, layer, light_of("studio")) for asset in (sphere, full)]
    assert_skips_keep_picture(worker, *scenes, {"bounces", "shadow rays"})


def test_a_constant_light_needs_no_light_samples(worker: Worker, sphere: Asset, light_of) -> None:
    """With a lamp, however faint, a constant dome is part of a rig, which keeps its light samples."""
    faint = SphereLight(radius=0.2, position=(1.0, -3.0, 3.0), emission=Emission((1e-5, 1e-5, 1e-5)))
    short = scene_of(sphere, COAT, light_of("white"))
    assert_skips_keep_picture(worker, short, replace(short, lights=(light_of("white"), faint)), {"light samples"})


def test_a_broad_lobe_needs_no_samples_of_its_own(worker: Worker, sphere: Asset, light_of) -> None:
    scene = scene_of(sphere, CHALK, light_of("studio"))
    assert_skips_keep_picture(worker, scene, scene, {"BRDF samples"}, brdf_samples=2)


def test_a_lobe_that_constants_make_0_needs_no_code(worker: Worker, sphere: Asset, light_of, tmp_path: Path) -> None:
    """An image of zeros does not fold."""
    write_exr(tmp_path / "none.exr", "RGB", np.zeros((4, 4, 3), np.float32))
    bare = replace(COAT, inputs={**COAT.inputs, "clearcoat": 0.0})
    full = replace(COAT, inputs={**COAT.inputs, "clearcoat": Texture(tmp_path / "none.exr", "r", "raw")})
    assert_skips_keep_picture(
        worker, *(scene_of(sphere, layer, light_of("studio")) for layer in (bare, full)), {"1 lobe"}
    )


def test_lights_that_reach_nothing_are_left_out(worker: Worker, sphere: Asset, light_of, monkeypatch) -> None:
    """A rectangle faces away, a beam misses the asset, a lamp is off; two lights remain."""
    bright = Emission((8.0, 8.0, 8.0))
    behind = RectLight(width=1.0, height=1.0, position=(0.0, 0.0, -3.0), emission=bright)  # shines down, from below
    beam = replace(bright, shaping=Shaping(cone_angle=20.0))
    beside = SphereLight(radius=0.2, position=(6.0, 0.0, 0.0), emission=beam)
    off = SphereLight(radius=0.2, position=(1.0, -3.0, 3.0), emission=Emission((0.0, 0.0, 0.0)))
    lamp = replace(off, emission=bright)
    scene = replace(scene_of(sphere, COAT, light_of("studio")), lights=(behind, lamp, beside, off, light_of("studio")))
    short = scene_task(scene, SAMPLING)
    assert short.lights == (lamp, light_of("studio"))
    assert ("3 lights", "reach no part") in scene_skips(short, scene.looks, SAMPLING, len(scene.lights))
    monkeypatch.setattr(Scene, "without_idle_lights", lambda scene: scene)
    full = scene_task(scene, SAMPLING)
    assert len(full.lights) == 5
    assert_equal_means(render_task(worker, short), render_task(worker, full))


@pytest.mark.parametrize(("ibl", "causes"), [("studio", "same all around"), ("white", "constant light")])
def test_frames_of_other_poses_are_the_one_that_is_rendered(
    ibl: str, causes: str, worker: Worker, sphere: Asset, light_of: Callable[[str], Dome]
) -> None:
    """A pose that shares a frame with another is also rendered as requested."""
    scene = scene_of(sphere, COAT, light_of(ibl))
    setup = make_setup("look", ibl, scene, SAMPLING)
    requested_pose = Pose(20.0, 100.0) if causes == "constant light" else Pose(75.0, 40.0)
    rendered_pose = canonical_pose(requested_pose, setup.is_rotation_invariant, setup.task.is_light_fixed)
    assert rendered_pose == Pose(0.0, 0.0 if causes == "constant light" else 40.0)
    assert_equal_means(
        render_task(worker, setup.task, rendered_pose), render_task(worker, setup.task, requested_pose, "asked")
    )
