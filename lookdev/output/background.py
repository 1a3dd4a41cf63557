"""What of the lights is seen behind the asset."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from lookdev.arrays import Floats
from lookdev.light import Light, Turned
from lookdev.light.native import world_domes
from lookdev.rendering.task import FrameTask
from lookdev.scene import Camera, camera_rays
from lookdev.space import to_rec709

_GRID = 3  # subsamples of a pixel along each axis
_LENS_GRID = 8  # of those through a lens
_DISC_GRID = 16  # of a pixel of the disc of confusion


def environment_background(task: FrameTask) -> Floats:
    """Return the radiance behind the asset of a frame, (H, W, 3), linear Rec.709, exposure applied.

    It is that of all domes, and of the other lights that the camera sees. What is infinitely far shows each of its
    points through a lens as a disc of one size in the whole picture; what is not, as rays through the whole lens meet.
    """
    scene = task.scene
    far = world_domes(scene.lights)
    near = [light for light in scene.lights if light.emission.camera and light not in far]
    disc = _disc_of_confusion(scene.camera, scene.resolution[0])
    edge = len(disc) // 2
    total = _seen(task, far, edge=edge)
    if edge:
        from scipy.signal import oaconvolve  # takes half a second, which few jobs need

        # By Fourier transforms, whose rounding can be negative.
        total = np.maximum(oaconvolve(total, disc[..., None], mode="valid", axes=(0, 1)), 0.0)
    if near:
        total += _seen(task, near, lens=scene.camera.lens is not None)
    return to_rec709(total, scene.space) * math.pow(2.0, task.exposure)


def _seen(task: FrameTask, lights: Sequence[Light], *, edge: int = 0, lens: bool = False) -> Floats:
    """Return the radiance of lights, (H + 2 edge, W + 2 edge, 3), as the mean of a grid of rays in each pixel.

    With `lens`, each ray of the grid has a place on the lens of its own.
    """
    camera, pose, grid = task.scene.camera, task.pose, _LENS_GRID if lens else _GRID
    width, height = task.scene.resolution
    rows, columns = np.mgrid[-edge : height + edge, -edge : width + edge]
    total = np.zeros((*rows.shape, 3))
    turned = [each.emission.turns * pose.lighting - pose.element for each in lights]
    on_lens = _places_on_lens(grid * grid) if lens else None
    for number, (dy, dx) in enumerate(product((np.arange(grid) + 0.5) / grid, repeat=2)):
        u = None if on_lens is None else np.broadcast_to(on_lens[number], (*rows.shape, 2))
        origin, direction = camera_rays(camera, pose, (width, height), columns + dx, rows + dy, u)
        for light, degrees in zip(lights, turned, strict=True):
            total += Turned(light, degrees, camera.pivot).radiance(origin, direction)
    return total / grid**2


def _places_on_lens(count: int) -> Floats:
    from scipy.stats import qmc

    return np.asarray(qmc.Sobol(2, scramble=False).random(1 << count.bit_length())[1:])


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
