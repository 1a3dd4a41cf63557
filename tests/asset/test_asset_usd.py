from __future__ import annotations

import itertools

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from lookdev.asset import Slot, load_asset
from lookdev.asset.normals import area_vectors
from lookdev.errors import AssetError

CUBE_POINTS = [(x, y, z) for x, y, z in itertools.product((-1.0, 1.0), repeat=3)]
CUBE_FACES = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]  # counter-clockwise outside
TYPES = Sdf.ValueTypeNames


class File:
    """A stage in memory, z up and in metres until told otherwise, that is read back through a file."""

    def __init__(self, path):
        self.path = path
        self.stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)

    def mesh(self, path, points=CUBE_POINTS, faces=CUBE_FACES, sizes=None):
        mesh = UsdGeom.Mesh.Define(self.stage, path)
        mesh.GetPointsAttr().Set(Vt.Vec3fArray([Gf.Vec3f(*point) for point in points]))
        mesh.GetFaceVertexCountsAttr().Set(Vt.IntArray(sizes or [4] * (len(faces) // 4)))
        mesh.GetFaceVertexIndicesAttr().Set(Vt.IntArray(faces))
        return mesh

    def square(self, path="/Square"):
        """Two squares side by side in the plane z = 0: six points, two faces, eight corners."""
        points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
        return self.mesh(path, points, [0, 1, 4, 3, 1, 2, 5, 4])

    def material(self, path, *users):
        material = UsdShade.Material.Define(self.stage, path)
        for user in users:
            UsdShade.MaterialBindingAPI.Apply(self.stage.GetPrimAtPath(user)).Bind(material)
        return material

    def load(self, prim=None):
        self.stage.GetRootLayer().Save()
        return load_asset(usd=self.path, prim=prim)


@pytest.fixture
def file(tmp_path):
    return File(tmp_path / "thing.usda")


def primvar(mesh, name, kind, interpolation, values, indices=None):
    made = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(name, kind, interpolation)
    made.Set(values)
    if indices is not None:
        made.SetIndices(Vt.IntArray(indices))


def world_points(asset):
    return [
        asset.meshes[instance.mesh].points @ instance.matrix[:3, :3].T + instance.matrix[:3, 3]
        for instance in asset.instances
    ]


def facets(mesh):
    areas = area_vectors(mesh.points[mesh.corner_points].astype(np.float64), mesh.face_sizes)
    return np.repeat(areas / np.linalg.norm(areas, axis=1, keepdims=True), mesh.face_sizes, axis=0)


def test_a_bare_cube(file, check_asset):
    file.mesh("/World/Cube")
    asset = file.load()
    check_asset(asset)
    (mesh,) = asset.meshes
    assert (asset.name, mesh.name, asset.slots) == ("thing", "/World/Cube", (Slot("/World/Cube"),))
    np.testing.assert_array_equal(mesh.points, CUBE_POINTS)
    np.testing.assert_array_equal(mesh.corner_points, CUBE_FACES)
    np.testing.assert_array_equal(asset.instances[0].matrix, np.eye(4))
    assert asset.radius == pytest.approx(np.sqrt(3))
    assert not asset.convex
    assert list(mesh.uvs) == ["st"]


def test_normals_are_smooth_unless_the_mesh_is_no_subdivision_surface(file):
    file.mesh("/Cube")
    smooth = file.load().meshes[0]
    corners = smooth.points[smooth.corner_points]
    np.testing.assert_allclose(smooth.normals, corners / np.sqrt(3), atol=1e-6)
    UsdGeom.Mesh(file.stage.GetPrimAtPath("/Cube")).GetSubdivisionSchemeAttr().Set("none")
    flat = file.load().meshes[0]
    np.testing.assert_allclose(flat.normals, facets(flat), atol=1e-7)


def test_a_left_handed_mesh_is_turned_to_face_outwards(file, check_asset):
    mirrored = np.ravel(np.reshape(CUBE_FACES, (-1, 4))[:, ::-1]).tolist()
    mesh = file.mesh("/Cube", faces=mirrored)
    mesh.GetOrientationAttr().Set("leftHanded")
    primvar(mesh, "corner", TYPES.FloatArray, "faceVarying", [float(i) for i in range(24)])
    asset = file.load()
    check_asset(asset)
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
    order = list(reversed(range(count))) if indexed else list(range(count))
    indices = order if indexed else None
    numbers = np.array(order, float)  # in the file reversed, and the indices reverse it back
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
def test_without_uvs_the_mapping_is_spherical_about_the_up_axis(file, check_asset, up):
    UsdGeom.SetStageUpAxis(file.stage, up.upper())
    file.mesh("/Cube", points=np.add(CUBE_POINTS, [5.0, 6.0, 7.0]).tolist())
    asset = file.load()
    check_asset(asset)
    (mesh,) = asset.meshes
    height = (mesh.points[mesh.corner_points] - [5, 6, 7])[:, "xyz".index(up)]
    uv = mesh.uvs["st"]
    np.testing.assert_allclose(uv[:, 1], 0.5 + np.arctan2(height, np.sqrt(2)) / np.pi, atol=1e-6)
    for side in uv.reshape(-1, 4, 2)[np.ptp(height.reshape(-1, 4), axis=1) > 0]:
        assert np.ptp(side[:, 0]) == pytest.approx(0.25, abs=1e-6)  # a quarter turn, also across the seam


def test_up_axis_and_units_become_z_and_metres(file, check_asset):
    UsdGeom.SetStageUpAxis(file.stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(file.stage, 0.01)
    mesh = file.mesh("/World/Cube")
    UsdGeom.Xformable(mesh).AddTranslateOp().Set((100.0, 200.0, 300.0))
    asset = file.load()
    check_asset(asset)
    np.testing.assert_allclose(asset.meshes[0].points, np.multiply(CUBE_POINTS, 0.01), rtol=1e-6)
    x, y, z = np.transpose(CUBE_POINTS) * 0.01 + [[1.0], [2.0], [3.0]]
    np.testing.assert_allclose(world_points(asset)[0], np.stack([x, -z, y], axis=-1), atol=1e-6)


def test_transforms_of_parents_count(file):
    parent = UsdGeom.Xform.Define(file.stage, "/World")
    parent.AddRotateZOp().Set(90.0)
    UsdGeom.Xformable(file.mesh("/World/Cube")).AddTranslateOp().Set((5.0, 0.0, 0.0))
    np.testing.assert_allclose(file.load().center, (0.0, 5.0, 0.0), atol=1e-5)


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


def test_a_binding_of_an_ancestor_counts_and_the_full_purpose_wins(file):
    file.mesh("/World/Cube")
    file.material("/Looks/Preview", "/World")
    full = file.material("/Looks/Full")
    assert file.load().slots[0].material == "/Looks/Preview"
    api = UsdShade.MaterialBindingAPI(file.stage.GetPrimAtPath("/World"))
    api.Bind(full, materialPurpose=UsdShade.Tokens.full)
    assert file.load().slots[0].material == "/Looks/Full"


def instanced(file, *names):
    file.mesh("/Proto/Cube")
    file.material("/Proto/Looks/Own", "/Proto/Cube")
    file.stage.GetPrimAtPath("/Proto").SetSpecifier(Sdf.SpecifierClass)
    for i, name in enumerate(names):
        prim = UsdGeom.Xform.Define(file.stage, f"/World/{name}")
        prim.GetPrim().GetReferences().AddInternalReference("/Proto")
        prim.GetPrim().SetInstanceable(True)
        prim.AddTranslateOp().Set((10.0 * i, 0.0, 0.0))


def test_scenegraph_instances_share_their_mesh(file, check_asset):
    instanced(file, "A", "B", "C")
    asset = file.load()
    check_asset(asset)
    assert len(asset.meshes) == 1
    assert [instance.mesh for instance in asset.instances] == [0, 0, 0]
    np.testing.assert_allclose(
        [instance.matrix[:3, 3] for instance in asset.instances], np.outer([0, 10, 20], [1, 0, 0])
    )
    assert asset.slots == (Slot("/World/A/Cube", "/World/A/Looks/Own"),)
    assert asset.radius == pytest.approx(np.sqrt(11**2 + 2), rel=1e-6)
    assert file.load("/World/B").center == pytest.approx((10.0, 0.0, 0.0), abs=1e-5)


def test_instances_with_other_materials_do_not_share(file):
    instanced(file, "A", "B", "C")
    gold = file.material("/Looks/Gold")
    api = UsdShade.MaterialBindingAPI.Apply(file.stage.GetPrimAtPath("/World/B"))
    api.Bind(gold, UsdShade.Tokens.strongerThanDescendants)
    asset = file.load()
    assert [instance.mesh for instance in asset.instances] == [0, 1, 0]
    assert asset.slots == (Slot("/World/A/Cube", "/World/A/Looks/Own"), Slot("/World/B/Cube", "/Looks/Gold"))


def scattered(file, prototype_specifier=Sdf.SpecifierOver):
    instancer = UsdGeom.PointInstancer.Define(file.stage, "/World/Scatter")
    UsdGeom.Xformable(instancer).AddTranslateOp().Set((0.0, 0.0, 100.0))
    cube = file.mesh("/World/Scatter/Protos/Cube")
    UsdGeom.Xformable(cube).AddTranslateOp().Set((0.0, 1.0, 0.0))
    UsdGeom.Xform.Define(file.stage, "/Library/Group").AddTranslateOp().Set((7.0, 0.0, 0.0))
    file.square("/Library/Group/Square")
    file.stage.GetPrimAtPath("/Library").SetSpecifier(prototype_specifier)
    instancer.GetPrototypesRel().SetTargets(["/World/Scatter/Protos/Cube", "/Library/Group"])
    instancer.GetProtoIndicesAttr().Set([0, 1, 0, 0])
    instancer.GetPositionsAttr().Set([(10, 0, 0), (20, 0, 0), (30, 0, 0), (40, 0, 0)])
    half = np.sqrt(0.5)
    turned, straight = Gf.Quath(half, 0, 0, half), Gf.Quath(1, 0, 0, 0)
    instancer.GetOrientationsAttr().Set(Vt.QuathArray([turned, straight, straight, straight]))
    instancer.GetScalesAttr().Set([(2, 2, 2), (1, 1, 1), (1, 1, 1), (1, 1, 1)])
    return instancer


@pytest.mark.parametrize("specifier", [Sdf.SpecifierOver, Sdf.SpecifierClass])
def test_point_instances(file, check_asset, specifier):
    scattered(file, specifier).GetInvisibleIdsAttr().Set([2])
    asset = file.load()
    check_asset(asset)
    assert [mesh.name for mesh in asset.meshes] == ["/World/Scatter/Protos/Cube", "/Library/Group/Square"]
    assert [instance.mesh for instance in asset.instances] == [0, 0, 1]
    turned, last, square = (points.mean(axis=0) for points in world_points(asset))
    # The prototype's own step along y, doubled and turned a quarter towards -x; half floats in the rotation.
    np.testing.assert_allclose(turned, (8.0, 0.0, 100.0), atol=2e-2)
    np.testing.assert_allclose(last, (40.0, 1.0, 100.0), atol=1e-5)
    np.testing.assert_allclose(square, (28.0, 0.5, 100.0), atol=1e-5)
    assert np.ptp(world_points(asset)[0], axis=0) == pytest.approx([4, 4, 4], abs=1e-2)


def test_instances_of_no_size_are_left_out(file):
    scattered(file).GetScalesAttr().Set([(0, 0, 0), (1, 1, 1), (1, 1, 1), (1, 1, 1)])
    assert [instance.mesh for instance in file.load().instances] == [0, 0, 1]


def test_instancers_nest(file):
    scattered(file)
    outer = UsdGeom.PointInstancer.Define(file.stage, "/World/Outer")
    outer.GetPrototypesRel().SetTargets(["/World/Scatter"])
    outer.GetProtoIndicesAttr().Set([0, 0])
    outer.GetPositionsAttr().Set([(0, 1000, 0), (0, 2000, 0)])
    asset = file.load("/World/Outer")
    means = np.array([points.mean(axis=0) for points in world_points(asset)])
    assert [instance.mesh for instance in asset.instances] == [0] * 6 + [1] * 2
    np.testing.assert_allclose(means[-2:], [(28, 1000.5, 100), (28, 2000.5, 100)], atol=1e-3)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda i: i.GetPositionsAttr().Set([(0, 0, 0)]), "has 1 positions, but 4 protoIndices"),
        (lambda i: i.GetScalesAttr().Set([(1, 1, 1)] * 3), "has 3 scales, but 4 protoIndices"),
        (lambda i: i.GetProtoIndicesAttr().Set([0, 1, 2, 0]), r"protoIndices must lie in 0\.\.1"),
        (lambda i: i.GetPrototypesRel().SetTargets(["/None", "/Library/Group"]), "prototype /None is not there"),
        (lambda i: i.GetPrototypesRel().SetTargets(["/World", "/Library/Group"]), "holds the instancer itself"),
    ],
)
def test_faults_of_an_instancer_are_located(file, spoil, message):
    spoil(scattered(file))
    with pytest.raises(AssetError, match=r"thing\.usda: /World/Scatter: .*" + message):
        file.load()


def test_only_what_is_seen_counts(file):
    for name in ("Seen", "Hidden/Below", "Guide", "Proxy", "Render"):
        file.mesh(f"/World/{name}")
    UsdGeom.Imageable(UsdGeom.Xform.Define(file.stage, "/World/Hidden")).MakeInvisible()
    for name in ("Guide", "Proxy", "Render"):
        UsdGeom.Imageable(file.stage.GetPrimAtPath(f"/World/{name}")).GetPurposeAttr().Set(name.lower())
    file.mesh("/World/Off").GetPrim().SetActive(False)
    file.mesh("/World/Empty", faces=[])
    assert [mesh.name for mesh in file.load().meshes] == ["/World/Seen", "/World/Render"]
    assert [mesh.name for mesh in file.load("/World/Hidden/Below").meshes] == ["/World/Hidden/Below"]
    with pytest.raises(AssetError, match="has no surface to render below /World/Guide"):
        file.load("/World/Guide")


def test_animation_is_taken_at_its_start(file):
    points = file.mesh("/Cube").GetPointsAttr()
    for time in (7.0, 9.0):
        points.Set([Gf.Vec3f(*point) * time for point in CUBE_POINTS], time)
    assert file.load().radius == pytest.approx(7.0 * np.sqrt(3))


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


def test_subsets_that_overlap_are_told(file):
    api = UsdShade.MaterialBindingAPI.Apply(file.mesh("/Cube").GetPrim())
    api.CreateMaterialBindSubset("a", [0, 1])
    api.CreateMaterialBindSubset("b", [2, 1])
    with pytest.raises(AssetError, match="GeomSubset b: face 1 is also in /Cube/a"):
        file.load()


@pytest.mark.parametrize(
    ("prim", "message"),
    [
        ("/World/Cub", "there is no prim /World/Cub; below /World there are: /World/Cube, /World/Looks"),
        ("/Word/Cube", "there is no prim /Word/Cube; below / there are: /World"),
        ("World/Cube", "is not the path of a prim"),
        ("/World//", "is not the path of a prim"),
    ],
)
def test_a_wrong_prim_is_answered_with_the_right_ones(file, prim, message):
    file.mesh("/World/Cube")
    file.material("/World/Looks")
    with pytest.raises(AssetError, match=message):
        file.load(prim)


@pytest.mark.parametrize("content", [None, "#usda 1.0\ndef Mesh {", "nothing"])
def test_what_is_no_usd_file_is_told(tmp_path, content):
    path = tmp_path / "broken.usda"
    if content is not None:
        path.write_text(content)
    with pytest.raises(AssetError, match=r"broken\.usda: cannot be opened as USD"):
        load_asset(usd=path)
