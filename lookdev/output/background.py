"""The light behind the asset, as the camera sees it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lookdev.light import Turned
from lookdev.render.task import FrameTask
from lookdev.scene import camera_rays

# Subsamples of a pixel along each axis: enough for an interpolated map at the size of a preview.
_GRID = 3


def environment_background(task: FrameTask) -> NDArray[np.float64]:
    """Return the environment that the camera of a frame sees, (H, W, 3), exposure applied."""
    light = Turned(task.scene.light, task.pose.lighting - task.pose.element)
    width, height = task.scene.resolution
    offsets = (np.arange(_GRID) + 0.5) / _GRID
    total = np.zeros((height, width, 3))
    rows, columns = np.mgrid[:height, :width]
    for dy in offsets:
        for dx in offsets:
            origin, direction = camera_rays(task.scene.camera, task.pose, (width, height), columns + dx, rows + dy)
            total += light.radiance(origin, direction)
    return total * (math.pow(2.0, task.exposure) / _GRID**2)
