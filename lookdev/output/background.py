"""The environment behind the asset."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.signal import oaconvolve

from lookdev.light import Turned
from lookdev.render.task import FrameTask
from lookdev.scene import Camera, camera_rays

_GRID = 3  # subsamples of a pixel along each axis
_DISC_GRID = 16  # of a pixel of the disc of confusion

Floats = NDArray[np.float64]


def environment_background(task: FrameTask) -> Floats:
    """Return the radiance behind the asset of a frame, (H, W, 3), exposure applied.

    The environment is infinitely far: through a lens, each of its points is a disc of one size in the whole picture.
    """
    light = Turned(task.scene.light, task.pose.lighting - task.pose.element)
    width, height = task.scene.resolution
    disc = _disc_of_confusion(task.scene.camera, width)
    edge = len(disc) // 2
    total = np.zeros((height + 2 * edge, width + 2 * edge, 3))
    rows, columns = np.mgrid[-edge : height + edge, -edge : width + edge]
    for dy, dx in product((np.arange(_GRID) + 0.5) / _GRID, repeat=2):
        origin, direction = camera_rays(task.scene.camera, task.pose, (width, height), columns + dx, rows + dy)
        total += light.radiance(origin, direction)
    if edge:
        # By Fourier transforms, whose rounding can be negative.
        total = np.maximum(oaconvolve(total, disc[..., None], mode="valid", axes=(0, 1)), 0.0)
    return np.asarray(total * (math.pow(2.0, task.exposure) / _GRID**2))


def _disc_of_confusion(camera: Camera, width: int) -> Floats:
    """Return the shares of the pixels of a disc, (n, n), n odd, over which a lens spreads a point at infinity."""
    lens = camera.lens
    radius = 0.0 if lens is None else 0.5 * lens.aperture / lens.focus / camera.reach * width / 2.0
    if radius < 1.0 / _DISC_GRID:
        return np.ones((1, 1))
    edge = math.ceil(radius)
    count = 2 * edge + 1
    steps = (np.arange(count * _DISC_GRID) + 0.5) / _DISC_GRID - count / 2.0
    inside = np.hypot(steps[:, None], steps) < radius
    disc = inside.reshape(count, _DISC_GRID, count, _DISC_GRID).mean(axis=(1, 3))
    return np.asarray(disc / disc.sum())
