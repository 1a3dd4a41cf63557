"""Outlines have the hull of all faces, whatever the meshes, and the turning axis is the middle of the footprint."""

from __future__ import annotations

import math

import numpy as np
import pytest
from asset_arrays import world_points
from test_asset_bounds import moved

from lookdev.asset import Asset, load_asset
from lookdev.asset.mesh import Instance, Mesh, Slot
from lookdev.asset.silhouette import outline, turning_axis

DIRECTIONS = np.random.default_rng(0).normal(size=(3, 200))


def faces_of(points) -> Mesh:
    """Return a mesh whose faces are triangles of consecutive points."""
    points = np.asarray(points, np.float32)
    count = len(points) // 3
    corners = np.arange(3 * count, dtype=np.int32)
    none = np.zeros((3 * count, 3), np.float32)
    return Mesh("mesh", points, corners, np.full(count, 3, np.int32), np.zeros(count, np.int32), none, none, {})


def asset_of(meshes, instances) -> Asset:
    return Asset("asset", tuple(meshes), tuple(instances), (Slot("/a"),), (0.0, 0.0, 0.0), 1.0)


def scattered(count, mesh_of, spread, seed=0):
    rng = np.random.default_rng(seed)
    meshes = [faces_of(points) for points in mesh_of(rng)]
    places = rng.normal(size=(count, 3)) * spread
    turned = [np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.5, 2.0) for _ in range(count)]
    instances = []
    for number, (place, linear) in enumerate(zip(places, turned, strict=True)):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = linear, place
        instances.append(Instance(number % len(meshes), matrix))
    return asset_of(meshes, instances)


def ball(rng, count):
    points = rng.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


def support(points):
    return (points @ DIRECTIONS).max(axis=0)


ASSETS = {
    "one mesh": lambda: scattered(1, lambda rng: [rng.normal(size=(300, 3))], 1.0),
    "a few": lambda: scattered(5, lambda rng: rng.normal(size=(5, 90, 3)), 3.0),
    "instances": lambda: scattered(500, lambda rng: [rng.normal(size=(3000, 3))], 10.0),
    "flat instances": lambda: scattered(20, lambda rng: [rng.normal(size=(60, 3)) * [1, 1, 0]], 10.0),
    "instances on a line": lambda: scattered(20, lambda rng: [rng.normal(size=(60, 3)) * [1, 0, 0]], [10.0, 0.0, 0.0]),
    "large flat instances": lambda: scattered(20, lambda rng: [rng.normal(size=(3000, 3)) * [1, 1, 0]], 10.0),
    "large instances in a plane": lambda: scattered(200, lambda rng: [ball(rng, 3000)], [50.0, 50.0, 0.0]),
    "large and small": lambda: scattered(
        40, lambda rng: [ball(rng, 3000), ball(rng, 60), rng.normal(size=(9, 3))], 9.0
    ),
    "large instances in one place": lambda: scattered(40, lambda rng: [ball(rng, 3000)], 0.0),
    "a flat whole": lambda: asset_of(
        [faces_of(np.random.default_rng(0).normal(size=(3000, 3)) * [1, 1, 0])],
        [Instance(0, moved(x, x * x, 0)) for x in range(30)],
    ),
    "far away": lambda: asset_of([faces_of(np.eye(3))], [Instance(0, moved(1e6, x, -1e6)) for x in range(30)]),
    "all in a plane": lambda: asset_of(
        [faces_of(np.eye(3) * [1, 1, 0])], [Instance(0, moved(x, 0, 0)) for x in range(9)]
    ),
}


@pytest.mark.parametrize("name", ASSETS)
def test_the_outline_has_the_hull_of_all_points(name: str) -> None:
    asset = ASSETS[name]()
    everything = np.concatenate(world_points(asset))
    # Both place the same points, in another order of sums.
    np.testing.assert_allclose(support(outline(asset)), support(everything), rtol=1e-12, atol=1e-9)
    assert len(outline(asset)) <= len(everything)


def test_instances_inside_are_left_out() -> None:
    asset = ASSETS["instances"]()
    assert len(outline(asset)) < 0.02 * 500 * 3000


@pytest.mark.parametrize(
    ("shape", "most"),
    [([1, 1, 0], 100), ([0, 1, 1], 100), ([1, 0, 0], 2)],
)
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_of_flat_meshes_the_corners_of_their_outline_are_left(shape, most, turn) -> None:
    linear = np.array([[math.cos(turn), -math.sin(turn), 0.0], [math.sin(turn), math.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    flat = faces_of(np.random.default_rng(1).normal(size=(3000, 3)) * shape)
    instances = []
    for number in range(20):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = linear, [number, 3 * number, number**2]
        instances.append(Instance(0, matrix))
    assert len(outline(asset_of([flat], instances))) <= 20 * most


def test_of_round_instances_the_outer_sides_are_left() -> None:
    asset = ASSETS["large instances in a plane"]()
    assert len(outline(asset)) < 0.2 * 200 * 3000


def test_of_instances_whose_tops_are_in_one_plane_the_rim_is_left() -> None:
    u, v = np.meshgrid(*[np.linspace(-0.5, 0.5, 33)] * 2)
    sheet = faces_of(np.stack([u, v, 0.05 * np.sin(20.0 * u) * np.cos(17.0 * v)], axis=-1).reshape(-1, 3))
    tilt = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    instances = []
    for x, y in np.ndindex(30, 30):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = tilt, tilt @ [x, y, 0.0]
        instances.append(Instance(0, matrix))
    asset = asset_of([sheet], instances)
    assert len(outline(asset)) < 0.01 * 900 * len(sheet.points)
    np.testing.assert_allclose(support(outline(asset)), support(np.concatenate(world_points(asset))), rtol=1e-12)


def test_points_of_no_face_do_not_count() -> None:
    stray = faces_of([[0, 0, 0], [1, 0, 0], [0, 1, 0], [50, 50, 50]])
    assert outline(asset_of([stray], [Instance(0, np.eye(4))])).max() == 1.0


@pytest.mark.parametrize(
    ("footprint", "axis"),
    [
        ([(0, 0), (4, 0), (2, 1)], (2.0, 0.0)),  # obtuse: two points decide
        ([(0, 0), (4, 0), (0, 4), (1, 1)], (2.0, 2.0)),
        ([(3, 0), (-3, 0), (0, 3), (0, -3), (1, 1)], (0.0, 0.0)),
        ([(1, 1), (5, 4)], (3.0, 2.5)),  # an upright card
        ([(7, 8)], (7.0, 8.0)),  # a vertical line
        ([(1e5, 1e5), (1e5 + 1, 1e5)], (1e5 + 0.5, 1e5)),
    ],
)
def test_the_axis_is_the_middle_of_the_smallest_circle(footprint, axis) -> None:
    points = np.array([(x, y, z) for x, y in footprint for z in (-9.0, 5.0)])
    assert turning_axis(points) == pytest.approx(axis, abs=1e-6)


def test_a_revolved_asset_turns_about_its_centre() -> None:
    asset = load_asset(builtin="sphere")
    assert math.dist(turning_axis(outline(asset)), asset.center[:2]) <= 1e-6 * asset.radius
