"""The light itself behind the asset, as the camera sees it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lookdev.light import read_distribution
from lookdev.light.mapping import rotate_z
from lookdev.render.task import FrameTask
from lookdev.scene import camera_rays

# Subsamples a pixel and axis: enough for the smooth interpolation of a map at the size of a preview.
_GRID = 3


def environment_background(task: FrameTask) -> NDArray[np.float64]:
    """Return the environment that the camera of a frame sees, (H, W, 3), exposure applied."""
    light = read_distribution(task.scene.light)
    width, height = task.scene.resolution
    offsets = (np.arange(_GRID) + 0.5) / _GRID
    total = np.zeros((height, width, 3))
    rows, columns = np.mgrid[:height, :width]
    turn = task.pose.lighting - task.pose.element
    for dy in offsets:
        for dx in offsets:
            _, direction = camera_rays(task.scene.camera, task.pose, (width, height), columns + dx, rows + dy)
            total += light.radiance(rotate_z(direction, -turn))
    return total * (math.pow(2.0, task.exposure) / _GRID**2)
