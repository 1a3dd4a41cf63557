"""A mesh of a USD file: faces, normals, primvars and slots."""

from __future__ import annotations

import numpy as np
import pytest
from asset_arrays import facets
from pxr import Gf, UsdGeom, UsdShade
from usd_file import CUBE_FACES, CUBE_POINTS, TYPES, primvar

from lookdev.asset import Slot
from lookdev.errors import AssetError


def test_a_bare_cube(file):
    file.mesh("/World/Cube")
    asset = file.load()
    (mesh,) = asset.meshes
    assert (asset.name, mesh.name, asset.slots) == ("thing", "/World/Cube", (Slot("/World/Cube"),))
    np.testing.assert_array_equal(mesh.points, CUBE_POINTS)
    np.testing.assert_array_equal(mesh.corner_points, CUBE_FACES)
    np.testing.assert_array_equal(asset.instances[0].matrix, np.eye(4))
    assert asset.radius == pytest.approx(np.sqrt(3))
    assert not asset.convex
    assert list(mesh.uvs) == ["st"]


def test_normals_are_smooth_unless_the_mesh_is_no_subdivision_surface(file):
    cube = file.mesh("/Cube")
    smooth = file.load().meshes[0]
    corners = smooth.points[smooth.corner_points]
    np.testing.assert_allclose(smooth.normals, corners / np.sqrt(3), atol=1e-6)
    cube.GetSubdivisionSchemeAttr().Set("none")
    flat = file.load().meshes[0]
    np.testing.assert_allclose(flat.normals, facets(flat), atol=1e-7)


def test_a_left_handed_mesh_is_flipped_to_face_outwards(file):
    mirrored = np.ravel(np.reshape(CUBE_FACES, (-1, 4))[:, ::-1]).tolist()
    mesh = file.mesh("/Cube", faces=mirrored)
    mesh.GetOrientationAttr().Set("leftHanded")
    primvar(mesh, "corner", TYPES.FloatArray, "faceVarying", [float(i) for i in range(24)])
    asset = file.load()
    (mesh,) = asset.meshes
    assert ((mesh.points[mesh.corner_points] * facets(mesh)).sum(axis=1) > 0.99).all()
    np.testing.assert_array_equal(np.array(mirrored)[mesh.primvars["corner"].astype(int)], mesh.corner_points)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_authored_normals_end_up_on_the_side_of_the_winding(file, sign):
    mesh = file.mesh("/Cube")
    mesh.GetNormalsAttr().Set([Gf.Vec3f(*point) * (2.0 * sign) for point in CUBE_POINTS])
    mesh.SetNormalsInterpolation("vertex")
    got = file.load().meshes[0]
    np.testing.assert_allclose(got.normals, got.points[got.corner_points] / np.sqrt(3), atol=1e-6)


@pytest.mark.parametrize(
    ("interpolation", "count", "corners"),
    [
        ("constant", 1, [0] * 8),
        ("uniform", 2, [0, 0, 0, 0, 1, 1, 1, 1]),
        ("varying", 6, [0, 1, 4, 3, 1, 2, 5, 4]),
        ("vertex", 6, [0, 1, 4, 3, 1, 2, 5, 4]),
        ("faceVarying", 8, [0, 1, 2, 3, 4, 5, 6, 7]),
    ],
)
@pytest.mark.parametrize("indexed", [False, True])
def test_every_interpolation_reaches_the_corners(file, interpolation, count, corners, indexed):
    mesh = file.square()
    # In the file reversed, and the indices reverse it back.
    indices = list(reversed(range(count))) if indexed else None
    numbers = np.array(indices or range(count), float)
    primvar(mesh, "st", TYPES.TexCoord2fArray, interpolation, [(n, 2 * n) for n in numbers], indices)
    primvar(mesh, "wear", TYPES.FloatArray, interpolation, numbers.tolist(), indices)
    primvar(mesh, "tint", TYPES.Color3fArray, interpolation, [(n, n + 1, n + 2) for n in numbers], indices)
    primvar(mesh, "normals", TYPES.Normal3fArray, interpolation, [(n, 0, 10) for n in numbers], indices)
    got = file.load().meshes[0]
    expected = np.array(corners, float)
    np.testing.assert_array_equal(got.uvs["st"], np.stack([expected, 2 * expected], axis=-1))
    np.testing.assert_array_equal(got.primvars["wear"], expected)
    np.testing.assert_array_equal(got.primvars["tint"], np.stack([expected, expected + 1, expected + 2], axis=-1))
    normals = np.stack([expected, 0 * expected, 0 * expected + 10], axis=-1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(got.normals, normals, atol=1e-7)
    assert sorted(got.primvars) == ["tint", "wear"]


def test_which_primvars_become_uvs_and_which_stay_behind(file):
    mesh = file.square()
    flat = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    primvar(mesh, "map1", TYPES.Float2Array, "vertex", flat)
    primvar(mesh, "st", TYPES.TexCoord2fArray, "vertex", [(v, u) for u, v in flat])
    primvar(mesh, "uvw", TYPES.TexCoord3fArray, "vertex", [(u, v, 9) for u, v in flat])
    primvar(mesh, "half", TYPES.HalfArray, "constant", [0.5])
    primvar(mesh, "scalar", TYPES.Double, "constant", 0.25)
    primvar(mesh, "id", TYPES.IntArray, "constant", [3])
    primvar(mesh, "label", TYPES.StringArray, "constant", ["a"])
    primvar(mesh, "empty", TYPES.FloatArray, "vertex", [])
    got = file.load().meshes[0]
    assert list(got.uvs) == ["st", "map1", "uvw"]
    assert {name: values[0] for name, values in got.primvars.items()} == {"half": 0.5, "scalar": 0.25}
    np.testing.assert_array_equal(got.uvs["uvw"], got.uvs["map1"])
    np.testing.assert_allclose(got.tangents, np.tile([0.0, 1.0, 0.0], (8, 1)), atol=1e-6)  # along st's u


def test_primvars_are_inherited(file):
    file.square("/World/Square")
    primvar(file.stage.GetPrimAtPath("/World"), "wear", TYPES.FloatArray, "constant", [0.75])
    np.testing.assert_array_equal(file.load().meshes[0].primvars["wear"], [0.75] * 8)


@pytest.mark.parametrize("up", ["y", "z"])
def test_without_uvs_the_mapping_is_spherical_about_the_up_axis(file, up):
    UsdGeom.SetStageUpAxis(file.stage, up.upper())
    file.mesh("/Cube", points=np.add(CUBE_POINTS, [5.0, 6.0, 7.0]).tolist())
    asset = file.load()
    (mesh,) = asset.meshes
    height = (mesh.points[mesh.corner_points] - [5, 6, 7])[:, "xyz".index(up)]
    uv = mesh.uvs["st"]
    np.testing.assert_allclose(uv[:, 1], 0.5 + np.arctan2(height, np.sqrt(2)) / np.pi, atol=1e-6)
    for side in uv.reshape(-1, 4, 2)[np.ptp(height.reshape(-1, 4), axis=1) > 0]:
        assert np.ptp(side[:, 0]) == pytest.approx(0.25, abs=1e-6)  # a quarter turn, also across the seam


def test_holes_and_degenerate_faces_are_dropped(file):
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    faces = [0, 1, 2, 0, 2, 3, 0, 1, 0, 1, 2, 1, 3, 0, 1, 2, 3]
    mesh = file.mesh("/Mesh", points, faces, [3, 3, 2, 4, 1, 4])
    primvar(mesh, "face", TYPES.FloatArray, "uniform", [float(i) for i in range(6)])
    mesh.GetHoleIndicesAttr().Set([1])
    got = file.load().meshes[0]
    np.testing.assert_array_equal(got.face_sizes, [3, 4])
    np.testing.assert_array_equal(got.corner_points, [0, 1, 2, 0, 1, 2, 3])
    np.testing.assert_array_equal(got.primvars["face"], [0, 0, 0, 5, 5, 5, 5])


def test_subsets_and_bindings_become_slots(file):
    cube = file.mesh("/World/Cube")
    api = UsdShade.MaterialBindingAPI.Apply(cube.GetPrim())
    api.CreateMaterialBindSubset("lid", [5])
    api.CreateMaterialBindSubset("sides", [0, 1])
    api.CreateMaterialBindSubset("nothing", [])
    file.mesh("/World/Free")
    file.material("/Looks/Paint", "/World/Cube")
    file.material("/Looks/Gold", "/World/Cube/lid")
    asset = file.load()
    assert asset.slots == (
        Slot("/World/Cube", "/Looks/Paint"),
        Slot("/World/Cube/lid", "/Looks/Gold"),
        Slot("/World/Cube/sides", "/Looks/Paint"),
        Slot("/World/Free"),
    )
    np.testing.assert_array_equal(asset.meshes[0].face_slots, [2, 2, 0, 0, 0, 1])
    np.testing.assert_array_equal(asset.meshes[1].face_slots, [3] * 6)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda m: m.GetFaceVertexCountsAttr().Set([4] * 5), "add up to 20 corners, faceVertexIndices has 24"),
        (lambda m: m.GetFaceVertexCountsAttr().Set([28, -4]), "add up to 24 corners"),
        (lambda m: m.GetFaceVertexIndicesAttr().Set([8, *CUBE_FACES[1:]]), r"\[0\] is 8, but there are 8 points"),
        (lambda m: m.GetFaceVertexIndicesAttr().Set([0, -1, *CUBE_FACES[2:]]), r"\[1\] is -1"),
        (lambda m: m.GetHoleIndicesAttr().Set([6]), r"holeIndices\[0\] is 6, but there are 6 faces"),
        (lambda m: m.GetPointsAttr().Set([*CUBE_POINTS[:-1], (0, np.nan, 0)]), r"points\[7\] is not finite"),
        (lambda m: m.GetNormalsAttr().Set([(0, 0, 1)] * 7), "normals has 7 values; interpolation 'vertex' needs 8"),
        (
            lambda m: primvar(m, "st", TYPES.TexCoord2fArray, "faceVarying", [(0, 0)] * 8),
            "primvars:st has 8 values; interpolation 'faceVarying' needs 24",
        ),
        (
            lambda m: primvar(m, "st", TYPES.TexCoord2fArray, "vertex", [(0, 0)] * 2, [0] * 7 + [2]),
            r"primvars:st:indices\[7\] is 2, but there are 2 values",
        ),
        (
            lambda m: primvar(m, "wear", TYPES.FloatArray, "constant", [float("inf")]),
            "primvars:wear holds a value that is not finite",
        ),
        (
            lambda m: UsdShade.MaterialBindingAPI.Apply(m.GetPrim()).CreateMaterialBindSubset("lid", [6]),
            r"GeomSubset lid: indices\[0\] is 6, but there are 6 faces",
        ),
    ],
)
def test_faults_of_a_mesh_are_located(file, spoil, message):
    spoil(file.mesh("/World/Cube"))
    with pytest.raises(AssetError, match=r"thing\.usda: /World/Cube: .*" + message):
        file.load()


def test_subsets_that_overlap_are_errors(file):
    api = UsdShade.MaterialBindingAPI.Apply(file.mesh("/Cube").GetPrim())
    api.CreateMaterialBindSubset("a", [0, 1])
    api.CreateMaterialBindSubset("b", [2, 1])
    with pytest.raises(AssetError, match="GeomSubset b: face 1 is also in /Cube/a"):
        file.load()
