"""Where the asset and the light stand in each frame of a turntable."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from functools import lru_cache

from lookdev.job import JobTurntable
from lookdev.scene import Pose


@lru_cache(maxsize=64)
def turntable_poses(turntable: JobTurntable, rotation: float = 0.0, azimuth: float = 0.0) -> tuple[Pose, ...]:
    """Return the pose of each frame, angles in [0, 360): frame i of N stands at start + degrees i / N.

    The light's `rotation`, degrees, is added to its angle. A camera at `azimuth` shows what a camera at 0 shows when
    asset and light turn by ``-azimuth``, so the pose contains it.
    """
    element, lighting = -_exact(azimuth), _exact(rotation) - _exact(azimuth)
    step = _exact(turntable.degrees) / turntable.frames
    if turntable.kind == "element":
        turned, still = element + _exact(turntable.start), _angle(lighting)
        return tuple(Pose(angle, still) for angle in _angles(turned, step, turntable.frames))
    turned, still = lighting + _exact(turntable.start), _angle(element)
    return tuple(Pose(still, angle) for angle in _angles(turned, step, turntable.frames))


def unturned(pose: Pose, asset: bool, light: bool) -> Pose:
    """Return the pose that stands for all with the same picture; `asset`, `light`: it is the same all around.

    Relative to the camera, the light stands at `lighting`, whatever `element` is.
    """
    if not (asset or light):
        return pose
    return Pose(element=0.0 if asset else pose.element, lighting=0.0 if light else pose.lighting)


def _exact(angle: float) -> Fraction:
    """Return the decimal number that the user wrote: sums are exact, so equal angles of two turntables are one pose."""
    return Fraction(repr(angle))


def _angles(start: Fraction, step: Fraction, count: int) -> Iterator[float]:
    """Yield `count` angles. Whole numbers over a common denominator are as exact as fractions, and faster."""
    one = math.lcm(start.denominator, step.denominator)
    first, more = int(start * one), int(step * one)
    for index in range(count):
        # The float nearest to a number just below 360 can be 360 itself.
        yield ((first + more * index) % (360 * one) / one) % 360.0


def _angle(turn: Fraction) -> float:
    return next(_angles(turn, Fraction(0), 1))
