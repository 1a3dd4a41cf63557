"""The rays of a camera in the frame of the asset, which the camera orbits."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats
from lookdev.scene.camera import Camera, Pose


def camera_rays(
    camera: Camera,
    pose: Pose,
    resolution: tuple[int, int],
    x: ArrayLike,
    y: ArrayLike,
    u: Floats | None = None,
) -> tuple[Floats, Floats]:
    """Return origins and unit directions (..., 3) of rays; x, y in pixels from the upper left corner.

    For a thin lens, u (..., 2), uniform in the unit square, is mapped to the point where a ray leaves the lens. Without
    u, and for a pinhole, all rays have one origin, (3,).
    """
    orbited = camera.orbited(-pose.element)
    right, up, back = orbited.frame
    width, height = resolution
    shift_x, shift_y = camera.shift
    sx = (2.0 * np.asarray(x, dtype=np.float64) / width - 1.0 + 2.0 * shift_x) * camera.reach
    sy = ((1.0 - 2.0 * np.asarray(y, dtype=np.float64) / height) * height / width + 2.0 * shift_y) * camera.reach
    direction = -back + sx[..., None] * right + sy[..., None] * up
    origin = orbited.position
    if camera.lens is not None and u is not None:
        radius, angle = 0.5 * camera.lens.aperture * np.sqrt(u[..., 0]), 2.0 * np.pi * u[..., 1]
        within = (radius * np.cos(angle))[..., None] * right + (radius * np.sin(angle))[..., None] * up
        # All rays of a point of the frame meet in the plane of focus.
        origin, direction = origin + within, direction - within / camera.lens.focus
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return origin, direction
