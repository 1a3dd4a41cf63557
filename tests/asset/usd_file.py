"""USD files made by tests."""

import itertools

from asset_arrays import check_asset
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdSkel, Vt

from lookdev.asset import load_asset
from lookdev.asset.usd import read_usd
from lookdev.stage import Composition, compose

CUBE_POINTS = [(x, y, z) for x, y, z in itertools.product((-1.0, 1.0), repeat=3)]
CUBE_FACES = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]  # counter-clockwise outside
TYPES = Sdf.ValueTypeNames


class File:
    """A stage, by default z up and in metres, that is read back through a file."""

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

    def instances(self, of, *paths):
        """Make a prim abstract, and instances of it; return these."""
        self.stage.GetPrimAtPath(of).SetSpecifier(Sdf.SpecifierClass)
        prims = [UsdGeom.Xform.Define(self.stage, path) for path in paths]
        for prim in prims:
            prim.GetPrim().GetReferences().AddInternalReference(of)
            prim.GetPrim().SetInstanceable(True)
        return prims

    def instancer(self, path, prototypes, positions, numbers=None):
        """Place prototypes, by default the first, at positions."""
        instancer = UsdGeom.PointInstancer.Define(self.stage, path)
        instancer.GetPrototypesRel().SetTargets(prototypes)
        instancer.GetPositionsAttr().Set(Vt.Vec3fArray(positions))
        instancer.GetProtoIndicesAttr().Set(numbers or [0] * len(positions))
        return instancer

    def material(self, path, *users):
        material = UsdShade.Material.Define(self.stage, path)
        for user in users:
            UsdShade.MaterialBindingAPI.Apply(self.stage.GetPrimAtPath(user)).Bind(material)
        return material

    def load(self, prim=None):
        """Return the asset with the polygons of its cages."""
        self.stage.GetRootLayer().Save()
        asset = load_asset(usd=self.path, prim=prim)
        check_asset(asset)
        return asset

    def read(self, *, time=None, purposes=("default", "render"), **composition):
        """Return the asset with its control cages."""
        self.stage.GetRootLayer().Save()
        asset = read_usd(compose(Composition(self.path, **composition)), time, purposes)
        check_asset(asset)
        return asset


STAGES = []  # a prim does not keep its stage


def prim_of(kind, up="Z", **values):
    """Return a prim of a type, in a stage of its own."""
    STAGES.append(Usd.Stage.CreateInMemory())
    UsdGeom.SetStageUpAxis(STAGES[-1], up)
    prim = STAGES[-1].DefinePrim("/Thing", kind)
    for name, value in values.items():
        if value is not None:
            prim.GetAttribute(name).Set(value)
    return prim


UP = Gf.Matrix4d(1.0).SetTranslate((0, 0, 1))
JOINTS = ["hip", "hip/knee"]
STRAIGHT, BENT = Gf.Quatf(1, 0, 0, 0), Gf.Quatf(0.5**0.5, 0.5**0.5, 0, 0)  # by a right angle about x


class Leg:
    """A skeleton of two joints, the knee 1 above the hip."""

    def __init__(self, stage, path="/Leg"):
        self.stage, self.root = stage, UsdSkel.Root.Define(stage, path)
        self.skeleton = UsdSkel.Skeleton.Define(stage, f"{path}/Bones")
        self.skeleton.GetJointsAttr().Set(JOINTS)
        self.skeleton.GetBindTransformsAttr().Set([Gf.Matrix4d(1.0), UP])
        self.skeleton.GetRestTransformsAttr().Set([Gf.Matrix4d(1.0), UP])
        self.api(self.skeleton).CreateAnimationSourceRel().SetTargets([f"{path}/Bend"])

    def api(self, schema):
        return UsdSkel.BindingAPI.Apply(schema.GetPrim())

    def animate(self, path, joints, heights, rotations=None):
        """Place joints at heights above their parents, and turn them."""
        animation = UsdSkel.Animation.Define(self.stage, path)
        animation.GetJointsAttr().Set(joints)
        animation.GetTranslationsAttr().Set([(0, 0, height) for height in heights])
        animation.GetScalesAttr().Set(Vt.Vec3hArray([Gf.Vec3h(1, 1, 1)] * len(joints)))
        if rotations:
            animation.GetRotationsAttr().Set(rotations)
        return animation

    def bind(self, schema, indices, weights=None, size=1, constant=False):
        """Bind a prim to joints, `size` for each point, or for the whole; weights are 1 by default."""
        api = self.api(schema)
        api.CreateSkeletonRel().SetTargets([self.skeleton.GetPath()])
        api.CreateJointIndicesPrimvar(constant, size).Set(list(indices))
        api.CreateJointWeightsPrimvar(constant, size).Set(list(map(float, weights or [1] * len(indices))))


def primvar(mesh, name, kind, interpolation, values, indices=None):
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(name, kind, interpolation)
    primvar.Set(values)
    if indices is not None:
        primvar.SetIndices(Vt.IntArray(indices))
    return primvar
