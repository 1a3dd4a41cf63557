"""USD files of a size that production has: a mesh of a million faces, ten thousand instances, thousands of meshes."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from lookdev.arrays import Floats

_ROOT = "/World"
_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)), np.float32)
_BOX = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]], np.int32)
_UVS = np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32), (len(_BOX), 1))


def write_quads(file: Path, side: int = 1000) -> None:
    """Write a wavy square of ``side^2`` quads, 2 m wide."""
    stage = _new_stage(file)
    _define_sheet(stage, f"{_ROOT}/sheet", side)
    stage.Save()


def write_instances(file: Path, side: int = 100, faces: int = 100) -> None:
    """Write a point instancer of ``side^2`` sheets, each of ``faces^2`` quads, beside one another in 2 m."""
    stage = _new_stage(file)
    instancer = UsdGeom.PointInstancer.Define(stage, f"{_ROOT}/many")
    _define_sheet(stage, f"{_ROOT}/many/sheet", faces)
    instancer.CreatePrototypesRel().SetTargets([f"{_ROOT}/many/sheet"])
    instancer.CreateProtoIndicesAttr(Vt.IntArray.FromNumpy(np.zeros(side * side, np.int32)))
    instancer.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(_places(side).astype(np.float32)))
    instancer.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(np.full((side * side, 3), 0.4 / side, np.float32)))
    stage.Save()


def write_meshes(file: Path, count: int = 20_000) -> None:
    """Write so many boxes, each a mesh, a hundred to a group, beside one another in 2 m."""
    stage = _new_stage(file)
    side = int(np.ceil(np.sqrt(count)))
    for number, place in enumerate(_places(side)[:count].tolist()):
        path = f"{_ROOT}/group{number // 100}"
        if number % 100 == 0:
            UsdGeom.Xform.Define(stage, path)
        mesh = _define_mesh(stage, f"{path}/box{number}", _CORNERS * (0.8 / side), _BOX, _UVS, "faceVarying")
        mesh.AddTranslateOp().Set(Gf.Vec3d(place))
    stage.Save()


def _new_stage(file: Path) -> Any:
    """Return a stage, z up, in metres, whose root binds a preview surface to all below it."""
    stage = Usd.Stage.CreateNew(str(file))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, _ROOT).GetPrim()
    material = UsdShade.Material.Define(stage, f"{_ROOT}/Grey")
    shader = UsdShade.Shader.Define(stage, f"{_ROOT}/Grey/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0.4, 0.4, 0.4))
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(root).Bind(material)
    return stage


def _places(side: int) -> Floats:
    """Return the middles of the cells of a square of 2 m."""
    along = (2.0 * np.arange(side) + 1.0) / side - 1.0
    x, y = np.meshgrid(along, along)
    return np.stack([x.ravel(), y.ravel(), np.zeros(side * side)], axis=-1)


def _define_sheet(stage: Any, path: str, side: int) -> None:
    u, v = np.meshgrid(*[np.linspace(0.0, 1.0, side + 1)] * 2)
    heights = 0.05 * np.sin(20.0 * u) * np.cos(17.0 * v)
    points = np.stack([2.0 * u - 1.0, 2.0 * v - 1.0, heights], axis=-1).reshape(-1, 3)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    faces = np.stack([first, first + 1, first + side + 2, first + side + 1], axis=-1)
    _define_mesh(stage, path, points, faces, np.stack([u, v], axis=-1).reshape(-1, 2), "vertex")


def _define_mesh(
    stage: Any, path: str, points: NDArray[Any], faces: NDArray[Any], uvs: NDArray[Any], uvs_of: str
) -> Any:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), faces.shape[1], np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.astype(np.int32).ravel()))
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, uvs_of)
    st.Set(Vt.Vec2fArray.FromNumpy(uvs.astype(np.float32)))
    return mesh
