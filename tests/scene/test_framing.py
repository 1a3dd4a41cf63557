"""Framing: at margin 1 the bounding sphere touches the nearer sides; a turning asset covers its fill of the frame."""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from lookdev.arrays import Floats
from lookdev.asset import load_asset
from lookdev.asset.bounds import turning_axis
from lookdev.asset.builtin import make_sphere
from lookdev.asset.silhouette import hull_points
from lookdev.errors import AssetError
from lookdev.job.schema import JobCamera
from lookdev.scene import Camera, frame_camera, frame_fill
from lookdev.scene.framing import _farthest_point_function, _rotation_about_z

BOX = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


def torus() -> Floats:
    u, v = np.meshgrid(*(np.linspace(0.0, 2.0 * math.pi, 40, endpoint=False),) * 2)
    return np.stack([(2 + np.cos(v)) * np.cos(u), (2 + np.cos(v)) * np.sin(u), np.sin(v)], axis=-1).reshape(-1, 3)


POINTS = {
    "flat plate": BOX * [2.0, 2.0, 0.0],
    "upright card": BOX * [2.0, 0.0, 2.0],
    "long bar": BOX * [100.0, 1.0, 1.0],
    "tall pole": BOX * [0.02, 0.02, 2.0],
    "angle off centre": np.concatenate([BOX * [3, 0.3, 0.3] + [1.5, 0, 0], BOX * [0.3, 0.3, 2] + [0, 0, 1]]),
    "torus": torus(),
    "two distant parts": np.concatenate([BOX * 0.3, BOX + np.array([5.0, 2.0, 1.0])]),
    "needle": BOX * [1e-3, 1e-3, 1.0],
    "far away": BOX * [1.0, 0.2, 0.5] + [1e5, -3e4, 2e4],
    "tiny": BOX * [1e-5, 3e-5, 2e-5],
    "huge": BOX * [1e5, 3e5, 2e5],
}
BUILTINS = ("sphere", "suzanne", "shaderball")
NAMES = (*POINTS, *BUILTINS)


@cache
def points_of(name: str) -> Floats:
    """Return points; of a built-in asset, a thousand corners of its hull, because only these can be outermost."""
    if name in POINTS:
        return POINTS[name]
    asset = make_sphere(64, 32) if name == "sphere" else load_asset(builtin=name)
    points = hull_points(asset.meshes, asset.instances)
    corners = points[ConvexHull(points).vertices]
    return corners[:: len(corners) // 1000 + 1]


def covered(camera: Camera, points: Floats, angles: Floats, resolution: tuple[int, int]) -> tuple[Floats, Floats]:
    """Return the least and the greatest pixel coordinates, from the centre, of points rotated by some angles."""
    pivot = np.array([*camera.pivot, 0.0])
    (x, y, z), angles = (points - pivot).T, np.radians(angles)[:, None]
    turned = [np.cos(angles) * x - np.sin(angles) * y, np.sin(angles) * x + np.cos(angles) * y, z]
    right, up, toward = (
        sum(axis[i] * turned[i] for i in range(3)) - axis @ (camera.position - pivot) for axis in camera.frame
    )
    seen = np.stack([right, up]) / -toward / camera.half_width * resolution[0] / 2.0
    return seen.min(axis=(1, 2)), seen.max(axis=(1, 2))


@pytest.mark.parametrize("resolution", [(512, 512), (1920, 1080), (300, 900)])
@pytest.mark.parametrize("lens", [{}, {"fov": 90.0}, {"focal_length": 85.0, "sensor_width": 24.0}])
def test_the_silhouette_touches_the_nearer_sides(resolution: tuple[int, int], lens: dict[str, float]) -> None:
    radius = 2.5
    camera = frame_camera((1.0, 2.0, 3.0), radius, resolution, fov=JobCamera(**lens).horizontal_fov, margin=1.0)
    assert camera.target == (1.0, 2.0, 3.0)
    # Project points of the sphere with a pinhole at the origin, the sphere's centre on the axis.
    theta, phi = np.meshgrid(np.linspace(0, math.pi, 721), np.linspace(0, 2 * math.pi, 4, endpoint=False))
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
    usual = frame_camera((0.0, 0.0, 0.0), 1.0, (64, 64), elevation=30.0)
    assert usual.distance == pytest.approx(1.1 * tight.distance, rel=1e-15)


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_an_asset_without_size_is_an_error(radius: float) -> None:
    with pytest.raises(AssetError, match="bounding radius"):
        frame_camera((0.0, 0.0, 0.0), radius, (64, 64))


# Of points that turn by half a degree between frames, the outermost is at most a quarter of a degree from its extreme,
# which takes 1e-5 of a radius; in perspective a few times that.
STEP = 0.5
LOST = 1e-4


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("elevation", "resolution"), [(10.0, (1920, 1080)), (-90.0, (600, 900)), (55.0, (512, 512))])
def test_a_turned_asset_fills_its_part_of_the_frame(name: str, elevation: float, resolution: tuple[int, int]) -> None:
    points = points_of(name)
    camera = frame_fill(points, resolution, elevation=elevation)
    least, most = covered(camera, points, np.arange(0.0, 360.0, STEP), resolution)
    size = np.array(resolution)
    filled = (most - least) / size
    assert 0.7 - LOST < filled.max() < 0.7 + 1e-9
    assert np.abs(most + least).max() < 2.0 * LOST * size.max()  # equal margins


@pytest.mark.parametrize("arcs", [[(0, 0)], [(30, 90)], [(200, -270)], [(-40, 60), (100, 0), (180, 30)]])
@pytest.mark.parametrize("name", ["upright card", "long bar", "angle off centre", "two distant parts", "far away"])
def test_only_the_angles_that_are_shown_count(name: str, arcs: list[tuple[float, float]]) -> None:
    points, resolution = points_of(name), (800, 600)
    camera = frame_fill(points, resolution, elevation=20.0, fill=0.9, arcs=arcs)
    angles = np.concatenate([np.linspace(start, start + sweep, 721) for start, sweep in arcs])
    least, most = covered(camera, points, angles, resolution)
    assert ((most - least) / resolution).max() == pytest.approx(0.9, abs=LOST)
    assert np.abs(most + least).max() < 2.0 * LOST * max(resolution)


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.3, -0.2, 0.9), (-1.0, 0.0, 0.0)])
@pytest.mark.parametrize("arcs", [[(0, 360)], [(30, 90), (200, 20)]])
def test_the_farthest_point_is_one_of_the_turned_asset(direction: tuple[float, ...], arcs: list[Any]) -> None:
    points, w = points_of("angle off centre"), np.array(direction)
    turned = np.concatenate(
        [points @ _rotation_about_z(math.radians(start + t)).T for start, sweep in arcs for t in range(sweep + 1)]
    )
    farthest = _farthest_point_function(points, arcs)(w)
    assert farthest @ w == pytest.approx((turned @ w).max(), rel=1e-3)
    assert np.linalg.norm(turned - farthest, axis=-1).min() < 0.01 * np.linalg.norm(farthest)


def test_framing_scales_and_moves_with_the_asset() -> None:
    points = points_of("angle off centre")
    camera = frame_fill(points, (640, 480))
    moved = frame_fill(1e3 * points + [4.0, -5.0, 6.0], (640, 480))
    assert moved.distance == pytest.approx(1e3 * camera.distance, rel=1e-8)
    np.testing.assert_allclose(moved.position, 1e3 * camera.position + [4.0, -5.0, 6.0], atol=1e-6 * moved.distance)
    assert camera.pivot == pytest.approx(turning_axis(points))


@pytest.mark.parametrize("width", [1e-6, 1e-9, 0.0])
def test_a_camera_that_sees_a_needle_along_its_length_stays_outside(width: float) -> None:
    needle = BOX * [width, width, 2.0]
    camera = frame_fill(needle, (512, 512), elevation=90.0)
    depths = (camera.position - needle) @ camera.frame[2]
    near, far = camera.clip
    assert near < depths.min() < depths.max() < far
    # The target is at the geometric mean of both depths, so that the clip range is about them.
    assert camera.distance == pytest.approx(math.sqrt(depths.min() * depths.max()), rel=1e-6)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((4, 3)), [[0.0, 0.0, 0.0], [math.nan, 1.0, 0.0]]])
def test_points_without_size_are_an_error(points: Floats) -> None:
    with pytest.raises(AssetError, match="finite, positive size"):
        frame_fill(np.array(points), (64, 64))
