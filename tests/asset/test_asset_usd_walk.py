"""What of a stage is shown, where and when: units, transforms, instances in instances, time, visibility, purpose."""

import numpy as np
import pytest
from asset_arrays import world_points
from pxr import Gf, Sdf, UsdGeom, Vt
from usd_file import CUBE_POINTS, TYPES, primvar

from lookdev.asset import load_asset
from lookdev.errors import AssetError, StageError

pytestmark = pytest.mark.both_pythons


def means(asset):
    return np.array([points.mean(axis=0) for points in world_points(asset)])


def paths(asset):
    return [instance.path for instance in asset.instances]


def numbers(asset):
    return [instance.mesh for instance in asset.instances]


def test_up_axis_and_units_become_z_and_metres(file):
    UsdGeom.SetStageUpAxis(file.stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(file.stage, 0.01)
    UsdGeom.Xformable(file.mesh("/World/Cube")).AddTranslateOp().Set((100.0, 200.0, 300.0))
    asset = file.load()
    assert asset.unit == 0.01
    # Object space has its z axis up, too.
    x, y, z = np.transpose(CUBE_POINTS) * 0.01
    np.testing.assert_allclose(asset.meshes[0].points, np.stack([x, -z, y], axis=-1), rtol=1e-6)
    np.testing.assert_allclose(world_points(asset)[0], np.stack([x + 1, -z - 3, y + 2], axis=-1), atol=1e-6)


def nest_instances(file):
    """/World/A and B, instances of /Big, in which X and Y are instances of /Small, which holds a cube."""
    file.mesh("/Small/Cube")
    for number, prim in enumerate(file.instances("/Small", "/Big/X", "/Big/Y"), 1):
        prim.AddTranslateOp().Set((number, 0.0, 0.0))
    for number, prim in enumerate(file.instances("/Big", "/World/A", "/World/B"), 1):
        prim.AddTranslateOp().Set((0.0, 10.0 * number, 0.0))


def test_nested_instances_are_one_mesh(file):
    nest_instances(file)
    asset = file.read()
    assert len(asset.meshes) == 1
    expected = {f"/World/{a}/{b}/Cube": (x, y, 0) for a, y in (("A", 10), ("B", 20)) for b, x in (("X", 1), ("Y", 2))}
    assert paths(asset) == list(expected)
    np.testing.assert_allclose(means(asset), list(expected.values()), atol=1e-6)
    assert [slot.path for slot in asset.slots] == ["/World/A/X/Cube"]
    assert paths(file.read(prim="/World/B/Y")) == ["/World/B/Y/Cube"]


def test_instancers_of_instances_of_instancers(file):
    file.mesh("/Leaf/Cube")
    file.instancer("/Tree/Leaves", ["/Leaf"], [(0, 0, 1), (0, 0, 2)])
    for number, prim in enumerate(file.instances("/Tree", "/Wood/First", "/Wood/Second"), 1):
        prim.AddTranslateOp().Set((number, 0.0, 0.0))
    for name in ("Leaf", "Wood"):
        file.stage.GetPrimAtPath(f"/{name}").SetSpecifier(Sdf.SpecifierClass)
    outer = file.instancer("/World/Woods", ["/Wood"], [(0, 10, 0), (0, 20, 0), (0, 30, 0)])
    UsdGeom.Xformable(outer).AddScaleOp().Set((2.0, 2.0, 2.0))
    asset = file.read()
    assert (len(asset.meshes), len(asset.instances)) == (1, 12)
    expected = sorted((2 * x, 2 * y, 2 * z) for x in (1, 2) for y in (10, 20, 30) for z in (1, 2))
    np.testing.assert_allclose(sorted(map(tuple, means(asset).round(3))), expected, atol=1e-3)
    assert set(paths(asset)) == {"/Leaf/Cube"}


def scatter_instances(file, specifier=Sdf.SpecifierOver):
    """Cubes, the first of them turned and doubled, and a square, by an instancer at a height of 100."""
    cube = file.mesh("/World/Scatter/Protos/Cube")
    UsdGeom.Xformable(cube).AddTranslateOp().Set((0.0, 1.0, 0.0))
    UsdGeom.Xform.Define(file.stage, "/Library/Group").AddTranslateOp().Set((7.0, 0.0, 0.0))
    file.square("/Library/Group/Square")
    file.stage.GetPrimAtPath("/Library").SetSpecifier(specifier)
    prototypes = ["/World/Scatter/Protos/Cube", "/Library/Group"]
    places = [(10, 0, 0), (20, 0, 0), (30, 0, 0), (40, 0, 0)]
    instancer = file.instancer("/World/Scatter", prototypes, places, [0, 1, 0, 0])
    UsdGeom.Xformable(instancer).AddTranslateOp().Set((0.0, 0.0, 100.0))
    turned, straight = Gf.Quath(np.sqrt(0.5), 0, 0, np.sqrt(0.5)), Gf.Quath(1, 0, 0, 0)
    instancer.GetOrientationsAttr().Set(Vt.QuathArray([turned, straight, straight, straight]))
    instancer.GetScalesAttr().Set([(2, 2, 2), (1, 1, 1), (1, 1, 1), (1, 1, 1)])
    return instancer


@pytest.mark.parametrize("specifier", [Sdf.SpecifierOver, Sdf.SpecifierClass])
def test_point_instances(file, specifier):
    instancer = scatter_instances(file, specifier)
    instancer.GetInvisibleIdsAttr().Set([2])
    asset = file.load()
    assert [mesh.name for mesh in asset.meshes] == ["/World/Scatter/Protos/Cube", "/Library/Group/Square"]
    assert numbers(asset) == [0, 0, 1]
    turned, last, square = means(asset)
    # The prototype's translation along y, doubled and rotated by a quarter towards -x; the rotation is in half floats.
    np.testing.assert_allclose(turned, (8.0, 0.0, 100.0), atol=2e-2)
    np.testing.assert_allclose(last, (40.0, 1.0, 100.0), atol=1e-5)
    np.testing.assert_allclose(square, (28.0, 0.5, 100.0), atol=1e-5)
    assert np.ptp(world_points(asset)[0], axis=0) == pytest.approx([4, 4, 4], abs=1e-2)
    instancer.GetScalesAttr().Set([(0, 0, 0), (1, 1, 1), (1, 1, 1), (1, 1, 1)])
    assert numbers(file.load()) == [0, 1]  # what has no size is left out


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda i: i.GetPositionsAttr().Set([(0, 0, 0)]), "has 1 positions, but 4 protoIndices"),
        (lambda i: i.GetScalesAttr().Set([(1, 1, 1)] * 3), "has 3 scales, but 4 protoIndices"),
        (lambda i: i.GetProtoIndicesAttr().Set([0, 1, 2, 0]), r"protoIndices\[2\] is 2, but there are 2 prototypes"),
        (lambda i: i.GetPrototypesRel().SetTargets(["/None", "/Library/Group"]), "names /None, which is not there"),
        (lambda i: i.GetPrototypesRel().SetTargets(["/World", "/Library/Group"]), "which holds the instancer"),
    ],
)
def test_faults_of_an_instancer_are_located(file, spoil, message):
    spoil(scatter_instances(file))
    with pytest.raises(AssetError, match=r"thing\.usda: /World/Scatter: .*" + message):
        file.load()


def test_inactive_and_invisible_ids_are_left_out(file):
    file.mesh("/World/Grid/Proto")
    grid = file.instancer("/World/Grid", ["/World/Grid/Proto"], [(i, 0, 0) for i in range(6)])
    grid.GetIdsAttr().Set([10, 11, 12, 13, 14, 15])
    grid.DeactivateId(11)
    grid.GetInvisibleIdsAttr().Set([14], 1.0)
    grid.GetInvisibleIdsAttr().Set([10, 15], 5.0)
    np.testing.assert_allclose(means(file.read(time=1.0))[:, 0], [0, 2, 3, 5])
    np.testing.assert_allclose(means(file.read(time=5.0))[:, 0], [2, 3, 4])


def test_a_prototype_without_size_is_no_crash(file):
    file.mesh("/World/Grid/Proto/Cube")
    UsdGeom.Xform.Define(file.stage, "/World/Grid/Proto").AddScaleOp().Set((0.0, 0.0, 0.0))
    file.instancer("/World/Grid", ["/World/Grid/Proto"], [(0, 0, 0)])
    file.mesh("/World/Seen")
    asset = file.read()
    assert paths(asset) == ["/World/Seen"]
    assert asset.notes == (f"{file.path}: without volume, left out (1): /World/Grid/Proto/Cube",)


def test_instancers_that_hold_each_other_are_a_fault(file):
    file.mesh("/P/Cube")
    file.instancer("/P/ToQ", ["/Q"], [(0, 0, 0)])
    file.instancer("/Q/ToP", ["/P"], [(0, 0, 0)])
    with pytest.raises(AssetError, match=r"thing\.usda: /Q/ToP: prototypes names /P, which holds the instancer"):
        file.read()


def test_instancers_nest_so_deep_and_no_deeper(file):
    file.mesh("/P0/Cube")
    for i in range(1, 40):
        file.instancer(f"/P{i}/I", [f"/P{i - 1}"], [(1, 0, 0)])
    (deep,) = file.read(prim="/P32").instances
    np.testing.assert_allclose(deep.matrix[:3, 3], (32, 0, 0))
    with pytest.raises(AssetError, match="/P1/I: is an instancer inside 32 others; at most 31 would be right"):
        file.read(prim="/P33")


def test_constant_primvars_from_outside_an_instance_are_its_own(file):
    nest_instances(file)
    for path, value in (("/World", 1.0), ("/World/B", 2.0)):
        primvar(file.stage.GetPrimAtPath(path), "wear", TYPES.FloatArray, "constant", [value])
    primvar(file.stage.GetPrimAtPath("/World/B"), "displayColor", TYPES.Color3fArray, "constant", [(1, 0, 0)])
    asset = file.read()
    assert numbers(asset) == [0, 0, 1, 1]
    first, second = asset.meshes
    assert list(first.primvars) == ["wear"]
    np.testing.assert_array_equal(first.primvars["wear"], np.ones(24))
    np.testing.assert_array_equal(second.primvars["wear"], np.full(24, 2.0))
    np.testing.assert_array_equal(second.primvars["displayColor"], np.tile([1.0, 0.0, 0.0], (24, 1)))
    assert second.points is first.points


@pytest.mark.parametrize(
    ("start", "time", "size"),
    [(None, None, 7.0), (9.0, None, 9.0), (9.0, 7.0, 7.0), (None, 8.0, 8.0), (None, 99.0, 9.0)],
)
def test_the_time_is_the_given_one_else_the_start_of_the_stage_else_the_earliest(file, start, time, size):
    points = file.mesh("/Cube").GetPointsAttr()
    for sample in (7.0, 9.0):
        points.Set([Gf.Vec3f(*point) * sample for point in CUBE_POINTS], sample)
    if start is not None:
        file.stage.SetStartTimeCode(start)
    assert file.read(time=time).radius == pytest.approx(size * np.sqrt(3))


def test_visibility_is_that_of_the_time(file):
    file.mesh("/A")
    visibility = UsdGeom.Imageable(file.mesh("/B").GetPrim()).GetVisibilityAttr()
    visibility.Set("inherited", 1.0)
    visibility.Set("invisible", 2.0)
    assert paths(file.read(time=1.5)) == ["/A", "/B"]
    assert paths(file.read(time=2.0)) == ["/A"]


@pytest.mark.parametrize(
    ("purposes", "seen"),
    [(("default", "render"), ["/D", "/R"]), (("default", "proxy"), ["/D", "/P"]), (("guide",), ["/G", "/G/Below"])],
)
def test_purposes_are_the_given_ones_and_inherited(file, purposes, seen):
    for path, purpose in (("/D", None), ("/R", "render"), ("/P", "proxy"), ("/G", "guide"), ("/G/Below", None)):
        mesh = file.mesh(path)
        if purpose:
            mesh.GetPurposeAttr().Set(purpose)
    assert paths(file.read(purposes=purposes)) == seen


def test_only_what_is_seen_counts(file):
    for name in ("Seen", "Hidden/Below", "Guide", "Off"):
        file.mesh(f"/World/{name}")
    UsdGeom.Imageable(UsdGeom.Xform.Define(file.stage, "/World/Hidden")).MakeInvisible()
    UsdGeom.Imageable(file.stage.GetPrimAtPath("/World/Guide")).GetPurposeAttr().Set("guide")
    file.stage.GetPrimAtPath("/World/Off").SetActive(False)
    file.mesh("/World/Empty", faces=[])
    assert paths(file.load()) == ["/World/Seen"]
    assert paths(file.load("/World/Hidden/Below")) == ["/World/Hidden/Below"]
    with pytest.raises(AssetError, match="has no surface to render below /World/Guide"):
        file.load("/World/Guide")


def test_a_transform_that_resets_the_stack_is_in_the_world(file):
    UsdGeom.Xform.Define(file.stage, "/World").AddTranslateOp().Set((5.0, 0.0, 0.0))
    mesh = UsdGeom.Xformable(file.mesh("/World/Cube"))
    mesh.AddTranslateOp().Set((0.0, 1.0, 0.0))
    mesh.SetResetXformStack(True)
    np.testing.assert_allclose(means(file.read()), [[0, 1, 0]])


def test_types_without_a_reader_are_named(file):
    file.mesh("/World/Cube")
    for i in range(5):
        file.stage.DefinePrim(f"/World/Smoke{i}", "Volume")
    file.stage.DefinePrim("/World/Cloth", "AcmeCloth")
    assert file.read().notes == (
        f"{file.path}: of the type AcmeCloth, which USD does not know, not rendered (1): /World/Cloth",
        f"{file.path}: of type Volume, not rendered (5): /World/Smoke0, /World/Smoke1, /World/Smoke2, ...",
    )
    with pytest.raises(AssetError, match=r"has no surface to render below /World/Smoke1; .*; of type Volume"):
        file.read(prim="/World/Smoke1")


TRIANGLE = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
SQUARE = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]


def make_splash(file, velocities):
    """A triangle at frame 24, which rises by a unit a frame, and a square at 48, at 24 frames a second."""
    mesh = UsdGeom.Mesh.Define(file.stage, "/Splash")
    for time, points, speeds in ((24, TRIANGLE, velocities), (48, SQUARE, [(0.0, 0.0, 0.0)] * 4)):
        mesh.GetPointsAttr().Set(Vt.Vec3fArray(points), time)
        mesh.GetVelocitiesAttr().Set(Vt.Vec3fArray(speeds), time)
        mesh.GetFaceVertexCountsAttr().Set([len(points)], time)
        mesh.GetFaceVertexIndicesAttr().Set(list(range(len(points))), time)
    return mesh


@pytest.mark.parametrize(
    ("time", "expected"),
    [(None, 0.0), (24.0, 0.0), (30.0, 6.0), (47.5, 23.5), (48.0, 0.0)],
    ids=["earliest", "at a sample", "after it", "before the next", "at the next"],
)
def test_points_are_carried_from_the_sample_before(file, time, expected):
    make_splash(file, [(0.0, 0.0, 24.0)] * 3)
    (points,) = world_points(file.read(time=time))
    np.testing.assert_allclose(points[:, 2], expected, atol=1e-5)
    assert len(points) == (4 if time == 48.0 else 3)


@pytest.mark.parametrize("kind", ["Points", "BasisCurves", "NurbsCurves"])
def test_other_point_based_prims_are_carried_too(file, kind):
    prim = file.stage.DefinePrim("/Drop", kind)
    based = UsdGeom.PointBased(prim)
    based.GetPointsAttr().Set(Vt.Vec3fArray([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]), 24)
    based.GetVelocitiesAttr().Set(Vt.Vec3fArray([(0.0, 0.0, 24.0)] * 2), 24)
    if kind != "Points":
        prim.GetAttribute("curveVertexCounts").Set([2])
        prim.GetAttribute("widths").Set([0.5])
        prim.GetAttribute("type" if kind == "BasisCurves" else "order").Set("linear" if kind == "BasisCurves" else [2])
    if kind == "NurbsCurves":
        prim.GetAttribute("knots").Set([0.0, 0.0, 1.0, 1.0])
    heights = np.concatenate(world_points(file.read(time=30.0)))[:, 2]
    assert (heights.min() + heights.max()) / 2 == pytest.approx(6.0, abs=1e-5)


def test_instances_stay_at_the_earliest_time(file):
    file.mesh("/Set/Cube")
    instancer = file.instancer("/Set", ["/Set/Cube"], [(5.0, 0.0, 0.0)])
    instancer.GetPositionsAttr().Set(Vt.Vec3fArray([(5.0, 0.0, 0.0)]), 24)
    instancer.GetVelocitiesAttr().Set(Vt.Vec3fArray([(24.0, 0.0, 0.0)]), 24)
    for time, expected in ((None, 5.0), (30.0, 11.0)):
        np.testing.assert_allclose(means(file.read(time=time)), [(expected, 0.0, 0.0)], atol=1e-5)


@pytest.mark.parametrize("count", [0, 2, 4])
def test_velocities_that_do_not_fit_have_no_effect(file, count):
    make_splash(file, [(0.0, 0.0, 24.0)] * count)
    asset = file.read(time=30.0)
    np.testing.assert_allclose(world_points(asset)[0][:, 2], 0.0)
    assert count == 0 or "/Splash -- found" in " ".join(asset.notes)


def test_velocities_that_are_not_finite_are_a_fault(file):
    make_splash(file, [(0.0, np.nan, 24.0)] * 3)
    with pytest.raises(AssetError, match=r"/Splash: velocities\[0\] is nan"):
        file.read(time=30.0)


def cube(file):
    return UsdGeom.Xformable(file.stage.GetPrimAtPath("/Cube"))


SHEAR = Gf.Matrix4d(1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)
RADIUS = r"/Cube: the asset has a radius of "
FAULTS = [
    (lambda file: UsdGeom.SetStageMetersPerUnit(file.stage, -0.01), "metersPerUnit is -0.01; it must be"),
    (lambda file: UsdGeom.SetStageMetersPerUnit(file.stage, np.inf), "metersPerUnit is inf"),
    (lambda file: file.stage.SetMetadata("upAxis", "X"), "upAxis is 'X'; it must be Y or Z"),
    (lambda file: cube(file).AddTranslateOp().Set((np.nan, 0, 0)), "/Cube.xformOp:translate: its transform has a num"),
    (lambda file: cube(file).AddTransformOp().Set(SHEAR), "/Cube.xformOp:transform: its transform has"),
    (lambda file: UsdGeom.SetStageMetersPerUnit(file.stage, 1e10), RADIUS + r"1.73e\+10 m, with metersPerUnit 1e\+10"),
    (lambda file: UsdGeom.SetStageMetersPerUnit(file.stage, 1e-7), RADIUS + "1.73e-07 m.* 1e-06 to 1e.09 m can be"),
]


@pytest.mark.parametrize(("spoil", "message"), FAULTS)
def test_faults_of_a_stage(file, spoil, message):
    file.mesh("/Cube")
    spoil(file)
    with pytest.raises(AssetError, match=r"thing\.usda: " + message):
        file.read()


def test_tokens_that_usd_does_not_know_are_noted(file):
    for name in ("Shown", "Odd", "Collider"):
        file.mesh(f"/{name}")
    prims = [UsdGeom.Imageable(file.stage.GetPrimAtPath(path)) for path in ("/Odd", "/Collider")]
    prims[0].CreateVisibilityAttr("visible")
    prims[1].CreatePurposeAttr("collision")
    asset = file.read()
    assert [instance.path for instance in asset.instances] == ["/Shown", "/Odd"]
    notes = "\n".join(asset.notes)
    assert "with the visibility 'visible', which USD does not know, shown (1): /Odd" in notes
    assert "of the purpose 'collision', which USD does not know, not rendered (1): /Collider" in notes


def test_faults_of_the_options(file):
    file.mesh("/Cube")
    with pytest.raises(AssetError, match="the time is nan; it must be a number"):
        file.read(time=float("nan"))
    with pytest.raises(AssetError, match=r"there is no purpose 'rander' \(did you mean 'render'\?\)"):
        file.read(purposes=("rander",))


def test_all_faulty_meshes_are_reported_together(file):
    for i in range(30):
        file.mesh(f"/M{i:02}").GetHoleIndicesAttr().Set([9])
    file.mesh("/Rule").GetInterpolateBoundaryAttr().Set("never")
    with pytest.raises(AssetError, match=r"thing\.usda: /Rule: interpolateBoundary is 'never'"):
        file.read()
    file.stage.RemovePrim("/Rule")
    with pytest.raises(AssetError) as caught:
        file.read()
    lines = str(caught.value).splitlines()
    assert len(lines) == 21
    assert all(line.startswith(f"{file.path}: /M") for line in lines[:-1])
    assert lines[-1] == f"{file.path}: 10 more faults"


def test_operations_of_a_transform_that_are_not_there_are_noted(file):
    mesh = file.mesh("/Cube")
    mesh.AddTranslateOp().Set((1, 0, 0))
    mesh.GetXformOpOrderAttr().Set(["!resetXformStack!", "xformOp:scale", "xformOp:translate", "!invert!xformOp:scale"])
    asset = file.read()
    np.testing.assert_allclose(means(asset), [[1, 0, 0]])
    expected = [f"xformOpOrder names '{name}xformOp:scale', which is not there (1): /Cube" for name in ("", "!invert!")]
    assert asset.notes == tuple(f"{file.path}: {note}" for note in expected)


def test_a_transform_that_usd_cannot_compute_is_a_fault_of_its_prim(file, capfd):
    mesh = file.mesh("/World/Cube")
    mesh.GetPrim().CreateAttribute("xformOp:bend", Sdf.ValueTypeNames.Float).Set(1.0)
    mesh.GetXformOpOrderAttr().Set(["xformOp:bend"])
    with pytest.raises(AssetError, match=r"thing\.usda: /World/Cube.xformOpOrder: USD cannot compute .*'bend'"):
        file.read()
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("prim", "message"),
    [
        ("/World/Cub", r"thing.usda: /World/Cub: there is no such prim \(below /World there are: .*/Cube, .*/Looks\)"),
        ("/Word/Cube", r"/Word/Cube: there is no such prim \(below / there are: /World\)"),
        ("World/Cube", "is not the path of a prim"),
        ("/World//", "is not the path of a prim"),
    ],
)
def test_the_error_of_a_wrong_prim_lists_those_there(file, prim, message):
    file.mesh("/World/Cube")
    file.material("/World/Looks")
    with pytest.raises(StageError, match=message):
        file.load(prim)


@pytest.mark.parametrize("content", [None, "#usda 1.0\ndef Mesh {", "nothing"])
def test_a_file_that_is_not_usd_is_an_error(tmp_path, content):
    path = tmp_path / "broken.usda"
    if content is not None:
        path.write_text(content)
    with pytest.raises(StageError, match=r"broken\.usda: (USD cannot open it|no such file)"):
        load_asset(usd=path)
