"""Coincident surfaces do not shadow each other: doubled faces, meshes and instances look like one surface."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from failed_pictures import comparison
from looks import quick_among

from lookdev.asset import Asset, Mesh, load_asset, make_asset
from lookdev.asset.builtin import make_sphere
from lookdev.material import Layer
from lookdev.scene import Pose

pytestmark = pytest.mark.cycles


def _repeat_faces(mesh: Mesh, order: Any, side: float) -> Mesh:
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
    return replace(asset, meshes=tuple(_repeat_faces(mesh, slice(None), 1.0) for mesh in asset.meshes))


def reversed_faces(asset: Asset) -> Asset:
    meshes = []
    for mesh in asset.meshes:
        ends = np.cumsum(mesh.face_sizes)
        order = np.repeat(2 * ends - mesh.face_sizes - 1, mesh.face_sizes) - np.arange(len(mesh.corner_points))
        meshes.append(_repeat_faces(mesh, order, -1.0))
    return replace(asset, meshes=tuple(meshes))


def doubled_meshes(asset: Asset) -> Asset:
    others = tuple(replace(instance, mesh=instance.mesh + len(asset.meshes)) for instance in asset.instances)
    return replace(asset, meshes=asset.meshes * 2, instances=asset.instances + others)


def doubled_instances(asset: Asset) -> Asset:
    return replace(asset, instances=asset.instances * 2)


def with_a_gap(asset: Asset) -> Asset:
    """Return an asset with a larger copy, 1e-7 of its size above it."""
    grown = np.diag([1.0 + 1e-7] * 3 + [1.0])
    others = tuple(replace(instance, matrix=grown @ instance.matrix) for instance in asset.instances)
    return replace(asset, instances=asset.instances + others)


DOUBLES = (doubled_faces, reversed_faces, doubled_meshes, doubled_instances, with_a_gap)


def _row(assets: Sequence[Asset], scale: float) -> Asset:
    """Return assets side by side, `scale` times as large."""
    meshes, instances = [], []
    for number, asset in enumerate(assets):
        matrix = np.diag([scale, scale, scale, 1.0])
        matrix[0, 3] = 2.5 * scale * (number - 0.5 * (len(assets) - 1))
        for instance in asset.instances:
            moved = replace(instance, mesh=instance.mesh + len(meshes), matrix=matrix @ instance.matrix)
            instances.append(moved)
        meshes += asset.meshes
    return make_asset("row", meshes, instances, assets[0].slots)


@pytest.mark.parametrize(
    ("scale", "backend"),
    quick_among(
        list(product([1e-6, 1.0, 1e6], ["exact", "nodes", "nodes-exact"])),
        [(1e6, "exact"), (1.0, "nodes"), (1e-6, "nodes-exact")],
    ),
)
def test_coincident_surfaces_shade_as_one(render, light_of, scale: float, backend: str) -> None:
    single, size = make_sphere(96, 48), 80
    # Without bounces: light reflected by neighbours has other noise where a ray hits another copy first.
    options = {"pose": Pose(0.0, 75.0), "size": size, "backend": backend, "bounces": 0}
    rows = [[single] * len(DOUBLES), [double(single) for double in DOUBLES]]
    once, twice = (render(_row(row, scale), [Layer("Base", "disney")], light_of("slopes"), **options) for row in rows)
    # Where each is black, half of the pixels are.
    noise = 0.15 if backend == "nodes-exact" else 0.01
    ends = np.linspace(0, size, len(DOUBLES) + 1).astype(int)
    with comparison(twice.a + twice.b, once.a + once.b):
        for double, left, right in zip(DOUBLES, ends[:-1], ends[1:], strict=True):
            ball = np.zeros((size, size), np.bool_)
            ball[:, left:right] = once.alpha[:, left:right] == 1.0
            assert np.count_nonzero(ball) > 60
            single_colors, double_colors = ((frame.a + frame.b)[ball] for frame in (once, twice))
            # Four standard errors of a mean over so many pixels.
            tolerance = 4.0 * noise / np.sqrt(np.count_nonzero(ball))
            np.testing.assert_allclose(
                double_colors.mean(axis=0), single_colors.mean(axis=0), rtol=tolerance, err_msg=double.__name__
            )
            assert np.sqrt(((double_colors - single_colors) ** 2).mean()) < noise * single_colors.mean(), (
                double.__name__
            )


@pytest.mark.parametrize("backend", ["exact", pytest.param("nodes", marks=pytest.mark.proof)])
def test_light_between_coincident_surfaces_is_kept(render, light_of, backend: str) -> None:
    """Indirect light passes surfaces that coincide with its start and with its end."""
    single = load_asset(builtin="shaderball")
    options = {"backend": backend, "bounces": 2, "samples": 32, "size": 32}

    def mean(asset: Asset) -> float:
        frame = render(_row([asset], 1.0), [Layer("Base", "disney")], light_of("slopes"), **options)
        return float(np.mean(frame.a + frame.b))

    # Four standard errors of the difference, by the halves; a tenth of the light is indirect.
    assert mean(reversed_faces(single)) == pytest.approx(mean(single), rel=0.02)
