"""UsdSkel: poses and blend shapes by hand, against USD's own baking, and every way in which a rig can be broken."""

import re

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt
from usd_file import BENT, JOINTS, STRAIGHT, UP, Leg

from lookdev.asset.shape import Attribute
from lookdev.asset.usd.skinning import Skinning
from lookdev.errors import AssetError

pytestmark = pytest.mark.both_pythons

HALF = np.sqrt(0.5)
POINTS = [(0, 0, 0), (0, 0, 1), (0, 0, 2), (1, 0, 2)]
EARLY = Usd.TimeCode.EarliestTime()


class Rig(Leg):
    """A leg with a skin; at time 10 its knee is bent by a right angle about x."""

    def __init__(self):
        super().__init__(Usd.Stage.CreateInMemory())
        self.animation = self.animate("/Leg/Bend", JOINTS, [0.0, 1.0])
        self.animation.GetRotationsAttr().Set([STRAIGHT] * 2, 0.0)
        self.animation.GetRotationsAttr().Set([STRAIGHT, BENT], 10.0)
        self.mesh = UsdGeom.Mesh.Define(self.stage, "/Leg/Skin")
        self.mesh.GetPointsAttr().Set(POINTS)
        self.mesh.GetFaceVertexCountsAttr().Set([4])
        self.mesh.GetFaceVertexIndicesAttr().Set([0, 3, 2, 1])
        self.bind(self.mesh, (0, 1) * 4, (1, 0, 1, 0, 0, 1, 0.5, 0.5), size=2)

    @property
    def skin(self):
        return self.api(self.mesh)

    def shape(self, name, offsets, indices=None, normals=None):
        """Add a blend shape to the mesh, whose weights are animated by `weigh`."""
        shape = UsdSkel.BlendShape.Define(self.stage, f"{self.mesh.GetPath()}/{name}")
        shape.GetOffsetsAttr().Set(offsets)
        if indices is not None:
            shape.GetPointIndicesAttr().Set(indices)
        if normals is not None:
            shape.GetNormalOffsetsAttr().Set(normals)
        self.skin.CreateBlendShapesAttr().Set([*(self.skin.GetBlendShapesAttr().Get() or []), name])
        self.skin.CreateBlendShapeTargetsRel().AddTarget(shape.GetPath())
        return shape

    def weigh(self, names, weights, time=None):
        self.animation.GetBlendShapesAttr().Set(names)
        self.animation.GetBlendShapeWeightsAttr().Set(weights, EARLY if time is None else time)

    def deformed(self, time=10.0, prim=None):
        return Skinning(Usd.TimeCode(time)).deform((prim or self.mesh).GetPrim())

    def world(self, time=10.0):
        """Return the deformed points in the world (n, 3)."""
        return in_world(self.deformed(time).points, self.deformed(time).space, time)

    def baked(self, time=10.0):
        """Return the points in the world (n, 3) and the normals of the mesh after USD has baked the skinning."""
        self.stage.SetEditTarget(self.stage.GetSessionLayer())
        assert UsdSkel.BakeSkinning(self.root, Gf.Interval(time, time))
        points = np.array(self.mesh.GetPointsAttr().Get(time), float)
        return in_world(points, self.mesh.GetPrim(), time), self.mesh.GetNormalsAttr().Get(time)


def in_world(points, prim, time):
    matrix = np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(prim), float)
    return np.column_stack([points, np.ones(len(points))]) @ matrix[:, :3]


@pytest.fixture
def rig():
    return Rig()


def test_a_bent_knee_linearly_and_by_dual_quaternions(rig):
    # About the knee, (0, 0, 1): (x, y, z) becomes (x, -z, y). The last point is the mean of staying and turning.
    np.testing.assert_allclose(rig.world(), [(0, 0, 0), (0, 0, 1), (0, -1, 1), (1, -0.5, 1.5)], atol=1e-6)
    use_dual_quaternions(rig)
    # Half of the way is half of the angle, which keeps the length.
    np.testing.assert_allclose(rig.world()[2:], [(0, -1, 1), (1, -HALF, 1 + HALF)], atol=1e-6)


def test_the_pose_is_that_of_the_time(rig):
    np.testing.assert_allclose(rig.world(0.0), POINTS, atol=1e-6)
    np.testing.assert_allclose(rig.world(5.0)[2], (0, -HALF, 1 + HALF), atol=1e-4)  # quaternions of 32 bits, slerped
    np.testing.assert_allclose(Skinning(EARLY).deform(rig.mesh.GetPrim()).points, POINTS, atol=1e-6)


def test_the_skeleton_places_the_points_and_the_mesh_does_not(rig):
    UsdGeom.Xformable(rig.mesh).AddTranslateOp().Set((7, 7, 7))
    UsdGeom.Xformable(rig.skeleton).AddTranslateOp().Set((0, 0, 5))
    UsdGeom.Xformable(rig.root).AddRotateZOp().Set(90.0)
    assert rig.deformed().space == rig.skeleton.GetPrim()
    assert Skinning(EARLY).placing_prim(rig.mesh.GetPrim()) == rig.skeleton.GetPrim()
    np.testing.assert_allclose(rig.world()[2], (1, 0, 6), atol=1e-6)


def place_gprim(rig):
    UsdGeom.Xformable(rig.mesh).AddTranslateOp().Set((1, 2, 3))
    UsdGeom.Xformable(rig.mesh).AddRotateYOp().Set(30.0)
    UsdGeom.Xformable(rig.skeleton).AddRotateXOp().Set(20.0)
    UsdGeom.Xformable(rig.root).AddScaleOp().Set((2, 3, 4))
    rig.skin.CreateGeomBindTransformAttr().Set(Gf.Matrix4d(1.0).SetTranslate((0.5, 0, 0.25)))


def reorder_joints(rig):
    rig.skin.CreateJointsAttr().Set(["hip/knee"])
    rig.skin.CreateJointIndicesPrimvar(False, 1).Set([0] * 4)
    rig.skin.CreateJointWeightsPrimvar(False, 1).Set([1.0] * 4)


def bind_whole(rig):
    rig.skin.CreateJointIndicesPrimvar(True, 2).Set([1, 0])
    rig.skin.CreateJointWeightsPrimvar(True, 2).Set([1.0, 0.0])
    for primvar in (rig.skin.GetJointIndicesPrimvar(), rig.skin.GetJointWeightsPrimvar()):
        primvar.SetInterpolation(UsdGeom.Tokens.constant)


def inherit_binding(rig):
    rig.mesh.GetPrim().RemoveProperty("skel:skeleton")
    rig.api(rig.root).CreateSkeletonRel().SetTargets(["/Leg/Bones"])
    rig.skeleton.GetPrim().RemoveProperty("skel:animationSource")
    rig.api(rig.root).CreateAnimationSourceRel().SetTargets(["/Leg/Bend"])


def sparse_animation(rig):
    rig.animation.GetJointsAttr().Set(["hip/knee"])
    rig.animation.GetTranslationsAttr().Set([(0, 0, 1.5)])
    rig.animation.GetScalesAttr().Set(Vt.Vec3hArray([Gf.Vec3h(1, 2, 1)]))
    rig.animation.GetRotationsAttr().Set([BENT], 10.0)


def remove_animation(rig):
    rig.skeleton.GetPrim().RemoveProperty("skel:animationSource")
    rig.skeleton.GetRestTransformsAttr().Set([UP, UP])


def use_dual_quaternions(rig):
    rig.skin.CreateSkinningMethodAttr().Set(UsdSkel.Tokens.dualQuaternion)


def add_blend_shape(rig):
    rig.shape("Bulge", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])
    shape = rig.shape("Tip", [(0, 0, 2), (2, 0, 0)], [2, 3])
    shape.CreateInbetween("half").SetWeight(0.5)
    shape.GetInbetween("half").SetOffsets([(0, 3, 0), (0, 0, 0)])
    rig.weigh(["Other", "Tip", "Bulge"], [0.9, 0.7, 0.3])
    rig.weigh(["Other", "Tip", "Bulge"], [0.9, 0.7, 0.3], 10.0)


WAYS = [
    (place_gprim,),
    (reorder_joints,),
    (bind_whole, place_gprim),
    (inherit_binding, place_gprim),
    (sparse_animation,),
    (remove_animation,),
    (add_blend_shape,),
]
WAYS += [
    (add_blend_shape, place_gprim),
    (use_dual_quaternions, place_gprim),
    (use_dual_quaternions, add_blend_shape, reorder_joints),
]


@pytest.mark.parametrize("ways", WAYS, ids=lambda ways: "-".join(way.__name__ for way in ways))
def test_as_usd_bakes_it(rig, ways):
    for way in ways:
        way(rig)
    mine = rig.world()
    assert np.ptp(mine, axis=0).max() > 0.5
    assert np.abs(mine - in_world(POINTS, rig.mesh.GetPrim(), 10.0)).max() > 0.1
    np.testing.assert_allclose(mine, rig.baked()[0], atol=2e-6)


@pytest.mark.parametrize("method", [UsdSkel.Tokens.classicLinear, UsdSkel.Tokens.dualQuaternion])
def test_a_random_rig_as_usd_bakes_it(method):
    rng = np.random.default_rng(16)
    rig = Rig()
    names = [f"a{i}" if i < 3 else f"a{i % 3}/b{i}" for i in range(12)]

    def random_matrix():
        axis = rng.normal(size=3).tolist()
        turn = Gf.Matrix4d(1.0).SetRotate(Gf.Rotation(Gf.Vec3d(*axis), rng.uniform(-90.0, 90.0)))
        return turn * Gf.Matrix4d(1.0).SetTranslate(Gf.Vec3d(*rng.normal(size=3).tolist()))

    rig.skeleton.GetJointsAttr().Set(names)
    rig.skeleton.GetBindTransformsAttr().Set([random_matrix() for _ in names])
    rig.skeleton.GetRestTransformsAttr().Set([random_matrix() for _ in names])
    rig.animation.GetJointsAttr().Set(names[::-1])
    rig.animation.GetTranslationsAttr().Set(Vt.Vec3fArray.FromNumpy(rng.normal(size=(12, 3)).astype(np.float32)))
    rig.animation.GetScalesAttr().Set(Vt.Vec3hArray([Gf.Vec3h(*rng.uniform(0.5, 2.0, 3).tolist()) for _ in names]))
    turns = [Gf.Quatf(Gf.Rotation(Gf.Vec3d(*rng.normal(size=3).tolist()), 50.0).GetQuat()) for _ in names]
    rig.animation.GetRotationsAttr().Set(turns, 10.0)
    weights = rng.uniform(size=(200, 4))
    weights /= weights.sum(axis=1, keepdims=True)
    rig.mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(rng.normal(size=(200, 3)).astype(np.float32)))
    rig.mesh.GetNormalsAttr().Set(Vt.Vec3fArray.FromNumpy(rng.normal(size=(200, 3)).astype(np.float32)))
    rig.mesh.SetNormalsInterpolation("vertex")
    rig.skin.CreateJointIndicesPrimvar(False, 4).Set(rng.integers(0, 12, 800).tolist())
    rig.skin.CreateJointWeightsPrimvar(False, 4).Set(weights.ravel().tolist())
    rig.skin.CreateSkinningMethodAttr().Set(method)
    rig.skin.CreateGeomBindTransformAttr().Set(random_matrix())
    mine = rig.world()
    normals = Attribute("normals", np.array(rig.mesh.GetNormalsAttr().Get()), "vertex")
    turned = rig.deformed().normals(normals, np.arange(200)).values
    points, baked = rig.baked()
    np.testing.assert_allclose(mine, points, atol=1e-5)
    baked = np.array(baked, float)  # without transforms, the space of the mesh is that of the skeleton
    np.testing.assert_allclose(turned, baked / np.linalg.norm(baked, axis=1, keepdims=True), atol=1e-5)


@pytest.mark.parametrize(
    ("weight", "moved"), [(0.25, 0.5), (0.5, 1.0), (0.75, 3.0), (1.0, 5.0), (1.5, 9.0), (-0.5, -1.0), (0.0, 0.0)]
)
def test_between_two_inbetweens_a_blend_shape_is_linear(rig, weight, moved):
    shape = rig.shape("Up", [(0, 0, 5)], [3])
    shape.CreateInbetween("half").SetWeight(0.5)
    shape.GetInbetween("half").SetOffsets([(0, 0, 1)])
    rig.weigh(["Up"], [weight])
    rig.mesh.GetPrim().RemoveProperty("primvars:skel:jointIndices")
    rig.mesh.GetPrim().RemoveProperty("primvars:skel:jointWeights")
    got = rig.deformed()
    if weight == 0.0:
        assert got is None
    else:
        np.testing.assert_allclose(got.points - POINTS, [(0, 0, 0)] * 3 + [(0, 0, moved)], atol=1e-6)
        assert got.space == rig.mesh.GetPrim()  # no joint moves it: its own transform places it


def test_blend_shapes_come_before_the_skeleton_and_their_weights_are_animated(rig):
    rig.shape("Long", [(0, 0, 1)], [2])
    rig.weigh(["Long"], [0.0], 0.0)
    rig.weigh(["Long"], [1.0], 10.0)
    np.testing.assert_allclose(rig.world()[2], (0, -2, 1), atol=1e-6)
    np.testing.assert_allclose(rig.world(0.0)[2], (0, 0, 2), atol=1e-6)


def test_normals_turn_with_the_points(rig):
    def turned(interpolation, count=4):
        normals = Attribute("normals", np.array([(0, 1, 0)] * count), interpolation)
        return rig.deformed().normals(normals, np.array([0, 3, 2, 1]))

    vertex, corner = turned("vertex"), turned("faceVarying")
    np.testing.assert_allclose(vertex.values, [(0, 1, 0), (0, 1, 0), (0, 0, 1), (0, HALF, HALF)], atol=1e-6)
    np.testing.assert_allclose(corner.values, [(0, 1, 0), (0, HALF, HALF), (0, 0, 1), (0, 1, 0)], atol=1e-6)
    assert corner.interpolation == "faceVarying"
    assert turned("uniform", 1) is None


def test_normals_of_a_squashed_limb_are_those_of_its_surface(rig):
    rig.animation.GetScalesAttr().Set(Vt.Vec3hArray([Gf.Vec3h(1, 1, 1), Gf.Vec3h(1, 4, 1)]))
    bind_whole(rig)
    got = rig.deformed(0.0).normals(Attribute("normals", np.array([(0, 1, 1)] * 4), "vertex"), np.arange(4))
    np.testing.assert_allclose(got.values, [np.array([0, 1, 4]) / np.sqrt(17.0)] * 4, atol=1e-6)


def test_blend_shapes_turn_normals_by_point(rig):
    rig.shape("Lean", [(0, 0, 0)], [1], normals=[(0, 0, 1)])
    rig.weigh(["Lean"], [1.0])
    normals = Attribute("normals", np.array([(0, 1, 0)] * 4), "vertex")
    np.testing.assert_allclose(rig.deformed(0.0).normals(normals, np.arange(4)).values[1], (0, HALF, HALF), atol=1e-6)


def test_a_gprim_without_points_is_moved_as_a_whole(rig):
    ball = UsdGeom.Sphere.Define(rig.stage, "/Leg/Foot")
    rig.bind(ball, [1], [1.0], constant=True)
    got = Skinning(Usd.TimeCode(10.0)).deform(ball.GetPrim(), np.array([(0.0, 0.0, 3.0), (0.0, 1.0, 1.0)]))
    np.testing.assert_allclose(got.points, [(0, -2, 1), (0, 0, 2)], atol=1e-6)


def leave_skel_root(rig):
    Sdf.CopySpec(rig.stage.GetRootLayer(), "/Leg/Skin", rig.stage.GetRootLayer(), "/Loose")
    rig.mesh = UsdGeom.Mesh.Get(rig.stage, "/Loose")


def without(attribute, *names):
    """Return a function that removes properties of the prim of an attribute of a rig."""
    return lambda rig: [getattr(rig, attribute).GetPrim().RemoveProperty(name) for name in names]


NOTED = {
    "/Loose: is not below a SkelRoot": leave_skel_root,
    "/Leg/Skin: is not bound to a skeleton": without("mesh", "skel:skeleton"),
    "/Leg/Bones: has neither an animation nor rest": without("skeleton", "skel:animationSource", "restTransforms"),
}


@pytest.mark.parametrize(("note", "spoil"), NOTED.items())
def test_what_usd_does_not_deform_is_noted(rig, spoil, note):
    spoil(rig)
    skinning = Skinning(Usd.TimeCode(10.0))
    assert skinning.deform(rig.mesh.GetPrim()) is None
    assert skinning.placing_prim(rig.mesh.GetPrim()) == rig.mesh.GetPrim()
    assert len(skinning.notes) == 1
    assert skinning.notes[0].startswith(note)


RESTING = {
    "/Leg/Bones: skel:animationSource /Leg/Gone is not a SkelAnimation": lambda r: (
        r.api(r.skeleton).GetAnimationSourceRel().SetTargets(["/Leg/Gone"])
    ),
    "/Leg/Bend: has no scales": without("animation", "scales"),
    "/Leg/Bend: animates no joint of /Leg/Bones": lambda r: r.animation.GetJointsAttr().Set(["x", "x/y"]),
}


@pytest.mark.parametrize(("note", "spoil"), RESTING.items())
def test_an_animation_that_usd_ignores_leaves_the_rest_pose(rig, spoil, note):
    rig.skeleton.GetRestTransformsAttr().Set([UP, UP])
    spoil(rig)
    skinning = Skinning(Usd.TimeCode(10.0))
    np.testing.assert_allclose(skinning.deform(rig.mesh.GetPrim()).points, np.add(POINTS, (0, 0, 1)), atol=1e-6)
    assert len(skinning.notes) == 1
    assert skinning.notes[0].startswith(note)


def test_an_inbetween_without_effect_is_noted(rig):
    rig.shape("Up", [(0, 0, 5)], [3]).CreateInbetween("end").SetWeight(1.0)
    rig.weigh(["Up"], [1.0])
    skinning = Skinning(EARLY)
    np.testing.assert_allclose(skinning.deform(rig.mesh.GetPrim()).points[3], (1, 0, 7), atol=1e-6)
    assert skinning.notes == ("/Leg/Skin/Up.inbetweens:end: no weight, or that of another shape: it has no effect",)


def test_what_is_bound_to_nothing_is_not_deformed(rig):
    plain = UsdGeom.Mesh.Define(rig.stage, "/Leg/Plain")
    skinning = Skinning(Usd.TimeCode(10.0))
    assert skinning.deform(plain.GetPrim()) is None
    assert skinning.notes == ()


def three_of_each(rig):
    rig.skin.GetJointIndicesAttr().Set([0, 1, 0])
    rig.skin.GetJointWeightsAttr().Set([1.0, 0.0, 1.0])


def constant(rig):
    bind_whole(rig)
    rig.skin.GetJointIndicesAttr().Set([1, 0, 1, 0])
    rig.skin.GetJointWeightsAttr().Set([1.0, 0.0, 1.0, 0.0])


def uniform(rig):
    for name in ("Indices", "Weights"):
        UsdGeom.Primvar(rig.mesh.GetPrim().GetAttribute(f"primvars:skel:joint{name}")).SetInterpolation("uniform")


def sparse_without_rest(rig):
    rig.skeleton.GetPrim().RemoveProperty("restTransforms")
    sparse_animation(rig)


def with_blend_shape(spoil):
    """Return a function that adds a blend shape and changes the rig and the shape."""

    def apply(rig):
        shape = rig.shape("Up", [(0, 0, 1)], [3])
        rig.weigh(["Up"], [1.0])
        spoil(rig, shape)

    return apply


def two_inbetweens(rig, shape):
    shape.CreateInbetween("half").SetWeight(0.5)
    shape.GetInbetween("half").SetOffsets([(0, 0, 1)] * 3)
    rig.weigh(["Up"], [0.6])


NAN, FLAT, NO_MATRIX = float("nan"), Gf.Matrix4d(0.0), Gf.Matrix4d(float("nan"))
PAIR = "primvars:skel:jointIndices and primvars:skel:jointWeights"
GONE = "/Leg/Gone"
TURN = [Gf.Quatf(1, 0, 0, 0), Gf.Quatf(NAN, 0, 0, 0)]
# What is broken, by the message that follows the prim of this name.
BROKEN = {
    "/Leg/Skin": {
        "primvars:skel:jointIndices[1] is 2, but there are 2": lambda r: r.skin.GetJointIndicesAttr().Set([0, 2] * 4),
        "primvars:skel:jointIndices[1] is -1": lambda r: r.skin.GetJointIndicesAttr().Set([0, -1, *[0] * 6]),
        "primvars:skel:jointWeights[0] is nan": lambda r: r.skin.GetJointWeightsAttr().Set([NAN, *[0.0] * 7]),
        "has 2 primvars:skel:jointIndices and 8 primvars:": lambda r: r.skin.GetJointIndicesAttr().Set([0, 1]),
        "has 3 primvars:skel:jointIndices and 3 primvars:skel:jointWeights; 2 of both for each point": three_of_each,
        "has joints for 4 points, but 8 points": lambda r: r.mesh.GetPointsAttr().Set(POINTS * 2),
        "has only one of jointIndices and jointWeights": without("mesh", "primvars:skel:jointWeights"),
        f"{PAIR} must have the same elementSize": lambda r: r.skin.GetJointIndicesPrimvar().SetElementSize(4),
        f"{PAIR} must have the same elementSize of at least 1, and both the": uniform,
        "has 4 primvars:skel:jointIndices and 4 primvars:skel:jointWeights; 2 of both for all points": constant,
        "skel:joints names toe": lambda r: r.skin.CreateJointsAttr().Set(["hip", "toe"]),
        "primvars:skel:skinningMethod is 'magic'": lambda r: r.skin.CreateSkinningMethodAttr().Set("magic"),
        "primvars:skel:geomBindTransform[0] is nan": lambda r: r.skin.CreateGeomBindTransformAttr().Set(NO_MATRIX),
        "skel:skeleton /Leg/Gone is not a Skeleton": lambda r: r.skin.GetSkeletonRel().SetTargets([GONE]),
        "skel:blendShapeTargets /Leg/Gone": with_blend_shape(
            lambda r, s: r.skin.GetBlendShapeTargetsRel().SetTargets([GONE])
        ),
        "has 2 skel:blendShapes, but 1 skel:": with_blend_shape(
            lambda r, s: r.skin.GetBlendShapesAttr().Set(["Up", "Down"])
        ),
    },
    "/Leg/Bones": {
        "joints must be paths": lambda r: r.skeleton.GetJointsAttr().Set(Vt.TokenArray()),
        "joints must be paths such as": lambda r: r.skeleton.GetJointsAttr().Set(["hip", "hip"]),
        "joints must be paths such as 'hip/knee'": lambda r: r.skeleton.GetJointsAttr().Set(["hip", "hip//knee"]),
        "joints are not in order: Joint 0": lambda r: r.skeleton.GetJointsAttr().Set(JOINTS[::-1]),
        "bindTransforms must be matrices with an inverse": without("skeleton", "bindTransforms"),
        "bindTransforms must be matrices with": lambda r: r.skeleton.GetBindTransformsAttr().Set([UP, FLAT]),
        "has 1 bindTransforms, but 2 joints": lambda r: r.skeleton.GetBindTransformsAttr().Set([UP]),
        "restTransforms[1] is nan": lambda r: r.skeleton.GetRestTransformsAttr().Set([UP, NO_MATRIX]),
        "has 1 restTransforms, but 2 joints": lambda r: r.skeleton.GetRestTransformsAttr().Set([UP]),
        "joint hip is not animated, and there are no restTransforms": sparse_without_rest,
    },
    "/Leg/Bend": {
        "has 1 translations, but 2 joints": lambda r: r.animation.GetTranslationsAttr().Set([(0, 0, 0)]),
        "rotations[1] is nan": lambda r: r.animation.GetRotationsAttr().Set(TURN, 10.0),
        "has 1 blendShapeWeights, but 2 blendShapes": with_blend_shape(lambda r, s: r.weigh(["Up", "Down"], [1.0])),
        "blendShapeWeights[0] is nan": with_blend_shape(lambda r, s: r.weigh(["Up"], [NAN])),
    },
    "/Leg/Skin/Up": {
        "pointIndices must lie in 0..3": with_blend_shape(lambda r, s: s.GetPointIndicesAttr().Set([4])),
        "pointIndices must lie in 0": with_blend_shape(lambda r, s: s.GetPointIndicesAttr().Set([-1])),
        "has 2 offsets, but 1 points": with_blend_shape(lambda r, s: s.GetOffsetsAttr().Set([(0, 0, 1)] * 2)),
        "offsets[0] is nan": with_blend_shape(lambda r, s: s.GetOffsetsAttr().Set([(0, NAN, 0)])),
        "its shapes have 3 and 1 offsets": with_blend_shape(two_inbetweens),
    },
}


@pytest.mark.parametrize(
    ("message", "spoil"),
    [(f"{prim}: {message}", spoil) for prim, faults in BROKEN.items() for message, spoil in faults.items()],
)
def test_a_broken_rig_is_an_error_at_its_place(rig, spoil, message, capfd):
    spoil(rig)
    with pytest.raises(AssetError, match="^" + re.escape(message)):
        rig.deformed()
    assert capfd.readouterr().err == ""
