"""A mesh of a USD file: faces, normals, primvars and slots."""

import time

import numpy as np
import pytest
from asset_arrays import facets
from pxr import Gf, Sdf, UsdGeom, UsdShade
from usd_file import CUBE_FACES, CUBE_POINTS, TYPES, primvar

from lookdev.asset import Slot
from lookdev.asset.tangents import tangents_of
from lookdev.asset.usd import read_usd
from lookdev.bench.scale import write_meshes, write_quads
from lookdev.errors import AssetError
from lookdev.stage import Composition, compose


def sideways(primvar):
    primvar.GetAttr().SetMetadata("interpolation", "sideways")  # UsdGeom's own function refuses it


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
    assert mesh.uvs == {}


def test_normals_are_smooth_unless_the_mesh_is_no_subdivision_surface(file):
    cube = file.mesh("/Cube")
    smooth = file.load().meshes[0]
    np.testing.assert_allclose(smooth.normals, smooth.points[smooth.corner_points] / np.sqrt(3), atol=1e-6)
    cube.GetSubdivisionSchemeAttr().Set("none")
    flat = file.load().meshes[0]
    np.testing.assert_allclose(flat.normals, facets(flat), atol=1e-7)


def test_a_left_handed_mesh_is_flipped_to_face_outwards(file):
    mirrored = np.ravel(np.reshape(CUBE_FACES, (-1, 4))[:, ::-1]).tolist()
    mesh = file.mesh("/Cube", faces=mirrored)
    mesh.GetOrientationAttr().Set("leftHanded")
    primvar(mesh, "corner", TYPES.FloatArray, "faceVarying", [float(i) for i in range(24)])
    (mesh,) = file.load().meshes
    assert ((mesh.points[mesh.corner_points] * facets(mesh)).sum(axis=1) > 0.99).all()
    np.testing.assert_array_equal(np.array(mirrored)[mesh.primvars["corner"].astype(int)], mesh.corner_points)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_authored_normals_end_up_on_the_side_of_the_winding(file, sign):
    mesh = file.mesh("/Cube")
    mesh.GetSubdivisionSchemeAttr().Set("none")
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
    mesh.GetSubdivisionSchemeAttr().Set("none")
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
    np.testing.assert_allclose(tangents_of([got])[0], np.tile([0.0, 1.0, 0.0], (8, 1)), atol=1e-6)  # along st's u


@pytest.mark.parametrize("up", ["y", "z"])
def test_without_uvs_tangents_follow_the_longitude_about_the_up_axis(file, up):
    UsdGeom.SetStageUpAxis(file.stage, up.upper())
    file.mesh("/Cube", points=np.add(CUBE_POINTS, [5.0, 6.0, 7.0]).tolist()).GetSubdivisionSchemeAttr().Set("none")
    (mesh,) = file.load().meshes
    assert (mesh.uvs, mesh.default_uv) == ({}, "")
    middle = [5, 6, 7] if up == "z" else [5, -7, 6]
    x, y, _ = (mesh.points[mesh.corner_points] - middle).T
    around = np.stack([-y, x, 0 * x], axis=-1)
    # Counter-clockwise seen from above, in the facet: along the side on the sides, along the circle on the caps.
    expected = around - (around * mesh.normals).sum(axis=1, keepdims=True) * mesh.normals
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(tangents_of([mesh])[0], expected, atol=1e-6)


def test_holes_and_degenerate_faces_are_dropped(file):
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    mesh = file.mesh("/Mesh", points, [0, 1, 2, 0, 2, 3, 0, 1, 0, 1, 2, 1, 3, 0, 1, 2, 3], [3, 3, 2, 4, 1, 4])
    primvar(mesh, "face", TYPES.FloatArray, "uniform", [float(i) for i in range(6)])
    mesh.GetHoleIndicesAttr().Set([1])
    got = file.load().meshes[0]
    np.testing.assert_array_equal(got.face_sizes, [3, 4])
    np.testing.assert_array_equal(got.corner_points, [0, 1, 2, 0, 1, 2, 3])
    np.testing.assert_array_equal(got.primvars["face"], [0, 0, 0, 5, 5, 5, 5])


def test_subsets_and_bindings_become_slots(file):
    api = UsdShade.MaterialBindingAPI.Apply(file.mesh("/World/Cube").GetPrim())
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


def attribute(name, *values):
    """Return a function that sets an attribute of a mesh."""
    return lambda mesh: mesh.GetPrim().GetAttribute(name).Set(*values)


def texture(interpolation, count, *indices):
    """Return a function that gives a mesh a UV set."""
    return lambda mesh: primvar(mesh, "st", TYPES.TexCoord2fArray, interpolation, [(0, 0)] * count, *indices)


def lid(*faces):
    return lambda mesh: UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset("lid", faces)


INTERPOLATIONS = "known: constant, uniform, varying, vertex, faceVarying"


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (attribute("faceVertexCounts", [4] * 5), "add up to 20 corners, faceVertexIndices has 24"),
        (attribute("faceVertexCounts", [28, -4]), "add up to 24 corners"),
        (attribute("faceVertexIndices", [8, *CUBE_FACES[1:]]), r"\[0\] is 8, but there are 8 points"),
        (attribute("faceVertexIndices", [0, -1, *CUBE_FACES[2:]]), r"\[1\] is -1"),
        (attribute("holeIndices", [6]), r"holeIndices\[0\] is 6, but there are 6 faces"),
        (attribute("points", [*CUBE_POINTS[:-1], (0, np.nan, 0)]), r"points\[7\] is not a number of metres"),
        (attribute("points", Sdf.ValueBlock()), r"faceVertexIndices\[0\] is 0, but there are no points"),
        (attribute("normals", [(0, 0, 1)] * 7), "normals has 7 values; interpolation 'vertex' needs 8"),
        (attribute("normals", [(0, 0, 1)] * 7 + [(0, 0, np.nan)]), r"normals\[7\] is nan"),
        (lambda m: sideways(texture("vertex", 8)(m)), f"st has interpolation 'sideways'; {INTERPOLATIONS}"),
        (texture("faceVarying", 8), "primvars:st has 8 values; interpolation 'faceVarying' needs 24"),
        (texture("vertex", 2, [0] * 7 + [2]), r"primvars:st:indices\[7\] is 2, but there are 2 values"),
        (lambda m: primvar(m, "wear", TYPES.FloatArray, "constant", [np.inf]), "wear: value 0 is not finite"),
        (lid(6), r"indices\[0\] is 6, but there are 6 faces"),
    ],
)
def test_faults_of_a_mesh_are_located(file, spoil, message):
    mesh = file.mesh("/World/Cube")
    mesh.GetSubdivisionSchemeAttr().Set("none")
    spoil(mesh)
    with pytest.raises(AssetError, match=r"thing\.usda: /World/Cube(/lid)?: .*" + message):
        file.load()


def test_subsets_that_overlap_are_errors(file):
    api = UsdShade.MaterialBindingAPI.Apply(file.mesh("/Cube").GetPrim())
    api.CreateMaterialBindSubset("a", [0, 1])
    api.CreateMaterialBindSubset("b", [2, 1])
    with pytest.raises(AssetError, match="/Cube/b: face 1 is also in /Cube/a"):
        file.load()


SETS = {
    "none": ({}, [], ""),
    "st": ({"map1": "TexCoord2fArray", "st": "TexCoord2fArray"}, ["st", "map1"], "st"),
    "st of two plain numbers": ({"a": "TexCoord2fArray", "st": "Float2Array"}, ["st", "a"], "st"),
    "the only one": ({"map1": "TexCoord2fArray"}, ["map1"], "map1"),
    "the only one, in halves": ({"UVMap": "TexCoord2hArray"}, ["UVMap"], "UVMap"),
    "the only one, in doubles": ({"UVMap": "TexCoord2dArray"}, ["UVMap"], "UVMap"),
    "the only one of its type": ({"flow": "Float2Array", "st0": "TexCoord2fArray"}, ["st0", "flow"], "st0"),
    "the only plain one": ({"flow": "Float2Array"}, ["flow"], "flow"),
    "two": ({"st0": "TexCoord2fArray", "st1": "TexCoord2fArray"}, ["st0", "st1"], ""),
    "two plain ones": ({"a": "Float2Array", "b": "Float2Array"}, ["a", "b"], ""),
    "of three numbers": ({"uvw": "TexCoord3fArray", "velocity": "Float3Array"}, ["uvw"], "uvw"),
}


@pytest.mark.parametrize(("kinds", "names", "default"), SETS.values(), ids=SETS)
def test_the_uv_set_for_looks_that_ask_for_another(file, kinds, names, default):
    mesh = file.square()
    for name, kind in kinds.items():
        width = 3 if "3" in kind else 2
        primvar(mesh, name, getattr(TYPES, kind), "vertex", [(0.5, 0.25, 9.0)[:width]] * 6)
    (got,) = file.read().meshes
    assert (list(got.uvs), got.default_uv) == (names, default)
    for uv in got.uvs.values():
        np.testing.assert_array_equal(uv, np.tile([0.5, 0.25], (8, 1)))


def test_a_constant_uv_set_is_inherited(file):
    file.square("/World/Square")
    primvar(file.stage.GetPrimAtPath("/World"), "map1", TYPES.TexCoord2fArray, "constant", [(0.5, 0.25)])
    (got,) = file.read().meshes
    assert got.default_uv == "map1"
    np.testing.assert_array_equal(got.uvs["map1"], np.tile([0.5, 0.25], (8, 1)))


def test_an_own_primvar_hides_an_inherited_one(file):
    for name in ("Own", "Free"):
        file.square(f"/World/{name}")
    primvar(file.stage.GetPrimAtPath("/World"), "wear", TYPES.FloatArray, "constant", [1.0])
    primvar(file.stage.GetPrimAtPath("/World"), "age", TYPES.Float, "constant", 4.0)
    primvar(file.stage.GetPrimAtPath("/World/Own"), "wear", TYPES.FloatArray, "vertex", [2.0] * 6)
    values = {mesh.name: {name: set(corners) for name, corners in mesh.primvars.items()} for mesh in file.read().meshes}
    assert values == {"/World/Own": {"wear": {2.0}, "age": {4.0}}, "/World/Free": {"wear": {1.0}, "age": {4.0}}}


@pytest.mark.parametrize("values", [[1.0, 2.0], [float("nan")]])
def test_a_faulty_inherited_primvar_is_a_fault(file, values):
    file.square("/World/Square")
    primvar(file.stage.GetPrimAtPath("/World"), "wear", TYPES.FloatArray, "constant", values)
    with pytest.raises(AssetError, match=r"thing\.usda: /World/Square: inherits primvars:wear"):
        file.read()


@pytest.mark.parametrize(
    ("attribute", "message"),
    [
        ("string[] points = ['a']", r"points is of type string\[\]; float3\[\] is needed"),
        ("float2[] points = [(0, 0)]", r"points is of type float2\[\]; float3\[\] is needed"),
        ("point3f points = (0, 0, 0)", r"points is of type float3; float3\[\] is needed"),
        ("int2[] faceVertexCounts = [(3, 3)]", r"faceVertexCounts is of type int2\[\]; int\[\] is needed"),
        ("string[] faceVertexIndices = ['0']", r"faceVertexIndices is of type string\[\]; int\[\] is needed"),
        ("float2[] primvars:normals = [(0, 0)]", "primvars:normals is of type float2"),
        ("uniform string orientation = 'left'", r"orientation is 'left' \((did you mean 'leftHanded'|known)"),
    ],
)
def test_attributes_of_the_wrong_type_are_faults(file, attribute, message):
    name = attribute.replace("uniform ", "").split()[1]
    sound = {
        "faceVertexCounts": "int[] faceVertexCounts = [3]",
        "faceVertexIndices": "int[] faceVertexIndices = [0, 1, 2]",
        "points": "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]",
        "subdivisionScheme": "uniform token subdivisionScheme = 'none'",
    }
    text = "\n    ".join({**sound, name: attribute}.values())
    file.stage.GetRootLayer().ImportFromString(f'#usda 1.0\ndef Mesh "M"\n{{\n    {text}\n}}\n')
    with pytest.raises(AssetError, match=r"thing\.usda: /M: " + message):
        file.read()


@pytest.mark.bench
@pytest.mark.parametrize(("write", "limit"), [(write_meshes, 5.0), (write_quads, 3.0)])
def test_twenty_thousand_small_meshes_and_a_million_quads_are_read_in_seconds(tmp_path, write, limit):
    write(tmp_path / "many.usdc")  # not the time to parse text
    start = time.thread_time()  # which other processes on the machine do not change much
    read_usd(compose(Composition(tmp_path / "many.usdc")))
    assert time.thread_time() - start < limit
