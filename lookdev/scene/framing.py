"""The camera that frames an asset's bounding sphere: the same in every frame, so that the size never changes."""

from __future__ import annotations

import math

from lookdev.errors import AssetError
from lookdev.scene.camera import Camera

DEFAULT_FOV = math.degrees(2.0 * math.atan(36.0 / (2.0 * 50.0)))
"""Horizontal angle of view, degrees, of a lens of 50 mm before a sensor 36 mm wide."""


def frame_camera(
    center: tuple[float, float, float],
    radius: float,
    resolution: tuple[int, int],
    *,
    fov: float = DEFAULT_FOV,
    elevation: float = 10.0,
    margin: float = 1.1,
) -> Camera:
    """Place a camera so that the bounding sphere, times the margin, just fits the frame.

    Its distance is ``radius margin / sin(half)``, where `half` is half the smaller of the two angles of view.

    Parameters
    ----------
    center, radius
        The asset's bounding sphere in world space, metres.
    resolution
        Width and height, square pixels.
    fov, elevation
        Horizontal angle of view, and angle above the horizon, degrees.
    margin
        Factor of the radius.

    Raises
    ------
    AssetError
        The radius is not finite and positive.
    """
    if not (math.isfinite(radius) and radius > 0.0):
        raise AssetError(f"the asset's bounding radius is {radius} m: it must have a finite, positive size")
    width, height = resolution
    half_width = math.radians(fov) / 2.0
    half_height = math.atan(math.tan(half_width) * height / width)
    return Camera(
        fov=fov,
        elevation=elevation,
        target=(float(center[0]), float(center[1]), float(center[2])),
        distance=float(radius) * margin / math.sin(min(half_width, half_height)),
    )
