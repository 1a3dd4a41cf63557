"""The rays of a camera, in the world of the renderer: the asset at rest, the camera orbiting."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lookdev.scene.camera import Camera, Pose

Floats = NDArray[np.float64]


def camera_rays(
    camera: Camera, pose: Pose, resolution: tuple[int, int], x: ArrayLike, y: ArrayLike
) -> tuple[Floats, Floats]:
    """Return where rays start, (3,), and their unit directions, (..., 3).

    `x` and `y` are in pixels from the upper left corner of the picture, a pixel's centre at one half.
    """
    azimuth, elevation = math.radians(-90.0 - pose.element), math.radians(camera.elevation)
    out = np.array(
        [
            math.cos(elevation) * math.cos(azimuth),
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
        ]
    )
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    up = np.cross(out, right)
    width, height = resolution
    reach = math.tan(math.radians(camera.fov) / 2.0)
    sx = (2.0 * np.asarray(x, dtype=np.float64) / width - 1.0) * reach
    sy = (1.0 - 2.0 * np.asarray(y, dtype=np.float64) / height) * reach * height / width
    direction = -out + sx[..., None] * right + sy[..., None] * up
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.array(camera.target) + camera.distance * out, direction
