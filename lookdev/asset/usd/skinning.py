"""UsdSkel: the points of a gprim after its blend shapes and its skeleton's pose at a time.

USD itself computes the joints and skins points and normals, by linear or dual quaternion blending.

Skinned points are in the space of their skeleton, whose transform places them; that of the gprim does not matter. As in
USD, only what is below a SkelRoot is deformed, a skeleton without animation is in its rest pose, and a gprim stays as
it is where its skeleton has neither. `Skinning.notes` lists what a file binds in vain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from lookdev.asset.normals import unit_or
from lookdev.asset.shape import Attribute, Doubles, Index
from lookdev.asset.usd.attributes import check_range, checked_array, read_array, read_matrix, read_texts, read_token
from lookdev.asset.usd.blend_shapes import Offsets, blend_offsets
from lookdev.asset.usd.skeleton import Pose, Skeletons
from lookdev.errors import AssetError
from lookdev.stage import relationship_targets

_SKELETON, _JOINTS = "skel:skeleton", "skel:joints"
_INDICES, _WEIGHTS = "primvars:skel:jointIndices", "primvars:skel:jointWeights"
_METHOD, _BIND = "primvars:skel:skinningMethod", "primvars:skel:geomBindTransform"
_SHAPES, _TARGETS = "skel:blendShapes", "skel:blendShapeTargets"
_INHERITED = (_INDICES, _WEIGHTS, _METHOD, _BIND, _JOINTS)
_METHODS = (UsdSkel.Tokens.classicLinear, UsdSkel.Tokens.dualQuaternion)


@dataclass(frozen=True, eq=False)
class _Influences:
    """How joints move a gprim: transforms (j, 4, 4) for row vectors in the space of the skeleton.

    indices and weights are (n, k), of k joints for each point, or (1, k) for all points together; `bind` (4, 4) maps
    the gprim's own space to that of the skeleton's bind pose.
    """

    transforms: Doubles
    indices: Index
    weights: Doubles
    bind: Doubles
    method: str

    def of(self, points: Index) -> tuple[Vt.IntArray, Vt.FloatArray, int]:
        """Return what USD takes for points (m,) by their numbers: their indices, their weights and k."""
        rows = points if len(self.indices) > 1 else np.zeros_like(points)
        indices, weights = self.indices[rows].astype(np.int32), self.weights[rows].astype(np.float32)
        return Vt.IntArray.FromNumpy(indices.ravel()), Vt.FloatArray.FromNumpy(weights.ravel()), indices.shape[1]


@dataclass(frozen=True, eq=False)
class _Binding:
    """What deforms a gprim; `key` is the same for gprims that are deformed alike."""

    space: Usd.Prim
    key: tuple[str, ...]
    influences: _Influences | None
    offsets: tuple[Offsets, ...]


@dataclass(frozen=True, eq=False)
class Deformed:
    """A deformed gprim: points (n, 3) in the stage's unit, which the transform of the prim `space` places.

    Instances with equal keys have equal points.
    """

    points: Doubles
    space: Usd.Prim
    key: tuple[str, ...]
    _binding: _Binding

    def normals(self, normals: Attribute, face_points: Index) -> Attribute | None:
        """Return authored normals deformed as the points are; None for those that are not by point or corner.

        `face_points` (m,) are the points at a mesh's corners. As in USD, blend shapes do not change `faceVarying` ones.
        """
        by_corner = normals.interpolation == "faceVarying"
        if not by_corner and normals.interpolation not in ("vertex", "varying"):
            return None
        values = np.asarray(normals.values, np.float64)
        points = face_points if by_corner else np.arange(len(self.points))
        if len(values) != len(points) or not ((points >= 0) & (points < len(self.points))).all():
            return normals  # a fault of the mesh, found where the mesh is checked
        if not by_corner:
            for each in self._binding.offsets:
                values = each.turned(values)
            values = unit_or(values, values)
        if (influences := self._binding.influences) is not None:
            skinned = Vt.Vec3fArray.FromNumpy(values.astype(np.float32))
            turns = Vt.Matrix3dArray.FromNumpy(_inverse_transposes(influences.transforms))
            bind = Gf.Matrix3d(*_inverse_transposes(influences.bind).ravel().tolist())
            UsdSkel.SkinNormals(influences.method, bind, turns, *influences.of(points), skinned)
            values = unit_or(np.asarray(skinned, np.float64), values)
        return Attribute(normals.name, values, normals.interpolation)


class Skinning:
    """Deforms the gprims of a stage at a time."""

    def __init__(self, time: Usd.TimeCode) -> None:
        self._time = time
        self._skeletons = Skeletons(time)
        self._notes: list[str] = []
        self._bindings: dict[Sdf.Path, _Binding | None] = {}
        self._done: dict[tuple[str, ...], Deformed] = {}

    @property
    def notes(self) -> tuple[str, ...]:
        """What the prims so far bind in vain, with the rule of USD that applies."""
        return (*self._notes, *self._skeletons.notes)

    def space(self, prim: Usd.Prim) -> Usd.Prim:
        """Return the prim whose transform places a gprim: the skeleton that moves it, else the gprim itself.

        Raises AssetError as `deformed` does.
        """
        binding = self._binding(prim)
        return prim if binding is None else binding.space

    def key(self, prim: Usd.Prim) -> tuple[str, ...]:
        """Return `Deformed.key`, empty where nothing deforms a gprim. Raises AssetError as `deformed` does."""
        binding = self._binding(prim)
        return () if binding is None else binding.key

    def deformed(self, prim: Usd.Prim, rest: Doubles | None = None) -> Deformed | None:
        """Return a gprim deformed, or None where nothing deforms it.

        `rest` (n, 3) are points in its own space and the stage's unit, by default those of the file. A gprim without
        points in the file can only be moved as a whole.

        Raises
        ------
        AssetError
            A binding, skeleton, animation or blend shape contradicts itself, or the points.
        """
        binding = self._binding(prim)
        if binding is None:
            return None
        if rest is None and binding.key in self._done:
            return self._done[binding.key]
        points = rest
        if points is None:
            points = read_array(prim, "points", self._time, np.float64, (3,))
        for each in binding.offsets:
            points = each.moved(points)
        if binding.influences is not None:
            points = _skinned(points, binding.influences, str(prim.GetPath()))
        deformed = Deformed(points, binding.space, binding.key, binding)
        if rest is None:
            self._done[binding.key] = deformed
        return deformed

    def _binding(self, prim: Usd.Prim) -> _Binding | None:
        path = prim.GetPath()
        if path not in self._bindings:
            self._bindings[path] = self._bound(prim)
        return self._bindings[path]

    def _bound(self, prim: Usd.Prim) -> _Binding | None:
        where = str(prim.GetPath())
        if not UsdSkel.Root.Find(prim):
            if prim.HasAPI(UsdSkel.BindingAPI):
                self._notes.append(f"{where}: is below no SkelRoot, without which USD deforms nothing")
            return None
        found = _binding_properties(prim)
        if (_INDICES in found) != (_WEIGHTS in found):
            raise AssetError(f"{where}: has only one of jointIndices and jointWeights; both or none would be right")
        if _INDICES not in found and _TARGETS not in found and _SHAPES not in found:
            return None
        if _SKELETON not in found:
            self._notes.append(f"{where}: is bound to no skeleton, without which USD deforms nothing")
            return None
        target = relationship_targets(found[_SKELETON])[0]
        skeleton = prim.GetStage().GetPrimAtPath(target)
        if not skeleton or not skeleton.IsA(UsdSkel.Skeleton):
            raise AssetError(f"{where}: skel:skeleton {target} is no Skeleton; the path of one is needed")
        pose = self._skeletons.pose(skeleton) if _INDICES in found else None
        influences = None if pose is None else _influences(where, found, pose, self._time)
        offsets: tuple[Offsets, ...] = ()
        if (_TARGETS in found) != (_SHAPES in found):
            raise AssetError(f"{where}: has only one of {_SHAPES} and {_TARGETS}; both or none would be right")
        if _TARGETS in found:
            names, targets = read_texts(prim, _SHAPES), relationship_targets(found[_TARGETS])
            offsets = tuple(blend_offsets(prim, names, targets, self._skeletons.weights(skeleton), self._notes))
        if influences is None and not offsets:
            return None
        animation = self._skeletons.animation(skeleton)
        shared = (prim, skeleton, *([animation] if animation else []), *(each.GetPrim() for each in found.values()))
        key = tuple(_shared_path(each) for each in shared)
        return _Binding(prim if influences is None else skeleton, key, influences, offsets)


def _binding_properties(prim: Usd.Prim) -> dict[str, Any]:
    """Return the properties that bind a prim below a SkelRoot by their names, those it inherits too; else none.

    As in USD, only properties with a value count, of prims with the SkelBindingAPI, and a prim below a gprim, or below
    one that is not Imageable, is not bound.
    """
    found: dict[str, Any] = {}
    each = prim
    while True:
        if each.HasAPI(UsdSkel.BindingAPI):
            for name in _INHERITED if each != prim else (*_INHERITED, _SHAPES):
                attribute = each.GetAttribute(name)
                if name not in found and attribute and attribute.HasAuthoredValue():
                    found[name] = attribute
            for name in (_SKELETON,) if each != prim else (_SKELETON, _TARGETS):
                relationship = each.GetRelationship(name)
                if name not in found and relationship and relationship_targets(relationship):
                    found[name] = relationship
        if each.IsA(UsdSkel.Root):
            return found
        each = each.GetParent()
        if UsdSkel.IsSkinnablePrim(each) or not each.IsA(UsdGeom.Imageable):
            return {}


def _influences(where: str, found: dict[str, Any], pose: Pose, time: Usd.TimeCode) -> _Influences:
    primvars = [UsdGeom.Primvar(found[name]) for name in (_INDICES, _WEIGHTS)]
    sizes = {primvar.GetElementSize() for primvar in primvars}
    kinds = {primvar.GetInterpolation() for primvar in primvars}
    if len(sizes) != 1 or min(sizes) < 1 or kinds not in ({"constant"}, {"vertex"}):
        raise AssetError(
            f"{where}: {_INDICES} and {_WEIGHTS} must have the same elementSize of at least 1, and both the "
            "interpolation constant or both vertex"
        )
    (size,), (kind,) = sizes, kinds
    indices, weights = (
        checked_array(primvar.ComputeFlattened(time), primvar.GetAttr().GetPrim(), primvar.GetName(), number)
        for primvar, number in zip(primvars, (np.intp, np.float64), strict=True)
    )
    if len(indices) != len(weights) or len(indices) % size or (kind == "constant" and len(indices) != size):
        raise AssetError(
            f"{where}: has {len(indices)} {_INDICES} and {len(weights)} {_WEIGHTS}; {size} of both for "
            f"{'all points' if kind == 'constant' else 'each point'} would be right"
        )
    transforms = pose.transforms
    if _JOINTS in found:
        names = read_texts(found[_JOINTS].GetPrim(), _JOINTS)
        if unknown := [name for name in names if name not in pose.names]:
            raise AssetError(f"{where}: skel:joints names {unknown[0]}, which the skeleton does not have")
        transforms = transforms[[pose.names.index(name) for name in names]]
    check_range(indices, len(transforms), primvars[0].GetAttr().GetPrim(), _INDICES, "joints")
    method = _METHODS[0]
    if _METHOD in found:
        method = read_token(found[_METHOD].GetPrim(), _METHOD, Usd.TimeCode.Default(), _METHODS)
    bind = read_matrix(found[_BIND].GetPrim(), _BIND, time) if _BIND in found else np.eye(4)
    return _Influences(transforms, indices.reshape(-1, size), weights.reshape(-1, size), bind, method)


def _skinned(points: Doubles, influences: _Influences, where: str) -> Doubles:
    if len(influences.indices) not in (1, len(points)):
        raise AssetError(f"{where}: has joints for {len(influences.indices)} points, but {len(points)} points")
    skinned = Vt.Vec3fArray.FromNumpy(points.astype(np.float32))
    transforms = Vt.Matrix4dArray.FromNumpy(influences.transforms)
    bind = Gf.Matrix4d(*influences.bind.ravel().tolist())
    UsdSkel.SkinPoints(influences.method, bind, transforms, *influences.of(np.arange(len(points))), skinned)
    return np.asarray(skinned, np.float64).reshape(-1, 3)


def _inverse_transposes(matrices: Doubles) -> Doubles:
    """Return what transforms normals (..., 3, 3) by matrices for row vectors (..., 4, 4), also by flat ones."""
    x, y, z = np.moveaxis(matrices[..., :3, :3], -2, 0)
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=-2)
    volumes = (x * cofactors[..., 0, :]).sum(axis=-1)[..., None, None]
    return np.asarray(cofactors / np.where(volumes == 0.0, 1.0, volumes))


def _shared_path(prim: Usd.Prim) -> str:
    """Return a path that is the same for all instances of one prototype's prim."""
    return str((prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath())
