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
    """Return the pose of each frame, in degrees in [0, 360): the angle of frame i of N is start + degrees i / N.

    The light's `rotation`, degrees, is added to its angle. A camera at `azimuth` sees what a camera at 0 sees when
    asset and light turn by ``-azimuth``, so the pose contains the azimuth.
    """
    element, lighting = -_exact_angle(azimuth), _exact_angle(rotation) - _exact_angle(azimuth)
    step = _exact_angle(turntable.degrees) / turntable.frames
    if turntable.kind == "element":
        start, still = element + _exact_angle(turntable.start), _wrap_angle(lighting)
        return tuple(Pose(angle, still) for angle in _wrapped_angles(start, step, turntable.frames))
    start, still = lighting + _exact_angle(turntable.start), _wrap_angle(element)
    return tuple(Pose(still, angle) for angle in _wrapped_angles(start, step, turntable.frames))


def canonical_pose(pose: Pose, asset: bool, light: bool) -> Pose:
    """Return the one pose that is rendered for all poses that show the same picture.

    `asset` and `light` state whether the asset and the light look the same all around; their angles are then 0. The
    angle `lighting` is relative to the camera, so it does not depend on `element`.
    """
    if not (asset or light):
        return pose
    return Pose(element=0.0 if asset else pose.element, lighting=0.0 if light else pose.lighting)


def _exact_angle(angle: float) -> Fraction:
    """Return the decimal number that the user wrote; sums are exact, so equal angles of two turntables are one pose."""
    return Fraction(repr(angle))


def _wrapped_angles(start: Fraction, step: Fraction, count: int) -> Iterator[float]:
    """Yield `count` angles in [0, 360); integers over a common denominator are as exact as fractions, and faster."""
    denominator = math.lcm(start.denominator, step.denominator)
    first, increment = int(start * denominator), int(step * denominator)
    for index in range(count):
        # The float nearest to a number just below 360 can be 360 itself.
        yield ((first + increment * index) % (360 * denominator) / denominator) % 360.0


def _wrap_angle(angle: Fraction) -> float:
    return next(_wrapped_angles(angle, Fraction(0), 1))
