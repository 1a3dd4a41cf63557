"""The rays of a camera in the frame of the asset, which the camera orbits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lookdev.scene.camera import Camera, Pose

Floats = NDArray[np.float64]


def camera_rays(
    camera: Camera, pose: Pose, resolution: tuple[int, int], x: ArrayLike, y: ArrayLike
) -> tuple[Floats, Floats]:
    """Return the origin, (3,), and unit directions, (..., 3), of rays; x, y in pixels from the upper left corner."""
    azimuth, elevation = math.radians(-90.0 - pose.element), math.radians(camera.elevation)
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    level, raised = math.cos(elevation), math.sin(elevation)
    out = np.array([level * math.cos(azimuth), level * math.sin(azimuth), raised])
    up = np.cross(out, right)
    width, height = resolution
    reach = math.tan(math.radians(camera.fov) / 2.0)
    sx = (2.0 * np.asarray(x, dtype=np.float64) / width - 1.0) * reach
    sy = (1.0 - 2.0 * np.asarray(y, dtype=np.float64) / height) * reach * height / width
    direction = -out + sx[..., None] * right + sy[..., None] * up
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.array(camera.target) + camera.distance * out, direction
