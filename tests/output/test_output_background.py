"""Through a lens, the environment behind the asset is the average over the reference's rays."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from lookdev.light import Emission, PosedLight, SphereLight, make_environment, prepare_light
from lookdev.light.mapping import uv_to_direction
from lookdev.output.background import _disc_of_confusion, environment_background
from lookdev.rendering.task import FrameTask, SceneTask, frame_task
from lookdev.scene import Camera, Lens, Pose, camera_rays

POSE, SIZE = Pose(10.0, 40.0), (64, 48)
CAMERA = Camera(40.0, 15.0, (0.0, 0.0, 0.0), 3.0, azimuth=20.0, roll=10.0, shift=(0.1, 0.2))
FrameOf = Callable[[Camera], FrameTask]


@pytest.fixture(scope="module")
def light():
    """Return a broad lamp before the camera, which nine samples of a pixel resolve."""
    v, u = (np.mgrid[:64, :128] + 0.5) / np.array([64, 128])[:, None, None]
    lamp = np.exp(20.0 * (uv_to_direction(np.stack([u, 1.0 - v], axis=-1)) @ [0.2, 0.9, -0.35] - 1.0))
    return prepare_light(make_environment("lamp", 0.1 + 8.0 * lamp[..., None] * [1.0, 0.8, 0.5]), sampled=False)


@pytest.fixture
def frame_of(scene: SceneTask, light) -> FrameOf:
    return lambda camera: frame_task(replace(scene, camera=camera, resolution=SIZE, lights=(light,)), POSE, "frame")


@pytest.mark.parametrize("aperture", [pytest.param(0.2, marks=pytest.mark.proof), 2.0])
def test_a_lens_blurs_the_environment(aperture: float, light, frame_of: FrameOf) -> None:
    camera, count = replace(CAMERA, lens=Lens(aperture, 2.5)), 20000
    background = environment_background(frame_of(camera))
    u = np.random.default_rng(0).random((count, 4))
    for x, y in ((5, 7), (40, 20), (63, 47)):
        origin, direction = camera_rays(camera, POSE, SIZE, x + u[:, 0], y + u[:, 1], u[:, 2:])
        radiance = PosedLight(light, POSE.lighting - POSE.element).radiance(origin, direction)
        mean, error = radiance.mean(axis=0), radiance.std(axis=0) / math.sqrt(count)
        # Four standard errors; nine samples of a pixel stand for its area.
        assert np.abs(background[y, x] - mean).max() < (4.0 * error + 5e-3 * mean).max()


def test_a_small_aperture_blurs_nothing(frame_of: FrameOf) -> None:
    sharp = environment_background(frame_of(CAMERA))
    small = environment_background(frame_of(replace(CAMERA, lens=Lens(1e-4, 2.5))))
    # The same sums, which a library of linear algebra may order otherwise from call to call.
    np.testing.assert_allclose(small, sharp, rtol=1e-13)
    blurred = environment_background(frame_of(replace(CAMERA, lens=Lens(2.0, 2.5))))
    assert blurred.shape == sharp.shape
    assert blurred.min() >= 0.0
    assert np.abs(blurred / sharp - 1.0).max() > 0.3


@pytest.mark.parametrize("lens", [None, Lens(0.5, 2.5)])
def test_lamps_that_the_camera_sees_are_behind_the_asset(lens: Lens | None, frame_of: FrameOf) -> None:
    frame, count = frame_of(replace(CAMERA, lens=lens)), 100000
    visible, hidden = (
        SphereLight(radius=0.4, position=position, emission=Emission((6.0, 4.0, 2.0), camera=camera))
        for position, camera in (((0.4, 0.3, -0.2), True), ((-0.4, 0.0, 0.2), False))
    )
    background = environment_background(replace(frame, scene=replace(frame.scene, lights=(visible, hidden))))
    u = np.random.default_rng(0).random((count, 4))
    points = u[:, :2] * SIZE
    origin, direction = camera_rays(frame.scene.camera, POSE, SIZE, *points.T, u[:, 2:] if lens else None)
    radiance = PosedLight(visible, POSE.lighting - POSE.element).radiance(origin, direction)
    # The moments of order 0 and 1 in columns and rows, within four standard errors.
    weights, grid = np.c_[np.ones(count), points], np.moveaxis(np.mgrid[: SIZE[1], : SIZE[0]][::-1] + 0.5, 0, -1)
    moments = weights[:, :, None] * radiance[:, None]
    shares = np.einsum("yxk,yxc->kc", np.insert(grid, 0, 1.0, axis=-1), background) / (SIZE[0] * SIZE[1])
    assert (np.abs(shares - moments.mean(axis=0)) < 4.0 * moments.std(axis=0) / math.sqrt(count)).all()
    assert background.max() > 0.0


def test_a_disc_of_confusion_is_centred_and_of_the_lenss_size() -> None:
    camera = replace(CAMERA, lens=Lens(2.0, 2.5))
    disc = _disc_of_confusion(camera, SIZE[0])
    steps = np.arange(len(disc)) - len(disc) // 2
    radius = 0.5 * 2.0 / 2.5 / math.tan(math.radians(20.0)) * SIZE[0] / 2.0
    np.testing.assert_allclose([disc.sum(), steps @ disc.sum(axis=0), steps @ disc.sum(axis=1)], [1, 0, 0], atol=1e-12)
    # The mean square of a coordinate over a disc is a quarter of the radius squared.
    assert steps**2 @ disc.sum(axis=0) == pytest.approx(radius**2 / 4.0, rel=0.01)
