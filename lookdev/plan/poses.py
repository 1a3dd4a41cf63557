"""Where the asset and the light stand in each frame of a turntable."""

from __future__ import annotations

from fractions import Fraction

from lookdev.job import JobTurntable
from lookdev.scene import Pose


def turntable_poses(turntable: JobTurntable, rotation: float = 0.0, azimuth: float = 0.0) -> tuple[Pose, ...]:
    """Return the pose of each frame: frame i of N stands at start + degrees i / N.

    Parameters
    ----------
    turntable : JobTurntable
        What turns, how far and in how many frames.
    rotation : float
        The light's own rotation, degrees, added to its angle.
    azimuth : float
        The camera's azimuth, degrees. A camera that orbits by `azimuth` sees what a camera at 0 sees when
        asset and light both turn by ``-azimuth``; so it is folded into the pose.

    Returns
    -------
    tuple of Pose
        Angles in [0, 360).
    """
    start, degrees = _exact(turntable.start), _exact(turntable.degrees)
    poses = []
    for index in range(turntable.frames):
        turn = start + degrees * index / turntable.frames
        element = turn if turntable.kind == "element" else Fraction(0)
        lighting = turn if turntable.kind == "lighting" else Fraction(0)
        poses.append(
            Pose(
                element=_angle(element - _exact(azimuth)),
                lighting=_angle(lighting + _exact(rotation) - _exact(azimuth)),
            )
        )
    return tuple(poses)


def unturned(pose: Pose, asset: bool, light: bool) -> Pose:
    """Return the pose that stands for all that show the same picture.

    Parameters
    ----------
    pose : Pose
        Where the asset and the light stand.
    asset : bool
        The asset is the same all around. Seen from the camera, the light stands at `lighting`, whatever `element` is:
        the renderer's camera orbits by ``-element``, and its light turns by ``lighting - element``.
    light : bool
        The light is: it comes alike from everywhere.
    """
    return Pose(element=0.0 if asset else pose.element, lighting=0.0 if light else pose.lighting)


def _exact(angle: float) -> Fraction:
    """Return the decimal number that the user wrote.

    Sums of such numbers are exact, so angles that are equal on paper compare equal, whatever way two
    turntables come to them: a shared pose is rendered once.
    """
    return Fraction(repr(angle))


def _angle(turn: Fraction) -> float:
    # The float nearest to a number just below 360 can be 360 itself.
    return float(turn % 360) % 360.0
