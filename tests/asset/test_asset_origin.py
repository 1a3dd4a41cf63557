"""An asset moved to the origin, where float32 is precise, has the same surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from asset_arrays import world_points
from numpy.typing import NDArray

from lookdev.asset import Asset, Instance
from lookdev.asset.bounds import about_origin, bounding_sphere
from lookdev.asset.builtin import make_sphere
from lookdev.asset.store import make_asset

FAR = np.array([1e5, -5e4, 2e4])


def pair(at: NDArray[np.float64], scale: float = 1.0) -> Asset:
    ball = make_sphere(segments=16, rings=8)
    instances = []
    for size, place in ((1.0, (0.0, 0.0, 0.0)), (0.4, (1.2, -0.8, 0.5))):
        matrix = np.diag([size * scale] * 3 + [1.0])
        matrix[0, 1] = 0.3 * size * scale  # a shear
        matrix[:3, 3] = at + scale * np.array(place)
        instances.append(Instance(0, matrix))
    return make_asset("pair", ball.meshes, instances, ball.slots)


@pytest.mark.parametrize("scale", [1.0, 1e-4, 1e4])
def test_placements_far_away_lose_nothing(scale: float) -> None:
    asset = pair(FAR, scale)
    moved = about_origin(asset)
    assert moved.center == (0.0, 0.0, 0.0)
    assert (moved.radius, moved.digest) == (asset.radius, asset.digest)
    for there, here in zip(world_points(asset), world_points(moved), strict=True):
        # float64 at 1e5 has steps of 1.5e-11.
        np.testing.assert_allclose(here + asset.center, there, rtol=0.0, atol=1e-10 + 1e-7 * asset.radius)
    for matrix in (instance.matrix for instance in moved.instances):
        assert np.abs(matrix[:3, 3]).max() < 2.0 * asset.radius
        np.testing.assert_allclose(matrix.astype(np.float32), matrix, rtol=1e-7)
    center, radius = bounding_sphere(moved.meshes, moved.instances)
    assert np.linalg.norm(center) < 1e-5 * asset.radius
    assert radius == pytest.approx(asset.radius, rel=1e-5)


def test_points_far_from_their_own_origin_come_near_it() -> None:
    ball = make_sphere(segments=16, rings=8)
    mesh = replace(ball.meshes[0], points=(ball.meshes[0].points + FAR).astype(np.float32))
    asset = make_asset("far", [mesh], [Instance(0, np.eye(4))], ball.slots)
    moved = about_origin(asset)
    assert np.abs(moved.meshes[0].points).max() < 1.1
    assert np.abs(moved.instances[0].matrix[:3, 3]).max() < 0.01
    np.testing.assert_allclose(world_points(moved)[0] + asset.center, world_points(asset)[0], rtol=0.0, atol=1e-6)
