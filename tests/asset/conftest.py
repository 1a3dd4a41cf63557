"""What every mesh must be, whoever made it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from lookdev.asset import Asset


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))


def _check(asset: Asset) -> None:
    for mesh in asset.meshes:
        corners = int(mesh.face_sizes.sum())
        for array in (mesh.points, mesh.normals, mesh.tangents, *mesh.uvs.values(), *mesh.primvars.values()):
            assert array.dtype == np.float32
            assert np.isfinite(array).all()
        for array in (mesh.corner_points, mesh.face_sizes, mesh.face_slots):
            assert array.dtype == np.int32
        assert mesh.face_sizes.min() >= 3
        assert mesh.corner_points.shape == (corners,)
        assert 0 <= mesh.corner_points.min() <= mesh.corner_points.max() < len(mesh.points)
        assert mesh.face_slots.shape == mesh.face_sizes.shape
        assert 0 <= mesh.face_slots.min() <= mesh.face_slots.max() < len(asset.slots)
        assert mesh.normals.shape == mesh.tangents.shape == (corners, 3)
        assert mesh.uvs
        assert all(uv.shape == (corners, 2) for uv in mesh.uvs.values())
        # Three products of float32 unit components: a few rounding errors of 6e-8.
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=5e-7)
        np.testing.assert_allclose(np.linalg.norm(mesh.tangents, axis=1), 1.0, atol=5e-7)
        np.testing.assert_allclose((mesh.normals * mesh.tangents).sum(axis=1), 0.0, atol=5e-7)
    for instance in asset.instances:
        points = asset.meshes[instance.mesh].points @ instance.matrix[:3, :3].T + instance.matrix[:3, 3]
        # In float64 from float32 points: the sum of squares rounds in the last digits.
        assert np.linalg.norm(points - asset.center, axis=1).max() <= asset.radius * (1.0 + 1e-12)
    assert len(asset.digest) == 64


@pytest.fixture
def check_asset() -> Callable[[Asset], None]:
    """Return a function that asserts everything `lookdev.asset.mesh` promises."""
    return _check
