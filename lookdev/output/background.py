"""The picture of the lights that the camera sees behind the asset, computed without a renderer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from lookdev.arrays import Floats
from lookdev.light import Light, PosedLight
from lookdev.light.native import world_domes
from lookdev.rendering.task import FrameTask
from lookdev.scene import Camera, camera_rays
from lookdev.space import to_rec709

_GRID = 3  # subsamples of a pixel along each axis
_LENS_GRID = 8  # subsamples of a pixel along each axis, for rays through a lens
_DISC_GRID = 16  # subsamples of a pixel of the disc of confusion


def environment_background(task: FrameTask) -> Floats:
    """Return the radiance (H, W, 3) behind the asset of a frame, in linear Rec.709, with the frame's exposure.

    It is the radiance of all domes, and of the other lights that the camera sees. A lens blurs every point at infinity
    to a disc of one size, so the picture of the domes is convolved with this disc. The other lights, which are nearby,
    are averaged over rays through the lens.
    """
    scene = task.scene
    far_lights = world_domes(scene.lights)
    near_lights = [light for light in scene.lights if light.emission.camera and light not in far_lights]
    disc = _disc_of_confusion(scene.camera, scene.resolution[0])
    edge = len(disc) // 2
    total = _mean_radiance(task, far_lights, edge=edge)
    if edge:
        from scipy.signal import oaconvolve  # not at the top: it takes half a second, and few jobs need it

        # Fourier transforms can round to negative values.
        total = np.maximum(oaconvolve(total, disc[..., None], mode="valid", axes=(0, 1)), 0.0)
    if near_lights:
        total += _mean_radiance(task, near_lights, lens=scene.camera.lens is not None)
    return to_rec709(total, scene.space) * math.pow(2.0, task.exposure)


def _mean_radiance(task: FrameTask, lights: Sequence[Light], *, edge: int = 0, lens: bool = False) -> Floats:
    """Return the radiance of lights, (H + 2 edge, W + 2 edge, 3), as the mean over a grid of rays in each pixel.

    The picture is the frame with a border of `edge` pixels. With `lens`, each ray of the grid starts at a different
    point on the lens.
    """
    camera, pose, grid = task.scene.camera, task.pose, _LENS_GRID if lens else _GRID
    width, height = task.scene.resolution
    rows, columns = np.mgrid[-edge : height + edge, -edge : width + edge]
    total = np.zeros((*rows.shape, 3))
    # The asset stands still, and the camera and the lights turn around it instead (`camera_rays`).
    angles = [light.emission.turns * pose.lighting - pose.element for light in lights]
    lens_samples = _lens_samples(grid * grid) if lens else None
    for number, (dy, dx) in enumerate(product((np.arange(grid) + 0.5) / grid, repeat=2)):
        u = None if lens_samples is None else np.broadcast_to(lens_samples[number], (*rows.shape, 2))
        origin, direction = camera_rays(camera, pose, (width, height), columns + dx, rows + dy, u)
        for light, degrees in zip(lights, angles, strict=True):
            total += PosedLight(light, degrees, camera.pivot).radiance(origin, direction)
    return total / grid**2


def _lens_samples(count: int) -> Floats:
    """Return at least `count` Sobol points in the unit square, (n, 2), without the first, which is a corner."""
    from scipy.stats import qmc

    return np.asarray(qmc.Sobol(2, scramble=False).random(1 << count.bit_length())[1:])


def _disc_of_confusion(camera: Camera, width: int) -> Floats:
    """Return the weights (n, n), n odd, of the disc of pixels over which a lens spreads a point at infinity.

    The weights sum to 1. `width` is the width of the frame in pixels.
    """
    lens = camera.lens
    # In pixels. Rays of a point at infinity are parallel: they are as far apart on the plane of focus as on the lens.
    radius = 0.0 if lens is None else 0.5 * lens.aperture / lens.focus / camera.half_width * width / 2.0
    if radius < 1.0 / _DISC_GRID:
        return np.ones((1, 1))
    edge = math.ceil(radius)
    count = 2 * edge + 1
    steps = (np.arange(count * _DISC_GRID) + 0.5) / _DISC_GRID - count / 2.0
    inside = np.hypot(steps[:, None], steps) < radius
    disc = inside.reshape(count, _DISC_GRID, count, _DISC_GRID).mean(axis=(1, 3))
    return np.asarray(disc / disc.sum())
