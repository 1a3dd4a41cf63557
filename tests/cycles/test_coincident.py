"""What coincides with a surface does not shadow it: faces, meshes and instances that are doubled show one surface."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lookdev.asset import Asset, Mesh, load_asset
from lookdev.asset.store import make_asset
from lookdev.material import Layer

pytestmark = pytest.mark.cycles

BACKENDS = ["exact", "nodes", "nodes-exact"]


def _again(mesh: Mesh, order: Any, side: float) -> Mesh:
    """Return a mesh with each face a second time, its corners in another order."""

    def twice(values: Any, sign: float = 1.0) -> Any:
        return np.concatenate([values, np.float32(sign) * values[order]])

    return replace(
        mesh,
        corner_points=np.concatenate([mesh.corner_points, mesh.corner_points[order]]),
        face_sizes=np.tile(mesh.face_sizes, 2),
        face_slots=np.tile(mesh.face_slots, 2),
        normals=twice(mesh.normals, side),
        tangents=None,
        uvs={name: twice(values) for name, values in mesh.uvs.items()},
    )


def doubled_faces(asset: Asset) -> Asset:
    return replace(asset, meshes=tuple(_again(mesh, slice(None), 1.0) for mesh in asset.meshes))


def reversed_faces(asset: Asset) -> Asset:
    meshes = []
    for mesh in asset.meshes:
        ends = np.cumsum(mesh.face_sizes)
        order = np.repeat(2 * ends - mesh.face_sizes - 1, mesh.face_sizes) - np.arange(len(mesh.corner_points))
        meshes.append(_again(mesh, order, -1.0))
    return replace(asset, meshes=tuple(meshes))


def doubled_meshes(asset: Asset) -> Asset:
    others = tuple(replace(each, mesh=each.mesh + len(asset.meshes)) for each in asset.instances)
    return replace(asset, meshes=asset.meshes * 2, instances=asset.instances + others)


def doubled_instances(asset: Asset) -> Asset:
    return replace(asset, instances=asset.instances * 2)


def with_a_gap(asset: Asset) -> Asset:
    """Return an asset with a larger copy, 1e-7 of its size above it."""
    grown = np.diag([1.0 + 1e-7] * 3 + [1.0])
    others = tuple(replace(each, matrix=grown @ each.matrix) for each in asset.instances)
    return replace(asset, instances=asset.instances + others)


def _of_size(asset: Asset, scale: float) -> Asset:
    """Return an asset that is `scale` times as large."""
    grown = np.diag([scale, scale, scale, 1.0])
    instances = [replace(each, matrix=grown @ each.matrix) for each in asset.instances]
    return make_asset(asset.name, asset.meshes, instances, asset.slots)


@pytest.mark.parametrize(
    ("double", "scale"),
    [
        *((double, 1.0) for double in (doubled_faces, reversed_faces, doubled_meshes, doubled_instances)),
        *((with_a_gap, scale) for scale in (1e-6, 1.0, 1e6)),
    ],
)
@pytest.mark.parametrize("backend", BACKENDS)
def test_coincident_surfaces_shade_as_one(render, light_of, double, scale: float, backend: str) -> None:
    single = load_asset(builtin="sphere")
    pictures = []
    for asset in (single, double(single)):
        frame = render(_of_size(asset, scale), [Layer("Base", "disney")], light_of("slopes"), size=24, backend=backend)
        pictures.append((frame.a + frame.b)[frame.alpha == 1.0])
    one, two = pictures
    # Where each is black, half of the pixels are.
    noise = 0.15 if backend == "nodes-exact" else 0.01
    np.testing.assert_allclose(two.mean(axis=0), one.mean(axis=0), rtol=noise / 5)
    assert np.sqrt(((two - one) ** 2).mean()) < noise * one.mean()


@pytest.mark.parametrize("backend", ["exact", "nodes"])
def test_light_between_coincident_surfaces_is_kept(render, light_of, backend: str) -> None:
    """Indirect light passes what coincides at both of its ends."""
    single = load_asset(builtin="shaderball")

    def mean(asset: Asset) -> float:
        layers = [Layer("Base", "disney")]
        frame = render(_of_size(asset, 1.0), layers, light_of("slopes"), backend=backend, bounces=4)
        return float(np.mean(frame.a + frame.b))

    assert mean(reversed_faces(single)) == pytest.approx(mean(single), rel=0.005)
