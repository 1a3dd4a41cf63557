"""Framing: the bounding sphere fits both ways, and touches the nearer two sides at margin 1."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lookdev.errors import AssetError
from lookdev.job.schema import JobCamera
from lookdev.scene import frame_camera


@pytest.mark.parametrize("resolution", [(512, 512), (1920, 1080), (300, 900)])
@pytest.mark.parametrize("lens", [{}, {"fov": 90.0}, {"focal_length": 85.0, "sensor_width": 24.0}])
def test_the_silhouette_touches_the_nearer_sides(resolution: tuple[int, int], lens: dict[str, float]) -> None:
    radius = 2.5
    camera = frame_camera((1.0, 2.0, 3.0), radius, resolution, fov=JobCamera(**lens).horizontal_fov, margin=1.0)
    assert camera.target == (1.0, 2.0, 3.0)
    # Project points of the sphere with a pinhole at the origin, the sphere's centre on the axis.
    theta, phi = np.meshgrid(np.linspace(0, math.pi, 721), np.linspace(0, 2 * math.pi, 720, endpoint=False))
    x, y = radius * np.sin(theta) * np.cos(phi), radius * np.sin(theta) * np.sin(phi)
    depth = camera.distance - radius * np.cos(theta)
    half_width = math.tan(math.radians(camera.fov) / 2)
    extent_x = np.abs(x / depth).max() / half_width
    extent_y = np.abs(y / depth).max() / (half_width * resolution[1] / resolution[0])
    # The extent sin(theta) / (k - cos(theta)), k = distance / radius, is largest at cos(theta) = 1/k. The
    # nearest grid point is at most half a step (0.125 degrees) away; the relative loss there is
    # k^2 / (k^2 - 1) times half its square, and k^2 is at least 2 for angles of view up to 90 degrees.
    assert max(extent_x, extent_y) == pytest.approx(1.0, abs=math.radians(0.125) ** 2)
    assert max(extent_x, extent_y) <= 1.0 + 1e-12


def test_margin_scales_the_distance_and_elevation_passes_through() -> None:
    tight = frame_camera((0.0, 0.0, 0.0), 1.0, (64, 64), elevation=30.0, margin=1.0)
    loose = frame_camera((0.0, 0.0, 0.0), 1.0, (64, 64), elevation=30.0, margin=1.5)
    assert loose.distance == pytest.approx(1.5 * tight.distance, rel=1e-15)
    assert loose.elevation == 30.0


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_an_asset_without_size_is_an_error(radius: float) -> None:
    with pytest.raises(AssetError, match="bounding radius"):
        frame_camera((0.0, 0.0, 0.0), radius, (64, 64))
