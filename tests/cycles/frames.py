"""How frames of simple scenes are seen in these tests."""

from __future__ import annotations

from collections.abc import Callable

from lookdev.render.worker import Rendered
from lookdev.scene import Camera, Pose

RenderScene = Callable[..., Rendered]

POSE = Pose(30.0, 75.0)


def orbit_camera(center: tuple[float, float, float], radius: float) -> Camera:
    """Return a camera that sees a bounding sphere whole."""
    return Camera(30.0, 20.0, center, 4.2 * radius)
