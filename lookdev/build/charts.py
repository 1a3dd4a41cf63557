"""Space for reference props in the frame: the camera that leaves it free, and notes where an asset overlaps it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from lookdev.arrays import Floats
from lookdev.scene import Camera
from lookdev.scene.charts import Strip
from lookdev.scene.framing import Arc

_STEP = 5.0  # degrees between two angles at which an outline is projected


def overlap_notes(strip: Strip, camera: Camera, points: Floats, arcs: Iterable[Arc]) -> Iterator[str]:
    """Yield a note if an asset reaches into a strip.

    Parameters
    ----------
    points
        The asset's outline, (n, 3).
    arcs
        The angles of the asset that the job shows.
    """
    (width, height), box = strip.resolution, strip.box
    for start, sweep in arcs:
        for angle in np.linspace(start, start + sweep, 1 + math.ceil(abs(sweep) / _STEP)):
            orbited = camera.orbited(-angle)
            right, up, back = ((points - orbited.position) @ orbited.frame.T).T
            depth = np.where(back < 0.0, -back, np.inf)
            x = 0.5 * width * (1.0 + right / depth / camera.reach - 2.0 * camera.shift[0])
            y = 0.5 * height - 0.5 * width * (up / depth / camera.reach - 2.0 * camera.shift[1])
            across = x.max() > box.left and x.min() < box.left + box.width
            if across and y.max() > box.top and y.min() < box.top + box.height:
                yield (
                    f"[charts] hides a part of the asset at the {strip.place} edge of the frame, where the camera "
                    "of 'usd' leaves no room; another place or a smaller size would be right"
                )
                return


def camera_beside_strip(
    strip: Strip,
    fov: float,
    share: Callable[[float], float],
    frame: Callable[[tuple[float, float], float], Camera],
) -> Camera:
    """Return a camera whose asset does not reach into a strip.

    Parameters
    ----------
    fov
        Horizontal angle of view of the frame, degrees.
    share
        Returns the largest part of the frame that the asset covers, as a fraction of the tangent of half the angle of
        view. Its argument is that half angle, radians.
    frame
        Returns a camera that frames the asset, for a resolution and a horizontal angle of view.
    """
    width, height = strip.resolution
    reach = math.tan(math.radians(0.5 * fov))
    whole = width if strip.upright else height
    covered = share(math.atan(reach * whole / width))
    if 0.5 * (1.0 - covered) * whole >= strip.thickness:
        return frame(strip.resolution, fov)
    narrow = math.degrees(2.0 * math.atan(reach * strip.rest[0] / width))
    return replace(frame(strip.rest, narrow), fov=fov, shift=strip.shift)
