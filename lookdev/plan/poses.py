"""The poses of turntables: the angles of the asset and of the light in each frame."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from functools import lru_cache

from lookdev.job import JobTurntable
from lookdev.scene import Pose


@lru_cache(maxsize=64)
def turntable_poses(turntable: JobTurntable, rotation: float = 0.0, azimuth: float = 0.0) -> tuple[Pose, ...]:
    """Return the pose of each frame of a turntable; frame i of N has the angle start + degrees i / N.

    Angles of poses are in degrees in [0, 360). The light's `rotation` in degrees is added to the angle of the light. A
    camera at `azimuth` sees the same as a camera at azimuth 0 if asset and light turn by ``-azimuth``. Both angles of
    the poses are therefore reduced by the azimuth.
    """
    element, lighting = -_exact_angle(azimuth), _exact_angle(rotation) - _exact_angle(azimuth)
    step = _exact_angle(turntable.degrees) / turntable.frames
    if turntable.kind == "element":
        start, still = element + _exact_angle(turntable.start), _wrap_angle(lighting)
        return tuple(Pose(angle, still) for angle in _wrapped_angles(start, step, turntable.frames))
    start, still = lighting + _exact_angle(turntable.start), _wrap_angle(element)
    return tuple(Pose(still, angle) for angle in _wrapped_angles(start, step, turntable.frames))


def canonical_pose(pose: Pose, asset: bool, light: bool) -> Pose:
    """Return the pose that is rendered in place of all poses that show the same picture.

    `asset` and `light` are whether the asset and the light look the same all around; their angles are then set to 0.
    The angle of the light is relative to the camera, and does not depend on the angle of the asset.
    """
    if not (asset or light):
        return pose
    return Pose(element=0.0 if asset else pose.element, lighting=0.0 if light else pose.lighting)


def _exact_angle(angle: float) -> Fraction:
    """Return the decimal number that the user wrote, exactly.

    With exact sums, equal angles of two turntables are equal poses.
    """
    return Fraction(repr(angle))


def _wrapped_angles(start: Fraction, step: Fraction, count: int) -> Iterator[float]:
    """Yield `count` angles start + i step, wrapped to [0, 360)."""
    # Integers over a common denominator are as exact as fractions, and faster.
    denominator = math.lcm(start.denominator, step.denominator)
    first, increment = int(start * denominator), int(step * denominator)
    for index in range(count):
        # The float nearest to a number just below 360 can be 360 itself.
        yield ((first + increment * index) % (360 * denominator) / denominator) % 360.0


def _wrap_angle(angle: Fraction) -> float:
    return next(_wrapped_angles(angle, Fraction(0), 1))
