"""A stage of a USD file: units, transforms, bindings, instances, visibility."""

from __future__ import annotations

import numpy as np
import pytest
from asset_arrays import world_points
from pxr import Gf, Sdf, UsdGeom, UsdShade, Vt
from usd_file import CUBE_POINTS

from lookdev.asset import Slot, load_asset
from lookdev.errors import AssetError, StageError


def test_up_axis_and_units_become_z_and_metres(file):
    UsdGeom.SetStageUpAxis(file.stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(file.stage, 0.01)
    mesh = file.mesh("/World/Cube")
    UsdGeom.Xformable(mesh).AddTranslateOp().Set((100.0, 200.0, 300.0))
    asset = file.load()
    assert asset.unit == 0.01
    # Object space has its z axis up, too.
    x, y, z = np.transpose(CUBE_POINTS) * 0.01
    np.testing.assert_allclose(asset.meshes[0].points, np.stack([x, -z, y], axis=-1), rtol=1e-6)
    np.testing.assert_allclose(world_points(asset)[0], np.stack([x + 1, -z - 3, y + 2], axis=-1), atol=1e-6)


def test_transforms_of_parents_count(file):
    parent = UsdGeom.Xform.Define(file.stage, "/World")
    parent.AddRotateZOp().Set(90.0)
    UsdGeom.Xformable(file.mesh("/World/Cube")).AddTranslateOp().Set((5.0, 0.0, 0.0))
    np.testing.assert_allclose(file.load().center, (0.0, 5.0, 0.0), atol=1e-5)


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


def test_scenegraph_instances_share_their_mesh(file):
    instanced(file, "A", "B", "C")
    asset = file.load()
    assert len(asset.meshes) == 1
    assert [instance.mesh for instance in asset.instances] == [0, 0, 0]
    offsets = [instance.matrix[:3, 3] for instance in asset.instances]
    np.testing.assert_allclose(offsets, np.outer([0, 10, 20], [1, 0, 0]))
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
def test_point_instances(file, specifier):
    scattered(file, specifier).GetInvisibleIdsAttr().Set([2])
    asset = file.load()
    assert [mesh.name for mesh in asset.meshes] == ["/World/Scatter/Protos/Cube", "/Library/Group/Square"]
    assert [instance.mesh for instance in asset.instances] == [0, 0, 1]
    turned, last, square = (points.mean(axis=0) for points in world_points(asset))
    # The prototype's translation along y, doubled and rotated by a quarter towards -x; the rotation is in half floats.
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
        (
            lambda i: i.GetProtoIndicesAttr().Set([0, 1, 2, 0]),
            r"protoIndices\[2\] is 2, but there are 2 prototypes; it must lie in 0\.\.1",
        ),
        (
            lambda i: i.GetPrototypesRel().SetTargets(["/None", "/Library/Group"]),
            "prototypes names /None, which is not there",
        ),
        (lambda i: i.GetPrototypesRel().SetTargets(["/World", "/Library/Group"]), "which holds the instancer"),
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
    ("prim", "message"),
    [
        (
            "/World/Cub",
            r"thing.usda: /World/Cub: there is no such prim \(below /World there are: /World/Cube, /World/Looks\)",
        ),
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
