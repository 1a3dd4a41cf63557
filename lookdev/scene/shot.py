"""The camera of a shot: a camera of a USD file as the camera of a turntable, and notes on ignored features."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset.bounds import turning_axis
from lookdev.asset.usd_camera import UsdCamera
from lookdev.scene.camera import Camera, Lens

_ASPECT_TOLERANCE = 0.01  # a smaller relative difference of two aspect ratios is not noticeable
# The distance of the camera's target, as a fraction of the distance of the farthest point. `Camera.clip` is relative to
# the target's distance, and then includes near points, too.
_TARGET_DISTANCE = 0.1


def shot_camera(shot: UsdCamera, points: Floats) -> Camera:
    """Return the camera of a USD file as a `Camera` that orbits the turning axis of an asset.

    `points` (n, 3) is the outline of the asset. The width of the aperture fills the width of the frame. The target of
    the camera only determines the clip range.
    """
    width, _ = shot.apertures
    right, _, back = np.array(shot.frame)
    # The camera without roll. The roll is the angle from its right axis to the right axis of the shot's camera.
    level_camera = Camera(
        fov=math.degrees(2.0 * math.atan(width / (2.0 * shot.focal_length))),
        elevation=_atan2_degrees(back[2], math.hypot(back[0], back[1])),
        target=(0.0, 0.0, 0.0),
        distance=1.0,
        azimuth=_atan2_degrees(back[1], back[0]) + 90.0,
    )
    level_right, level_up, _ = level_camera.frame
    lens = None
    if shot.f_stop > 0.0 and shot.focus_distance > 0.0:
        lens = Lens(shot.focal_length / shot.f_stop, shot.focus_distance)
    position = np.array(shot.position)
    distance = _TARGET_DISTANCE * float(np.linalg.norm(points - position, axis=1).max())
    x, y, z = (position - distance * back).tolist()
    return replace(
        level_camera,
        target=(x, y, z),
        distance=distance,
        roll=_atan2_degrees(float(right @ level_up), float(right @ level_right)),
        axis=turning_axis(points),
        shift=(shot.offsets[0] / width, shot.offsets[1] / width),
        lens=lens,
    )


def shot_notes(shot: UsdCamera, points: Floats, resolution: tuple[int, int]) -> Iterator[str]:
    """Yield notes on ignored features of a shot's camera, and on an aspect ratio that differs from the job's."""
    yield from shot.notes
    (width, height), (columns, rows) = shot.apertures, resolution
    shot_aspect, job_aspect = width / height, columns / rows
    if abs(job_aspect / shot_aspect - 1.0) > _ASPECT_TOLERANCE:
        amount = "less" if job_aspect > shot_aspect else "more"
        yield (
            f"{shot.path}: its frame is {shot_aspect:.3g} times as wide as high, "
            f"that of the job {job_aspect:.3g} times: the widths agree, and {amount} is seen above and below"
        )
    depths = (np.array(shot.position) - points) @ np.array(shot.frame[2])
    near, far = shot.clipping
    if depths.max() <= 0.0:
        yield f"{shot.path}: the asset, before it turns, is behind the camera"
    elif depths.min() < near or depths.max() > far:
        yield f"{shot.path}: its clippingRange would cut the asset; it is not applied"


def _atan2_degrees(y: float, x: float) -> float:
    # The angle is rounded, so that frames have the same digest on every machine; adding 0 turns -0 into 0.
    return round(math.degrees(math.atan2(y, x)), 10) + 0.0
