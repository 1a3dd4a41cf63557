"""Deforms gprims as UsdSkel defines: by blend shapes, and by a skeleton's pose at a given time.

USD's own functions compute the joints, and skin points and normals by linear or dual quaternion blending.

Skinned points are in the space of their skeleton, whose transform places them; the gprim's own transform has no effect.
As in USD, only gprims below a SkelRoot are deformed, and a skeleton without animation is in its rest pose. A skeleton
with neither an animation nor a rest pose does not deform gprims. `Skinning.notes` lists bindings without effect.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from lookdev.arrays import Floats, Indices
from lookdev.asset.normals import normalize_or
from lookdev.asset.shape import Attribute
from lookdev.asset.usd.attributes import check_array, check_range, read_array, read_matrix, read_texts, read_token
from lookdev.asset.usd.blend_shapes import Offsets, blend_offsets
from lookdev.asset.usd.skeleton import SkeletonPose, Skeletons
from lookdev.asset.usd.walk import prototype_path
from lookdev.errors import AssetError
from lookdev.stage import relationship_targets

_SKELETON, _JOINTS = "skel:skeleton", "skel:joints"
_INDICES, _WEIGHTS = "primvars:skel:jointIndices", "primvars:skel:jointWeights"
_METHOD, _BIND = "primvars:skel:skinningMethod", "primvars:skel:geomBindTransform"
_SHAPES, _TARGETS = "skel:blendShapes", "skel:blendShapeTargets"
_INHERITED = (_INDICES, _WEIGHTS, _METHOD, _BIND, _JOINTS)  # the attributes that prims inherit
_METHODS = (UsdSkel.Tokens.classicLinear, UsdSkel.Tokens.dualQuaternion)


@dataclass(frozen=True, eq=False)
class _Influences:
    """The influences of joints on a gprim; matrices are for row vectors.

    - transforms (j, 4, 4): the transform of each joint from the bind pose to the pose, in the space of the skeleton
    - indices, weights (n, k): the k joints that move each point, as indices of transforms, and their weights; (1, k) if
      they are the same for all points
    - bind (4, 4): maps the gprim's space to the space of the skeleton in its bind pose
    - method: one of `_METHODS`
    """

    transforms: Floats
    indices: Indices
    weights: Floats
    bind: Floats
    method: str

    def for_points(self, points: Indices) -> tuple[Vt.IntArray, Vt.FloatArray, int]:
        """Return the arguments of USD's functions for the points with the numbers (m,): joint indices, weights, k."""
        rows = points if len(self.indices) > 1 else np.zeros_like(points)
        indices, weights = self.indices[rows].astype(np.int32), self.weights[rows].astype(np.float32)
        return Vt.IntArray.FromNumpy(indices.ravel()), Vt.FloatArray.FromNumpy(weights.ravel()), indices.shape[1]


@dataclass(frozen=True, eq=False)
class _Binding:
    """The deformers of a gprim: the influences of joints, if there are any, and the offsets of blend shapes.

    `space` is the prim whose transform places the deformed points. Gprims with equal `key`s have equal deformations.
    """

    space: Usd.Prim
    key: tuple[str, ...]
    influences: _Influences | None
    offsets: tuple[Offsets, ...]


@dataclass(frozen=True, eq=False)
class DeformedGprim:
    """A deformed gprim: points (n, 3) in the stage's unit, which the transform of the prim `space` places."""

    points: Floats
    space: Usd.Prim
    _binding: _Binding

    def normals(self, normals: Attribute, face_points: Indices) -> Attribute | None:
        """Return authored normals, deformed with the points; None unless they are given by point or by corner.

        `face_points` (m,) are the points at a mesh's corners. As in USD, blend shapes do not change normals of the
        interpolation `faceVarying`.
        """
        by_corner = normals.interpolation == "faceVarying"
        if not by_corner and normals.interpolation not in ("vertex", "varying"):
            return None
        values = np.asarray(normals.values, np.float64)
        points = face_points if by_corner else np.arange(len(self.points))
        if len(values) != len(points) or not ((points >= 0) & (points < len(self.points))).all():
            return normals  # this is a fault of the mesh, which `faces` reports later
        if not by_corner:
            for offset in self._binding.offsets:
                values = offset.offset_normals(values)
            values = normalize_or(values, values)
        if (influences := self._binding.influences) is not None:
            vectors = Vt.Vec3fArray.FromNumpy(values.astype(np.float32))
            normal_matrices = Vt.Matrix3dArray.FromNumpy(_inverse_transposes(influences.transforms))
            bind = Gf.Matrix3d(*_inverse_transposes(influences.bind).ravel().tolist())
            UsdSkel.SkinNormals(influences.method, bind, normal_matrices, *influences.for_points(points), vectors)
            values = normalize_or(np.asarray(vectors, np.float64), values)
        return Attribute(normals.name, values, normals.interpolation)


class Skinning:
    """Deforms the gprims of a stage at a given time."""

    def __init__(self, time: Usd.TimeCode) -> None:
        self._time = time
        self._skeletons = Skeletons(time)
        self._notes: list[str] = []
        self._bindings: dict[Sdf.Path, _Binding | None] = {}
        self._deformed: dict[tuple[str, ...], DeformedGprim] = {}

    @property
    def notes(self) -> tuple[str, ...]:
        """Lines for the user about bindings without effect, with USD's rule, for the prims that have been read."""
        return (*self._notes, *self._skeletons.notes)

    def placing_prim(self, prim: Usd.Prim) -> Usd.Prim:
        """Return the prim whose transform places a gprim: the skeleton that deforms it, or else the gprim itself.

        Raises AssetError as `deform` does.
        """
        binding = self._binding(prim)
        return prim if binding is None else binding.space

    def key(self, prim: Usd.Prim) -> tuple[str, ...]:
        """Return a key that is equal for gprims with equal deformations, and () for a gprim that is not deformed.

        Raises AssetError as `deform` does.
        """
        binding = self._binding(prim)
        return () if binding is None else binding.key

    def deform(self, prim: Usd.Prim, rest: Floats | None = None) -> DeformedGprim | None:
        """Return the deformed gprim, or None if nothing deforms it.

        `rest` (n, 3) are the points before the deformation, in the gprim's space and the stage's unit; by default, they
        are the points in the file. A gprim without points in the file, such as a sphere, can only be moved as a whole.

        Raises
        ------
        AssetError
            A binding, skeleton, animation or blend shape contradicts itself or the points.
        """
        binding = self._binding(prim)
        if binding is None:
            return None
        if rest is None and binding.key in self._deformed:
            return self._deformed[binding.key]
        points = rest
        if points is None:
            points = read_array(prim, "points", self._time, np.float64, (3,))
        for offset in binding.offsets:
            points = offset.offset_points(points)
        if binding.influences is not None:
            points = _skin_points(points, binding.influences, str(prim.GetPath()))
        deformed = DeformedGprim(points, binding.space, binding)
        if rest is None:
            self._deformed[binding.key] = deformed
        return deformed

    def _binding(self, prim: Usd.Prim) -> _Binding | None:
        """Return the deformers of a gprim, or None if nothing deforms it; results are stored by path."""
        path = prim.GetPath()
        if path not in self._bindings:
            self._bindings[path] = self._read_binding(prim)
        return self._bindings[path]

    def _read_binding(self, prim: Usd.Prim) -> _Binding | None:
        """Return the deformers of a gprim, or None if there are none; append a note for a binding without effect."""
        path = str(prim.GetPath())
        if not UsdSkel.Root.Find(prim):
            if prim.HasAPI(UsdSkel.BindingAPI):
                self._notes.append(f"{path}: is not below a SkelRoot, without which USD deforms nothing")
            return None
        properties = _binding_properties(prim)
        if (_INDICES in properties) != (_WEIGHTS in properties):
            raise AssetError(f"{path}: has only one of jointIndices and jointWeights; both or none would be right")
        if _INDICES not in properties and _TARGETS not in properties and _SHAPES not in properties:
            return None
        if _SKELETON not in properties:
            self._notes.append(f"{path}: is not bound to a skeleton, without which USD deforms nothing")
            return None
        target = relationship_targets(properties[_SKELETON])[0]
        skeleton = prim.GetStage().GetPrimAtPath(target)
        if not skeleton or not skeleton.IsA(UsdSkel.Skeleton):
            raise AssetError(f"{path}: skel:skeleton {target} is not a Skeleton; the path of one is needed")
        pose = self._skeletons.pose(skeleton) if _INDICES in properties else None
        influences = None if pose is None else _read_influences(path, properties, pose, self._time)
        offsets: tuple[Offsets, ...] = ()
        if (_TARGETS in properties) != (_SHAPES in properties):
            raise AssetError(f"{path}: has only one of {_SHAPES} and {_TARGETS}; both or none would be right")
        if _TARGETS in properties:
            names, targets = read_texts(prim, _SHAPES), relationship_targets(properties[_TARGETS])
            offsets = tuple(blend_offsets(prim, names, targets, self._skeletons.weights(skeleton), self._notes))
        if influences is None and not offsets:
            return None
        animation = self._skeletons.animation(skeleton)
        owners = [item.GetPrim() for item in properties.values()]
        dependencies = [prim, skeleton, *([animation] if animation else []), *owners]
        key = tuple(prototype_path(dependency) for dependency in dependencies)
        return _Binding(prim if influences is None else skeleton, key, influences, offsets)


def _binding_properties(prim: Usd.Prim) -> dict[str, Usd.Property]:
    """Return the binding properties, by name, that a prim below a SkelRoot has or inherits.

    As in USD, only properties with a value on prims with the SkelBindingAPI count. A prim below a gprim, or below a
    prim that is not Imageable, is not bound: then the dictionary is empty.
    """
    properties: dict[str, Usd.Property] = {}
    ancestor = prim
    while True:
        if ancestor.HasAPI(UsdSkel.BindingAPI):
            for name in _INHERITED if ancestor != prim else (*_INHERITED, _SHAPES):
                attribute = ancestor.GetAttribute(name)
                if name not in properties and attribute and attribute.HasAuthoredValue():
                    properties[name] = attribute
            for name in (_SKELETON,) if ancestor != prim else (_SKELETON, _TARGETS):
                relationship = ancestor.GetRelationship(name)
                if name not in properties and relationship and relationship_targets(relationship):
                    properties[name] = relationship
        if ancestor.IsA(UsdSkel.Root):
            return properties
        ancestor = ancestor.GetParent()
        if UsdSkel.IsSkinnablePrim(ancestor) or not ancestor.IsA(UsdGeom.Imageable):
            return {}


def _read_influences(
    path: str, properties: dict[str, Usd.Property], pose: SkeletonPose, time: Usd.TimeCode
) -> _Influences:
    """Return the influences of joints on the gprim at `path`; raises AssetError for contradictions."""
    primvars = [UsdGeom.Primvar(properties[name]) for name in (_INDICES, _WEIGHTS)]
    sizes = {primvar.GetElementSize() for primvar in primvars}
    interpolations = {primvar.GetInterpolation() for primvar in primvars}
    if len(sizes) != 1 or min(sizes) < 1 or interpolations not in ({"constant"}, {"vertex"}):
        raise AssetError(
            f"{path}: {_INDICES} and {_WEIGHTS} must have the same elementSize of at least 1, and both the "
            "interpolation constant or both vertex"
        )
    (size,), (interpolation,) = sizes, interpolations
    values = [(primvar.ComputeFlattened(time), primvar.GetAttr().GetPrim(), primvar.GetName()) for primvar in primvars]
    indices, weights = check_array(*values[0], np.intp), check_array(*values[1], np.float64)
    if len(indices) != len(weights) or len(indices) % size or (interpolation == "constant" and len(indices) != size):
        raise AssetError(
            f"{path}: has {len(indices)} {_INDICES} and {len(weights)} {_WEIGHTS}; {size} of both for "
            f"{'all points' if interpolation == 'constant' else 'each point'} would be right"
        )
    transforms = pose.transforms
    if _JOINTS in properties:
        names = read_texts(properties[_JOINTS].GetPrim(), _JOINTS)
        if unknown := [name for name in names if name not in pose.names]:
            raise AssetError(f"{path}: skel:joints names {unknown[0]}, which the skeleton does not have")
        transforms = transforms[[pose.names.index(name) for name in names]]
    check_range(indices, len(transforms), primvars[0].GetAttr().GetPrim(), _INDICES, "joints")
    method = _METHODS[0]
    if _METHOD in properties:
        method = read_token(properties[_METHOD].GetPrim(), _METHOD, Usd.TimeCode.Default(), _METHODS)
    bind = read_matrix(properties[_BIND].GetPrim(), _BIND, time) if _BIND in properties else np.eye(4)
    return _Influences(transforms, indices.reshape(-1, size), weights.reshape(-1, size), bind, method)


def _skin_points(points: Floats, influences: _Influences, path: str) -> Floats:
    """Return the points (n, 3) of the gprim at `path`, moved by its joints to the space of the skeleton."""
    if len(influences.indices) not in (1, len(points)):
        raise AssetError(f"{path}: has joints for {len(influences.indices)} points, but {len(points)} points")
    positions = Vt.Vec3fArray.FromNumpy(points.astype(np.float32))
    transforms = Vt.Matrix4dArray.FromNumpy(influences.transforms)
    bind = Gf.Matrix4d(*influences.bind.ravel().tolist())
    UsdSkel.SkinPoints(influences.method, bind, transforms, *influences.for_points(np.arange(len(points))), positions)
    return np.asarray(positions, np.float64).reshape(-1, 3)


def _inverse_transposes(matrices: Floats) -> Floats:
    """Return the inverse transposes (..., 3, 3), which transform normals, of matrices (..., 4, 4) for row vectors.

    For a singular matrix, the result is the matrix of cofactors.
    """
    x, y, z = np.moveaxis(matrices[..., :3, :3], -2, 0)
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=-2)
    volumes = (x * cofactors[..., 0, :]).sum(axis=-1)[..., None, None]
    return np.asarray(cofactors / np.where(volumes == 0.0, 1.0, volumes))
