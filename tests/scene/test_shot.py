"""Cameras of shots: their view is that of USD's own frustum, and they orbit the axis of the asset."""

import math
from dataclasses import replace

import numpy as np
import pytest

from lookdev.asset.usd_camera import UsdCamera
from lookdev.scene import Lens, Pose, camera_rays
from lookdev.scene.shot import shot_camera, shot_notes

POINTS = np.array([(x, y, z) for x in (0.0, 2.0) for y in (0.0, 2.0) for z in (0.0, 1.0)])
# From above and the side, tilted.
FRAME = np.linalg.qr(np.array([[1.0, 2.0, 1.5], [3.0, 1.0, -2.0], [0.5, -1.0, 2.0]]))[0]
FRAME *= np.sign(np.linalg.det(FRAME))
SHOT = UsdCamera(
    path="/Cameras/shot",
    position=tuple((np.array([1.0, 1.0, 0.5]) + 5.0 * FRAME[2]).tolist()),
    frame=tuple(map(tuple, FRAME.tolist())),
    focal_length=0.035,
    apertures=(0.024, 0.012),
    offsets=(0.0015, -0.00075),
    f_stop=2.8,
    focus_distance=4.0,
    clipping=(0.1, 100.0),
    notes=("a note",),
)


@pytest.mark.parametrize("frame", [FRAME, np.eye(3), -np.eye(3)[[0, 1, 2]] * [1, -1, 1], np.eye(3)[[1, 2, 0]]])
def test_its_rays_are_those_of_the_aperture(frame: np.ndarray) -> None:
    shot = replace(SHOT, frame=tuple(map(tuple, frame.tolist())))
    camera = shot_camera(shot, POINTS)
    size = (400, 200)
    x, y = np.array([0.0, 400.0, 130.0]), np.array([0.0, 200.0, 50.0])
    origin, direction = camera_rays(camera, Pose(0.0, 0.0), size, x, y)
    np.testing.assert_allclose(origin, shot.position, atol=1e-9)
    right, up, back = frame
    across = ((x / 400 - 0.5) * 0.024 + 0.0015) / 0.035
    along = ((0.5 - y / 200) * 0.012 - 0.00075) / 0.035
    expected = across[:, None] * right + along[:, None] * up - back
    np.testing.assert_allclose(direction, expected / np.linalg.norm(expected, axis=1, keepdims=True), atol=1e-9)


def test_it_orbits_the_axis_of_the_asset_and_sees_all_of_it() -> None:
    camera = shot_camera(SHOT, POINTS)
    assert camera.pivot == pytest.approx((1.0, 1.0))
    assert camera.distance == pytest.approx(0.1 * max(math.dist(point, SHOT.position) for point in POINTS))
    near, far = camera.clip
    for angle in range(0, 360, 30):
        orbited = camera.orbit(angle)
        depths = (orbited.position - POINTS) @ orbited.frame[2]
        assert near < depths.min() < depths.max() < far


def test_depth_of_field_is_that_of_its_f_stop() -> None:
    assert shot_camera(SHOT, POINTS).lens == Lens(0.035 / 2.8, 4.0)
    for change in ({"f_stop": 0.0}, {"focus_distance": 0.0}):
        assert shot_camera(replace(SHOT, **change), POINTS).lens is None


WIDER = "its frame is 2 times as wide as high, that of the job 1.33 times: the widths agree, and more"
CUT = "its clippingRange would cut the asset; it is not applied"
BEHIND = {"position": (1.0, 1.0, -50.0), "frame": np.eye(3)}


@pytest.mark.parametrize(
    ("change", "height", "note"),
    [
        ({}, 200, None),
        ({}, 300, WIDER),
        ({}, 100, "less is seen above and below"),
        ({"clipping": (4.5, 100.0)}, 200, CUT),
        (BEHIND, 200, "the asset, before it turns, is behind the camera"),
    ],
)
def test_what_differs_from_the_shot_is_a_note(change: dict[str, object], height: int, note: str | None) -> None:
    notes = list(shot_notes(replace(SHOT, **change), POINTS, (400, height)))
    assert notes[0] == "a note"
    assert len(notes) == 1 + (note is not None)
    assert note is None or note in notes[1]
