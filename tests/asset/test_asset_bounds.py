from __future__ import annotations

import itertools

import numpy as np
import pytest

from lookdev.asset.bounds import bounding_sphere
from lookdev.asset.mesh import Instance, Mesh


def cloud(points):
    points = np.asarray(points, np.float32)
    none = np.zeros(0, np.int32)
    return Mesh("cloud", points, none, none, none, np.zeros((0, 3), "f"), np.zeros((0, 3), "f"), {})


def sphere_of(points, *matrices):
    return bounding_sphere([cloud(points)], [Instance(0, matrix) for matrix in matrices or (np.eye(4),)])


def moved(x, y, z, scale=1.0):
    matrix = np.diag([scale, scale, scale, 1.0])
    matrix[:3, 3] = x, y, z
    return matrix


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


@pytest.mark.parametrize("seed", range(8))
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
    center, radius = sphere_of(CUBE, moved(-4, 0, 0), moved(6, 0, 0, scale=3.0), moved(1, 0, 0))
    everything = np.concatenate([np.add(CUBE, [-4, 0, 0]), np.add(CUBE * 3, [6, 0, 0]), np.add(CUBE, [1, 0, 0])])
    expected_center, expected_radius = sphere_of(everything)
    np.testing.assert_allclose(center, expected_center, atol=1e-5)
    assert radius == pytest.approx(expected_radius, rel=1e-6)


def test_mirrored_and_sheared_instances_are_contained():
    matrix = np.array([[-2.0, 1.0, 0, 5], [0, 1, 0, 0], [0, 3, 0.5, 0], [0, 0, 0, 1]])
    center, radius = sphere_of(CUBE, matrix)
    world = CUBE @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.linalg.norm(world - center, axis=1).max() == pytest.approx(radius, rel=1e-12)
