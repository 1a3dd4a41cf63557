"""Through a lens, the environment behind the asset is what the reference's rays see on average."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from lookdev.light import Turned, make_environment, prepare_light
from lookdev.light.mapping import uv_to_direction
from lookdev.output.background import environment_background
from lookdev.render.task import FrameTask, SceneTask, one_frame
from lookdev.scene import Camera, Lens, Pose, camera_rays

POSE, SIZE = Pose(10.0, 40.0), (64, 48)
CAMERA = Camera(40.0, 15.0, (0.0, 0.0, 0.0), 3.0, azimuth=20.0, roll=10.0, shift=(0.1, 0.2))
FrameOf = Callable[[Camera], FrameTask]


@pytest.fixture(scope="module")
def light():
    """A broad lamp before the camera, which nine places of a pixel resolve."""
    v, u = (np.mgrid[:64, :128] + 0.5) / np.array([64, 128])[:, None, None]
    lamp = np.exp(20.0 * (uv_to_direction(np.stack([u, 1.0 - v], axis=-1)) @ [0.2, 0.9, -0.35] - 1.0))
    return prepare_light(make_environment("lamp", 0.1 + 8.0 * lamp[..., None] * [1.0, 0.8, 0.5]), sampled=False)


@pytest.fixture
def frame_of(scene: SceneTask, light) -> FrameOf:
    return lambda camera: one_frame(replace(scene, camera=camera, resolution=SIZE, lights=(light,)), POSE, "frame")


@pytest.mark.parametrize("aperture", [pytest.param(0.2, marks=pytest.mark.proof), 2.0])
def test_a_lens_blurs_the_environment(aperture: float, light, frame_of: FrameOf) -> None:
    camera, count = replace(CAMERA, lens=Lens(aperture, 2.5)), 20000
    background = environment_background(frame_of(camera))
    u = np.random.default_rng(0).random((count, 4))
    for x, y in ((5, 7), (40, 20), (63, 47)):
        origin, direction = camera_rays(camera, POSE, SIZE, x + u[:, 0], y + u[:, 1], u[:, 2:])
        seen = Turned(light, POSE.lighting - POSE.element).radiance(origin, direction)
        error = seen.std(axis=0) / math.sqrt(count)
        # Four standard errors; nine places of a pixel stand for its area.
        assert np.abs(background[y, x] - seen.mean(axis=0)).max() < (4.0 * error + 5e-3 * seen.mean(axis=0)).max()


def test_a_small_aperture_blurs_nothing(frame_of: FrameOf) -> None:
    sharp = environment_background(frame_of(CAMERA))
    small = environment_background(frame_of(replace(CAMERA, lens=Lens(1e-4, 2.5))))
    # The same sums, which a library of linear algebra may order otherwise from call to call.
    np.testing.assert_allclose(small, sharp, rtol=1e-13)
    blurred = environment_background(frame_of(replace(CAMERA, lens=Lens(2.0, 2.5))))
    assert blurred.shape == sharp.shape
    assert blurred.min() >= 0.0
    assert np.abs(blurred / sharp - 1.0).max() > 0.3
