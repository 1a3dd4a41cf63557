"""The smallest ball around an asset, and an asset moved to the origin, where float32 is precise."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from asset_arrays import affine, world_points

from lookdev.asset import Asset, Instance, Mesh
from lookdev.asset.bounds import bounding_sphere, center_asset
from lookdev.asset.builtin import make_sphere
from lookdev.asset.store import make_asset


def cloud(points):
    points = np.asarray(points, np.float32)
    corners, none = np.arange(len(points), dtype=np.int32), np.zeros(0, np.int32)
    return Mesh("cloud", points, corners, none, none, np.zeros((0, 3), "f"), np.zeros((0, 3), "f"), {})


def sphere_of(points, *matrices):
    return bounding_sphere([cloud(points)], [Instance(0, matrix) for matrix in matrices or (np.eye(4),)])


CUBE = np.array(list(itertools.product([-1.0, 1.0], repeat=3)))


@pytest.mark.parametrize(
    ("points", "center", "radius"),
    [
        (CUBE, (0, 0, 0), np.sqrt(3)),
        (CUBE * [5, 1, 0] + [3, 2, 1], (3, 2, 1), np.sqrt(26)),  # flat
        ([[0, 0, 0], [4, 0, 0], [1, 0, 0]], (2, 0, 0), 2),  # a line
        ([[0, 0, 0], [4, 0, 0], [2, 1, 0]], (2, 0, 0), 2),  # obtuse: two points decide
        ([[0, 0, 1], [0, 0, 1], [0, 0, 1]], (0, 0, 1), 0),
    ],
)
def test_known_spheres(points, center, radius):
    # The centre is rounded to a millionth of the radius, coordinate by coordinate.
    got_center, got_radius = sphere_of(points)
    np.testing.assert_allclose(got_center, center, atol=2e-6)
    assert got_radius == pytest.approx(radius, abs=4e-6)


@pytest.mark.parametrize("seed", range(4))
def test_contains_all_points_and_none_smaller_does(seed):
    rng = np.random.default_rng(seed)
    points = np.float64(np.float32(rng.normal(size=(400, 3)) * rng.uniform(0.1, 5.0, 3) + rng.normal(size=3) * 10.0))
    center, radius = sphere_of(points)
    distances = np.linalg.norm(points - center, axis=1)
    assert distances.max() <= radius * (1 + 1e-12)
    # A ball is the smallest if its centre is in the hull of the points on its boundary: a step in any direction moves
    # away from one of them.
    rim = points[distances >= radius * (1 - 1e-5)]
    for direction in rng.normal(size=(200, 3)):
        assert ((rim - center) @ direction).min() <= 1e-4 * radius * np.linalg.norm(direction)


def test_instances_are_enclosed_in_the_world():
    center, radius = sphere_of(CUBE, affine([-4, 0, 0]), affine([6, 0, 0], 3.0), affine([1, 0, 0]))
    everything = np.concatenate([np.add(CUBE, [-4, 0, 0]), np.add(CUBE * 3, [6, 0, 0]), np.add(CUBE, [1, 0, 0])])
    expected_center, expected_radius = sphere_of(everything)
    np.testing.assert_allclose(center, expected_center, atol=1e-5)
    assert radius == pytest.approx(expected_radius, rel=1e-6)


def test_mirrored_and_sheared_instances_are_contained():
    linear, offset = np.array([[-2.0, 1.0, 0], [0, 1, 0], [0, 3, 0.5]]), np.array([5.0, 0.0, 0.0])
    center, radius = sphere_of(CUBE, affine(offset, linear))
    world = CUBE @ linear.T + offset
    assert np.linalg.norm(world - center, axis=1).max() == pytest.approx(radius, rel=1e-12)


FAR = np.array([1e5, -5e4, 2e4])


BALL = make_sphere(segments=16, rings=8)


def pair(scale: float) -> Asset:
    shear = scale * np.array([[1.0, 0.3, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    placements = (1.0, (0.0, 0.0, 0.0)), (0.4, (1.2, -0.8, 0.5))
    instances = [Instance(0, affine(FAR + scale * np.array(offset), size * shear)) for size, offset in placements]
    return make_asset("pair", BALL.meshes, instances, BALL.slots)


@pytest.mark.parametrize("scale", [1.0, 1e-4, 1e4])
def test_placements_far_away_lose_nothing(scale: float) -> None:
    asset = pair(scale)
    centered = center_asset(asset)
    assert centered.center == (0.0, 0.0, 0.0)
    assert (centered.radius, centered.digest) == (asset.radius, asset.digest)
    for original, local in zip(world_points(asset), world_points(centered), strict=True):
        # float64 at 1e5 has steps of 1.5e-11.
        np.testing.assert_allclose(local + asset.center, original, rtol=0.0, atol=1e-10 + 1e-7 * asset.radius)
    for matrix in (instance.matrix for instance in centered.instances):
        assert np.abs(matrix[:3, 3]).max() < 2.0 * asset.radius
        np.testing.assert_allclose(matrix.astype(np.float32), matrix, rtol=1e-7)
    center, radius = bounding_sphere(centered.meshes, centered.instances)
    assert np.linalg.norm(center) < 1e-5 * asset.radius
    assert radius == pytest.approx(asset.radius, rel=1e-5)


def test_points_far_from_their_own_origin_come_near_it() -> None:
    mesh = replace(BALL.meshes[0], points=(BALL.meshes[0].points + FAR).astype(np.float32))
    asset = make_asset("far", [mesh], [Instance(0, np.eye(4))], BALL.slots)
    centered = center_asset(asset)
    assert np.abs(centered.meshes[0].points).max() < 1.1
    assert np.abs(centered.instances[0].matrix[:3, 3]).max() < 0.01
    np.testing.assert_allclose(world_points(centered)[0] + asset.center, world_points(asset)[0], rtol=0.0, atol=1e-6)
