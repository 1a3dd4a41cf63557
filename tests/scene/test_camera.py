"""Cameras: their positions and orbits, and the rays of shifted frames and thin lenses."""

import json
import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from pydantic import TypeAdapter

from lookdev.scene import Camera, Lens, Pose, camera_rays

SIZE = (80, 50)
PLAIN = Camera(40.0, 15.0, (0.1, -0.2, 0.3), 4.0)
GENERAL = replace(PLAIN, azimuth=50.0, roll=25.0, axis=(0.5, 0.7), shift=(0.1, -0.2))


def project(camera: Camera, point: np.ndarray) -> np.ndarray:
    """Return the pixel of a point in the frame of a camera at pose 0."""
    right, up, toward = camera.frame @ (point - camera.position)
    width, height = SIZE
    x, y = (np.array([right, up]) / -toward / camera.half_width / 2.0 - camera.shift) * width
    return np.array([width / 2.0 + x, height / 2.0 - y])


def about(axis: tuple[float, float], degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear part and the offset of a rotation about a vertical axis."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn, center = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([*axis, 0.0])
    return turn, center - turn @ center


def test_a_camera_stands_where_its_angles_say() -> None:
    np.testing.assert_allclose(Camera(40.0, 0.0, (1.0, 2.0, 3.0), 5.0).position, [1.0, -3.0, 3.0])
    right, up, back = Camera(40.0, 90.0, (0.0, 0.0, 0.0), 1.0).frame  # from above
    np.testing.assert_allclose([right, up, back], [[1, 0, 0], [0, 1, 0], [0, 0, 1]], atol=1e-15)
    right, up, back = Camera(40.0, 0.0, (0.0, 0.0, 0.0), 1.0, azimuth=90.0, roll=90.0).frame  # on +x, on its side
    np.testing.assert_allclose([right, up, back], [[0, 0, 1], [0, -1, 0], [1, 0, 0]], atol=1e-15)


@pytest.mark.parametrize("camera", [PLAIN, GENERAL])
def test_a_camera_that_orbits_shows_the_asset_turned(camera: Camera) -> None:
    turn, offset = about(camera.pivot, 70.0)
    for point in np.random.default_rng(0).normal(0.0, 0.3, (5, 3)):
        np.testing.assert_allclose(project(camera.orbit(-70.0), point), project(camera, turn @ point + offset))


@pytest.mark.parametrize("camera", [PLAIN, GENERAL])
def test_rays_go_through_the_points_that_pixels_show(camera: Camera) -> None:
    turn, offset = about(camera.pivot, 70.0)
    point = np.array([0.3, 0.1, -0.2])
    origin, direction = camera_rays(camera, Pose(70.0, 0.0), SIZE, *project(camera, turn @ point + offset))
    np.testing.assert_allclose(np.cross(point - origin, direction), 0.0, atol=1e-13)
    assert (point - origin) @ direction > 0.0


def test_a_shift_moves_the_frame_by_widths() -> None:
    origin, direction = camera_rays(replace(PLAIN, shift=(0.25, 0.1)), Pose(0.0, 0.0), SIZE, 10.0, 30.0)
    same, expected = camera_rays(PLAIN, Pose(0.0, 0.0), SIZE, 10.0 + 0.25 * 80, 30.0 - 0.1 * 80)
    np.testing.assert_allclose((origin, direction), (same, expected), atol=1e-15)


def test_rays_of_a_lens_leave_a_disc_and_meet_in_the_plane_of_focus() -> None:
    camera = replace(GENERAL, lens=Lens(0.4, 2.5))
    u = np.random.default_rng(1).random((4000, 2))
    origin, direction = camera_rays(camera, Pose(0.0, 0.0), SIZE, np.full(4000, 7.0), np.full(4000, 9.0), u)
    right, up, back = camera.frame
    depth = -direction @ back
    focus = origin + direction * (2.5 / depth)[:, None]
    _, through = camera_rays(GENERAL, Pose(0.0, 0.0), SIZE, 7.0, 9.0)
    np.testing.assert_allclose(focus, np.broadcast_to(camera.position - through * 2.5 / (through @ back), (4000, 3)))
    within = origin - camera.position
    np.testing.assert_allclose(within @ back, 0.0, atol=1e-15)
    radius = np.hypot(within @ right, within @ up)
    assert radius.max() <= 0.2
    # Uniform over the disc: the square of the radius is uniform, its mean within four standard errors.
    assert np.mean((radius / 0.2) ** 2) == pytest.approx(0.5, abs=4.0 / math.sqrt(12.0 * 4000))
    # A pinhole's rays have one origin, and so have a lens's rays without u.
    np.testing.assert_array_equal(camera_rays(camera, Pose(0.0, 0.0), SIZE, 7.0, 9.0)[1], through)


def test_a_camera_is_plain_data() -> None:
    camera = replace(GENERAL, lens=Lens(0.4, 2.5))
    assert TypeAdapter(Camera).validate_json(json.dumps(asdict(camera))) == camera
    moved = camera.move((1.0, 2.0, 3.0))
    np.testing.assert_allclose(moved.position - camera.position, [1.0, 2.0, 3.0])
    assert moved.pivot == pytest.approx((1.5, 2.7))
