"""Primitives, curves, points and skinned prims of a file, as an asset."""

import numpy as np
import pytest
from asset_arrays import world_points
from pxr import Sdf, UsdGeom, UsdSkel
from usd_file import BENT, STRAIGHT, TYPES, Leg, primvar

from lookdev.asset.usd import primitives, walk
from lookdev.asset.usd.primitives import PRIMITIVES
from lookdev.errors import AssetError

pytestmark = pytest.mark.both_pythons


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_every_primitive_of_a_file(file, up):
    UsdGeom.SetStageUpAxis(file.stage, up)
    for number, kind in enumerate(PRIMITIVES):
        prim = file.stage.DefinePrim(f"/World/{kind}", kind)
        UsdGeom.Xformable(prim).AddTranslateOp().Set((4.0 * number, 0.0, 0.0))
        primvar(prim, "displayColor", TYPES.Color3fArray, "constant", [(0.1, 0.2, number)])
    asset = file.load()
    assert [mesh.name for mesh in asset.meshes] == [f"/World/{kind}" for kind in PRIMITIVES]
    assert asset.notes == ()
    for number, (mesh, points) in enumerate(zip(asset.meshes, world_points(asset), strict=True)):
        assert list(mesh.uvs) == ["st"]
        assert mesh.default_uv == "st"
        np.testing.assert_allclose(mesh.primvars["displayColor"], [[0.1, 0.2, number]] * len(mesh.normals), rtol=1e-6)
        np.testing.assert_allclose((points[:, 0].min() + points[:, 0].max()) / 2.0, 4.0 * number, atol=1e-6)
    # Axes are those of the file: the default spine, z, is upright only where z is up.
    spine = world_points(asset)[PRIMITIVES.index("Cone")][:, 2 if up == "Z" else 1]
    assert spine.max() == pytest.approx(1.0)
    assert abs(spine[np.abs(spine).argmax()]) == pytest.approx(1.0)


def test_equal_primitives_share_a_mesh_where_they_wear_the_same(file):
    for name, radius, color in (("A", 1.0, 0.5), ("B", 1.0, 0.5), ("C", 2.0, 0.5), ("D", 1.0, 0.6), ("E", 1.0, 0.5)):
        ball = UsdGeom.Sphere.Define(file.stage, f"/{name}")
        ball.GetRadiusAttr().Set(radius)
        primvar(ball, "wear", TYPES.Float, "constant", color)
    file.material("/Red", "/E")
    asset = file.load()
    assert [instance.mesh for instance in asset.instances] == [0, 0, 1, 2, 3]
    assert [slot.material for slot in asset.slots] == [None, None, None, "/Red"]
    assert [instance.path for instance in asset.instances] == ["/A", "/B", "/C", "/D", "/E"]


def test_many_different_spheres_share_the_faces(file, monkeypatch):
    monkeypatch.setattr(primitives, "_MAX_FACES", 40_000)
    for i in range(20):
        ball = UsdGeom.Sphere.Define(file.stage, f"/Ball{i}")
        ball.GetRadiusAttr().Set(1.0 + 0.001 * i)
        ball.AddScaleOp().Set((10, 10, 10) if i == 7 else (1, 1, 1))
    asset = file.load()
    counts = [len(asset.meshes[instance.mesh].face_sizes) for instance in asset.instances]
    assert sum(counts) == pytest.approx(40_000, rel=0.1)
    # As far from a sphere as the others, and ten times larger.
    assert counts[7] == pytest.approx(10 * counts[0], rel=0.1)
    # Those that are as fine are copies of one, each of its own size.
    assert len(asset.meshes) == len(set(counts)) == 2
    for i, points in enumerate(world_points(asset)):
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), (1.0 + 0.001 * i) * (10 if i == 7 else 1), rtol=1e-6)


def test_a_size_may_be_zero_and_must_be_a_number(file):
    file.mesh("/Cube")
    ball = UsdGeom.Sphere.Define(file.stage, "/Ball")
    ball.GetRadiusAttr().Set(0.0)
    asset = file.load()
    assert len(asset.meshes) == 1
    assert asset.notes == (f"{file.path}: without a face, left out (1): /Ball",)
    ball.GetRadiusAttr().Set(-1.0)
    with pytest.raises(AssetError, match=r"thing\.usda: /Ball: radius is -1; a number from 0"):
        file.load()


def test_a_primvar_that_varies_over_a_primitive_is_left_out_with_a_note(file):
    primvar(UsdGeom.Sphere.Define(file.stage, "/Ball"), "wear", TYPES.FloatArray, "vertex", [0.1, 0.2, 0.3])
    asset = file.load()
    assert asset.meshes[0].primvars == {}
    assert asset.notes == (f"{file.path}: with primvars:wear of 3 values, left out: one is carried (1): /Ball",)


def test_curves_are_tubes_with_their_primvars(file):
    UsdGeom.SetStageMetersPerUnit(file.stage, 0.01)
    hair = UsdGeom.BasisCurves.Define(file.stage, "/Hair")
    hair.GetPointsAttr().Set([(0, 0, 0), (0, 0, 1), (3, 0, 0), (3, 0, 1)])
    hair.GetCurveVertexCountsAttr().Set([2, 2])
    hair.GetTypeAttr().Set("linear")
    hair.GetWidthsAttr().Set([0.5])
    primvar(hair, "displayColor", TYPES.Color3fArray, "uniform", [(1, 0, 0), (0, 1, 0)])
    primvar(hair, "along", TYPES.FloatArray, "vertex", [0.0, 1.0, 2.0, 3.0])
    (mesh,) = file.load().meshes
    np.testing.assert_allclose(mesh.points.max(axis=0), [0.0325, 0.0025, 0.01], rtol=1e-6)
    x, _, z = mesh.points[mesh.corner_points].T
    np.testing.assert_array_equal(mesh.primvars["displayColor"][:, 1], x > 0.01)
    np.testing.assert_allclose(mesh.primvars["along"], 100.0 * z + np.where(x > 0.01, 2.0, 0.0), atol=1e-5)
    assert list(mesh.uvs) == ["st"]


def test_points_are_instances_of_a_sphere(file):
    UsdGeom.SetStageMetersPerUnit(file.stage, 0.1)
    dust = UsdGeom.Points.Define(file.stage, "/World/Dust")
    dust.GetPointsAttr().Set([(0, 0, 0), (1, 0, 0), (0, 2, 0)])
    dust.GetWidthsAttr().Set([1.0, 0.0, 4.0])
    UsdGeom.Xformable(dust).AddTranslateOp().Set((0, 0, 5))
    primvar(dust, "displayColor", TYPES.Color3fArray, "varying", [(1, 0, 0)] * 3)
    asset = file.load()
    assert len(asset.meshes) == 1
    assert [instance.path for instance in asset.instances] == ["/World/Dust"] * 2
    small, large = world_points(asset)
    assert_box(small, (-0.05, -0.05, 0.45), (0.05, 0.05, 0.55))
    assert_box(large, (-0.2, 0.0, 0.3), (0.2, 0.4, 0.7))
    note = "with primvars:displayColor of 3 values, left out: one is carried (1): /World/Dust"
    assert asset.notes == (f"{file.path}: {note}",)


def assert_box(points, low, high):
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [low, high], atol=1e-6)


STRIP = [(0, 0, 0), (1, 0, 0), (1, 0, 2), (0, 0, 2)], [0, 1, 2, 3]


@pytest.fixture
def leg(file):
    """A leg whose knee is bent by a right angle about x at (0, 0, 1)."""
    leg = Leg(file.stage)
    leg.animate("/Leg/Bend", ["hip/knee"], [1.0], [BENT])
    return leg


def test_a_skinned_mesh_is_posed_and_placed_by_its_skeleton(file, leg):
    mesh = file.mesh("/Leg/Skin", *STRIP)
    mesh.GetSubdivisionSchemeAttr().Set("none")
    mesh.GetNormalsAttr().Set([(0, -1, 0)] * 4)
    mesh.SetNormalsInterpolation("vertex")
    leg.bind(mesh, [0, 0, 1, 1])
    UsdGeom.Xformable(mesh).AddTranslateOp().Set((7, 7, 7))
    UsdGeom.Xformable(leg.skeleton).AddTranslateOp().Set((0, 0, 5))
    asset = file.load()
    np.testing.assert_allclose(world_points(asset)[0], [(0, 0, 5), (1, 0, 5), (1, -1, 6), (0, -1, 6)], atol=1e-6)
    np.testing.assert_allclose(asset.meshes[0].normals, [(0, -1, 0)] * 2 + [(0, 0, -1)] * 2, atol=1e-6)
    assert asset.notes == ()


def test_curves_points_and_primitives_are_posed_too(file, leg):
    hair = UsdGeom.BasisCurves.Define(file.stage, "/Leg/Hair")
    hair.GetPointsAttr().Set([(0, 0, 1), (0, 0, 2)])
    hair.GetCurveVertexCountsAttr().Set([2])
    hair.GetTypeAttr().Set("linear")
    hair.GetWidthsAttr().Set([0.2])
    dots = UsdGeom.Points.Define(file.stage, "/Leg/Dots")
    dots.GetPointsAttr().Set([(0, 0, 3)])
    ball = UsdGeom.Cube.Define(file.stage, "/Leg/Box")
    leg.bind(hair, [1, 1])
    leg.bind(dots, [1])
    leg.bind(ball, [1], constant=True)
    tube, dot, box = world_points(file.load())
    assert_box(tube, (-0.1, -1, 0.9), (0.1, 0, 1.1))
    np.testing.assert_allclose(dot.mean(axis=0), (0, -2, 1), atol=1e-4)
    assert_box(box, (-1, 0, 0), (1, 2, 2))


def test_instances_of_a_rig_share_a_mesh_only_in_the_same_pose(file, leg):
    leg.bind(file.mesh("/Leg/Skin", *STRIP), [0, 0, 1, 1])
    file.stage.GetPrimAtPath("/Leg").SetSpecifier(Sdf.SpecifierClass)
    leg.skeleton.GetPrim().RemoveProperty("skel:animationSource")
    leg.animate("/Straight", ["hip/knee"], [3.0], [STRAIGHT])
    for number, source in enumerate(("/Leg/Bend", "/Straight", "/Straight")):
        prim = UsdSkel.Root.Define(file.stage, f"/Crowd/Leg{number}")
        prim.GetPrim().GetReferences().AddInternalReference("/Leg")
        prim.GetPrim().SetInstanceable(True)
        prim.AddTranslateOp().Set((10.0 * number, 0, 0))
        UsdSkel.BindingAPI.Apply(prim.GetPrim()).CreateAnimationSourceRel().SetTargets([source])
    asset = file.load()
    assert [instance.mesh for instance in asset.instances] == [0, 1, 1]
    assert [float(points[:, 2].max()) for points in world_points(asset)] == pytest.approx([1.0, 4.0, 4.0])
    assert [float(points[:, 0].min()) for points in world_points(asset)] == pytest.approx([0.0, 10.0, 20.0])


def test_a_rig_may_be_a_prototype_of_points(file, leg):
    leg.bind(file.mesh("/Leg/Skin", *STRIP), [0, 0, 1, 1])
    UsdGeom.Xformable(leg.skeleton).AddTranslateOp().Set((0, 0, 5))
    file.instancer("/Crowd", ["/Leg"], [(100, 0, 0), (200, 0, 0)])
    file.stage.GetPrimAtPath("/Leg").SetSpecifier(Sdf.SpecifierClass)
    asset = file.load()
    assert len(asset.meshes) == 1
    assert [instance.matrix[:3, 3].tolist() for instance in asset.instances] == [[100.0, 0.0, 5.0], [200.0, 0.0, 5.0]]


def test_a_skeleton_outside_of_the_prototype_is_an_error(file, leg):
    leg.bind(file.mesh("/Leg/Part/Skin", [(0, 0, 0), (1, 0, 0), (1, 0, 2)], [0, 1, 2], [3]), [0, 0, 1])
    file.instancer("/Crowd", ["/Leg/Part"], [(1, 0, 0)])
    UsdGeom.Xform.Define(file.stage, "/Leg/Part")
    with pytest.raises(AssetError, match="/Leg/Part/Skin: /Leg/Bones moves it, but is not in its prototype /Leg/Part"):
        file.load()


def test_faults_of_rigs_are_reported_with_the_others(file, leg):
    leg.bind(file.mesh("/Leg/Skin"), [0] * 7)
    leg.bind(file.mesh("/Leg/Other"), [5] * 8)
    UsdGeom.Sphere.Define(file.stage, "/Ball").GetRadiusAttr().Set(float("nan"))
    with pytest.raises(AssetError) as caught:
        file.load()
    assert str(caught.value).splitlines() == [
        f"{file.path}: /Leg/Skin: has joints for 7 points, but 8 points",
        f"{file.path}: /Leg/Other: primvars:skel:jointIndices[0] is 5, but there are 2 joints; it must lie in 0..1",
        f"{file.path}: /Ball: radius is nan; a number from 0 to 1e+18 is needed",
    ]


def test_what_is_bound_in_vain_is_in_the_notes(file):
    UsdSkel.BindingAPI.Apply(file.mesh("/Cube").GetPrim())
    assert file.load().notes == (f"{file.path}: /Cube: is not below a SkelRoot, without which USD deforms nothing",)


def test_too_many_points_are_refused(file, monkeypatch):
    monkeypatch.setattr(walk, "_MAX_INSTANCES", 2)
    UsdGeom.Points.Define(file.stage, "/Dust").GetPointsAttr().Set([(i, 0, 0) for i in range(3)])
    with pytest.raises(AssetError, match=r"thing\.usda: /Dust: its 3 points are too many: an asset can have 2 inst"):
        file.load()
