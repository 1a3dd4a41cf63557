"""The environment behind the asset."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from lookdev.light import Turned
from lookdev.render.task import FrameTask
from lookdev.scene import camera_rays

_GRID = 3  # subsamples of a pixel along each axis


def environment_background(task: FrameTask) -> NDArray[np.float64]:
    """Return the radiance behind the asset of a frame, (H, W, 3), exposure applied."""
    light = Turned(task.scene.light, task.pose.lighting - task.pose.element)
    width, height = task.scene.resolution
    total = np.zeros((height, width, 3))
    rows, columns = np.mgrid[:height, :width]
    for dy, dx in product((np.arange(_GRID) + 0.5) / _GRID, repeat=2):
        origin, direction = camera_rays(task.scene.camera, task.pose, (width, height), columns + dx, rows + dy)
        total += light.radiance(origin, direction)
    return total * (math.pow(2.0, task.exposure) / _GRID**2)
