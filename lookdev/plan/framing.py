"""The camera that frames an asset's bounding sphere, the same in every frame, so that it never pumps."""

from __future__ import annotations

import math

from lookdev.errors import AssetError
from lookdev.job import JobCamera
from lookdev.plan.task import Camera


def frame_camera(
    camera: JobCamera, center: tuple[float, float, float], radius: float, resolution: tuple[int, int]
) -> Camera:
    """Place a camera so that the bounding sphere, times the margin, just fits the frame.

    Parameters
    ----------
    camera : JobCamera
        The lens, the elevation and the margin; its azimuth is part of the poses.
    center, radius : (3,) floats, float
        The asset's bounding sphere in world space, metres.
    resolution : (int, int)
        Width and height, square pixels.

    Returns
    -------
    Camera
        At ``radius margin / sin(half)`` from the centre, where the sphere's silhouette touches the nearer two
        sides of the frame: `half` is half the smaller of the two angles of view.

    Raises
    ------
    AssetError
        If the sphere has no size.
    """
    if not (math.isfinite(radius) and radius > 0.0):
        raise AssetError(f"the asset's bounding radius is {radius} m: it must have a finite, positive size")
    width, height = resolution
    half_width = math.radians(camera.horizontal_fov) / 2.0
    half_height = math.atan(math.tan(half_width) * height / width)
    return Camera(
        fov=camera.horizontal_fov,
        elevation=camera.elevation,
        target=(float(center[0]), float(center[1]), float(center[2])),
        distance=float(radius) * camera.margin / math.sin(min(half_width, half_height)),
    )
