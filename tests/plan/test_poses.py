"""Poses: exact steps, no repeated end pose, equal angles compare equal, the camera's azimuth folded in."""

import numpy as np
import pytest

from lookdev.arrays import Floats
from lookdev.job import JobTurntable
from lookdev.light.mapping import rotate_z
from lookdev.plan import turntable_poses
from lookdev.plan.poses import canonical_pose
from lookdev.scene import Camera, Pose, camera_rays


def test_frames_divide_the_turn_and_do_not_repeat_the_first() -> None:
    poses = turntable_poses(JobTurntable(kind="element", frames=4, start=10.0))
    assert poses == (Pose(10.0, 0.0), Pose(100.0, 0.0), Pose(190.0, 0.0), Pose(280.0, 0.0))
    poses = turntable_poses(JobTurntable(kind="lighting", frames=7, start=0.5, degrees=-100.0))
    assert [pose.lighting for pose in poses] == pytest.approx([0.5, *(360.5 - 100.0 * i / 7 for i in range(1, 7))])


def test_lighting_turns_the_light_from_the_lights_own_rotation() -> None:
    poses = turntable_poses(JobTurntable(kind="lighting", frames=2, degrees=-90.0), rotation=30.0)
    assert poses == (Pose(0.0, 30.0), Pose(0.0, 345.0))
    assert turntable_poses(JobTurntable(kind="element", frames=1), rotation=-30.0) == (Pose(0.0, 330.0),)


@pytest.mark.parametrize("frames", [3, 7, 24, 97])
def test_equal_angles_of_two_turntables_compare_equal(frames: int) -> None:
    once = turntable_poses(JobTurntable(kind="element", frames=frames, start=0.1))
    fine = turntable_poses(JobTurntable(kind="element", frames=3 * frames, start=-719.9))
    assert fine[::3] == once
    folded = turntable_poses(JobTurntable(kind="element", frames=frames, start=0.3), azimuth=0.2)
    assert [pose.element for pose in folded] == [pose.element for pose in once]  # 0.3 - 0.2 is not 0.1 in floats


@pytest.mark.parametrize("start", [360.0, -360.0, 720.0, -0.0, -1e-300, 36000.0, 359.99999999999994])
def test_angles_lie_in_one_turn(start: float) -> None:
    (pose,) = turntable_poses(JobTurntable(kind="element", frames=1, start=start))
    assert 0.0 <= pose.element < 360.0


@pytest.mark.parametrize("pose", [Pose(72.0, 0.0), Pose(200.0, 310.0), Pose(0.0, 45.0)])
def test_an_asset_at_angle_0_has_the_same_light_relative_to_the_camera(pose: Pose) -> None:
    """The directions in which the shader looks up the map, for directions in the camera's frame, stay the same."""
    camera = Camera(40.0, 15.0, (0.1, -0.2, 0.3), 4.0)
    x, y = np.random.default_rng(1).uniform(0.0, (80, 50), (20, 2)).T

    def lookup_directions(pose: Pose) -> Floats:
        return rotate_z(camera_rays(camera, pose, (80, 50), x, y)[1], pose.element - pose.lighting)

    canonical = canonical_pose(pose, asset=True, light=False)
    assert canonical == Pose(0.0, pose.lighting)
    np.testing.assert_allclose(lookup_directions(canonical), lookup_directions(pose), atol=1e-14)
    other = Pose(0.0, pose.lighting + 1.0)
    assert np.abs(lookup_directions(other) - lookup_directions(pose)).max() > 0.01


def test_angles_of_what_looks_the_same_all_around_are_0() -> None:
    pose = Pose(72.0, 310.0)
    poses = [canonical_pose(pose, asset=asset, light=light) for asset in (False, True) for light in (False, True)]
    assert poses == [pose, Pose(72.0, 0.0), Pose(0.0, 310.0), Pose(0.0, 0.0)]
