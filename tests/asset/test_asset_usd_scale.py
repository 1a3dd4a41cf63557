"""How long reading takes: work is linear in prims and in faces."""

from __future__ import annotations

import time

import numpy as np
import pytest
from pxr import UsdGeom, Vt
from usd_file import CUBE_FACES, CUBE_POINTS, TYPES, primvar

from lookdev.asset.usd import read_usd
from lookdev.stage import Composition, compose


def seconds(file) -> float:
    """Return the time of this thread, which other processes on the machine do not change much."""
    path = file.path.with_suffix(".usdc")  # not the time to parse text
    file.stage.GetRootLayer().Export(str(path))
    start = time.thread_time()
    read_usd(compose(Composition(path)))
    return time.thread_time() - start


@pytest.mark.bench
def test_twenty_thousand_small_meshes_are_read_in_five_seconds(file):
    points, faces, sizes = Vt.Vec3fArray(CUBE_POINTS), Vt.IntArray(CUBE_FACES), Vt.IntArray([4] * 6)
    uvs = Vt.Vec2fArray([(0, 0), (1, 0), (1, 1), (0, 1)] * 6)
    for i in range(20_000):
        mesh = UsdGeom.Mesh.Define(file.stage, f"/World/Group{i // 100}/Cube{i}")
        mesh.GetPointsAttr().Set(points)
        mesh.GetFaceVertexIndicesAttr().Set(faces)
        mesh.GetFaceVertexCountsAttr().Set(sizes)
        primvar(mesh, "st", TYPES.TexCoord2fArray, "faceVarying", uvs)
        UsdGeom.XformCommonAPI(mesh).SetTranslate((i % 150, i // 150, 0.0))
    assert seconds(file) < 5.0


@pytest.mark.bench
def test_a_million_quads_of_a_cage_are_read_in_three_seconds(file):
    across = np.linspace(0.0, 1.0, 1001, dtype=np.float32)
    x, y = (each.ravel() for each in np.meshgrid(across, across))
    corner = (np.arange(1000)[:, None] * 1001 + np.arange(1000)).ravel().astype(np.int32)
    mesh = UsdGeom.Mesh.Define(file.stage, "/Mesh")
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(np.stack([x, y, np.sin(8.0 * x)], axis=-1)))
    quads = np.stack([corner, corner + 1, corner + 1002, corner + 1001], axis=-1)
    mesh.GetFaceVertexIndicesAttr().Set(Vt.IntArray.FromNumpy(quads.ravel()))
    mesh.GetFaceVertexCountsAttr().Set(Vt.IntArray(1_000_000, 4))
    primvar(mesh, "st", TYPES.TexCoord2fArray, "vertex", Vt.Vec2fArray.FromNumpy(np.stack([x, y], axis=-1)))
    assert seconds(file) < 3.0
