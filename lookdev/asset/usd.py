"""A USD file as an asset: its visible meshes, their placements and their bound materials.

Every visible `UsdGeom.Mesh` of purpose default or render is read, at the earliest time; other geometry (curves, points,
volumes, implicit shapes) and skinning are not. Scenegraph instances and point instances share one mesh for each mesh of
their prototype where the same materials are bound; its slots have the path of the first one. Instances without volume
(scale 0, the usual way to hide one) are left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom, UsdShade

from lookdev.asset.mesh import Asset, Instance, Mesh, Slot
from lookdev.asset.normals import Doubles
from lookdev.asset.store import make_asset
from lookdev.asset.usd_mesh import TIME, MeshReader
from lookdev.errors import AssetError

_SCENE = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
# A prototype may be an `over` or a `class`, which is visible only through its instancer.
_PROTOTYPE = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
_Z_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def read_usd(file: Path, prim: str | None = None) -> Asset:
    """Read the geometry of a USD file, or of one prim and what is below it, into world space: z up, metres.

    `prim` is the path of the prim; its ancestors place it, and hidden ones do not hide it.

    Raises
    ------
    AssetError
        The file cannot be opened, there is no such prim, geometry contradicts itself, or none is visible.
    """
    try:
        stage = Usd.Stage.Open(str(file))
    except Tf.ErrorException as error:
        reasons = "; ".join(part.commentary.strip() for part in error.args)
        raise AssetError(f"{file}: cannot be opened as USD: {reasons}") from error
    scene = _Scene(file, stage)
    for mesh, transforms in scene.seen(_root(file, stage, prim), _SCENE):
        scene.place(mesh, transforms)
    if not scene.instances:
        below = f" below {prim}" if prim else ""
        raise AssetError(
            f"{file}: has no surface to render{below}; at least one visible UsdGeom.Mesh with a face, of "
            "purpose default or render, is needed"
        )
    return make_asset(file.stem, scene.meshes, scene.instances, scene.slots)


def _root(file: Path, stage: Any, path: str | None) -> Any:
    if path is None:
        return stage.GetPseudoRoot()
    if not Sdf.Path.IsValidPathString(path) or not Sdf.Path(path).IsAbsolutePath():
        raise AssetError(f"{file}: {path!r} is not the path of a prim; one looks like '/World/Car'")
    prim = stage.GetPrimAtPath(path)
    if prim:
        return prim
    parent = Sdf.Path(path)
    while not stage.GetPrimAtPath(parent):
        parent = parent.GetParentPath()
    children = ", ".join(str(child.GetPath()) for child in stage.GetPrimAtPath(parent).GetAllChildren())
    raise AssetError(f"{file}: there is no prim {path}; below {parent} there are: {children or 'none'}")


@dataclass
class _Scene:
    """The meshes, instances and slots of one stage."""

    file: Path
    stage: Any
    meshes: list[Mesh] = field(default_factory=list)
    instances: list[Instance] = field(default_factory=list)
    slots: list[Slot] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._transforms = UsdGeom.XformCache(TIME)
        self._numbers: dict[tuple[str, ...], int | None] = {}
        self._unit = UsdGeom.GetStageMetersPerUnit(self.stage)
        self._y_up = UsdGeom.GetStageUpAxis(self.stage) == UsdGeom.Tokens.y
        self._reader = MeshReader(self.file, self._unit, up=1 if self._y_up else 2)

    def seen(self, root: Any, predicate: Any) -> Iterator[tuple[Any, Doubles]]:
        """Yield each visible mesh at or below `root` with its transforms (k, 4, 4), for row vectors."""
        prims = iter(Usd.PrimRange(root, predicate))
        for prim in prims:
            imageable = UsdGeom.Imageable(prim)
            if not imageable:
                continue
            if imageable.GetVisibilityAttr().Get(TIME) == UsdGeom.Tokens.invisible:
                prims.PruneChildren()
                continue
            shown = imageable.ComputePurpose() in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
            if prim.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()
                if shown:
                    yield from self._instanced(UsdGeom.PointInstancer(prim))
            elif prim.IsA(UsdGeom.Mesh) and shown:
                yield UsdGeom.Mesh(prim), self._to_stage(prim)[None]

    def place(self, mesh: Any, transforms: Doubles) -> None:
        """Add a mesh, read at its first appearance, once for each transform."""
        subsets = UsdShade.MaterialBindingAPI(mesh).GetMaterialBindSubsets()
        bound = [_bound_material(prim) for prim in (mesh.GetPrim(), *(s.GetPrim() for s in subsets))]
        key = tuple(_shared_path(prim) if prim else "" for prim in (mesh.GetPrim(), *bound))
        if key not in self._numbers:
            materials = [str(prim.GetPath()) if prim else None for prim in bound]
            read = self._reader.read(mesh, subsets, materials, len(self.slots))
            self._numbers[key] = None if read is None else len(self.meshes)
            if read is not None:
                self.meshes.append(read[0])
                self.slots.extend(read[1])
        number = self._numbers[key]
        if number is None:
            return
        # USD multiplies row vectors from the left: transposed, and in metres as the points are.
        matrices = np.swapaxes(transforms, 1, 2).copy()
        matrices[:, :3, 3] *= self._unit
        if self._y_up:
            matrices = _Z_UP @ matrices
        sizes = np.linalg.norm(matrices[:, :3, :3], axis=(1, 2))
        solid = np.abs(np.linalg.det(matrices[:, :3, :3])) > 1e-12 * sizes**3
        self.instances += [Instance(number, matrix) for matrix in matrices[solid]]

    def _to_stage(self, prim: Any) -> Doubles:
        return np.array(self._transforms.GetLocalToWorldTransform(prim), np.float64)

    def _instanced(self, instancer: Any) -> Iterator[tuple[Any, Doubles]]:
        """Yield the meshes of a point instancer's prototypes, with a transform for every visible instance."""
        where = f"{self.file}: {instancer.GetPath()}"
        targets = instancer.GetPrototypesRel().GetForwardedTargets()
        numbers = np.asarray(instancer.GetProtoIndicesAttr().Get(TIME) or [], np.int64)
        if len(numbers) == 0:
            return
        if numbers.min() < 0 or numbers.max() >= len(targets):
            raise AssetError(f"{where}: protoIndices must lie in 0..{len(targets) - 1}, one for each prototype")
        for name, attribute, needed in (
            ("positions", instancer.GetPositionsAttr(), True),
            ("scales", instancer.GetScalesAttr(), False),
            ("orientations", instancer.GetOrientationsAttr(), False),
        ):
            count = len(attribute.Get(TIME) or [])
            if count != len(numbers) and (needed or count):
                raise AssetError(f"{where}: has {count} {name}, but {len(numbers)} protoIndices; they must agree")
        placed = np.array(
            instancer.ComputeInstanceTransformsAtTime(
                TIME, TIME, UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
            ),
            np.float64,
        ) @ self._to_stage(instancer.GetPrim())
        mask = instancer.ComputeMaskAtTime(TIME)
        seen = np.array(mask, bool) if len(mask) else np.ones(len(numbers), bool)
        for number, target in enumerate(targets):
            chosen = placed[seen & (numbers == number)]
            prototype = self.stage.GetPrimAtPath(target)
            if len(chosen) == 0:
                continue
            if not prototype:
                raise AssetError(f"{where}: prototype {target} is not there; the path of a prim is needed")
            if instancer.GetPath().HasPrefix(target):
                raise AssetError(f"{where}: prototype {target} holds the instancer itself; it must be another prim")
            from_stage = np.linalg.inv(self._to_stage(prototype))
            for mesh, transforms in self.seen(prototype, _PROTOTYPE):
                inner = transforms @ from_stage
                yield mesh, (inner[None] @ chosen[:, None]).reshape(-1, 4, 4)


def _bound_material(prim: Any) -> Any:
    """Return the prim of the material bound for final renders, or None."""
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.full)
    return material.GetPrim() if material else None


def _shared_path(prim: Any) -> str:
    """Return a path that is the same for all instances of one prototype's prim."""
    return str((prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath())
