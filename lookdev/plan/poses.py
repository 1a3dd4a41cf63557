"""Where the asset and the light stand in each frame of a turntable."""

from __future__ import annotations

from fractions import Fraction

from lookdev.job import JobTurntable
from lookdev.scene import Pose


def turntable_poses(turntable: JobTurntable, rotation: float = 0.0, azimuth: float = 0.0) -> tuple[Pose, ...]:
    """Return the pose of each frame, angles in [0, 360): frame i of N stands at start + degrees i / N.

    The light's `rotation`, degrees, is added to its angle. A camera at `azimuth` shows what a camera at 0 shows when
    asset and light turn by ``-azimuth``, so the pose contains it.
    """
    start, degrees = _exact(turntable.start), _exact(turntable.degrees)
    element, lighting = -_exact(azimuth), _exact(rotation) - _exact(azimuth)
    poses = []
    for index in range(turntable.frames):
        turn = start + degrees * index / turntable.frames
        if turntable.kind == "element":
            poses.append(Pose(_angle(element + turn), _angle(lighting)))
        else:
            poses.append(Pose(_angle(element), _angle(lighting + turn)))
    return tuple(poses)


def unturned(pose: Pose, asset: bool, light: bool) -> Pose:
    """Return the pose that stands for all with the same picture; `asset`, `light`: it is the same all around.

    Relative to the camera, the light stands at `lighting`, whatever `element` is.
    """
    return Pose(element=0.0 if asset else pose.element, lighting=0.0 if light else pose.lighting)


def _exact(angle: float) -> Fraction:
    """Return the decimal number that the user wrote: sums are exact, so equal angles of two turntables are one pose."""
    return Fraction(repr(angle))


def _angle(turn: Fraction) -> float:
    # The float nearest to a number just below 360 can be 360 itself.
    return float(turn % 360) % 360.0
