"""Finds the visible gprims of a stage and their placements.

The walk follows visibility, purpose, scene-graph instances and point instancers. A prim in a prototype of several point
instancers is visited once for each instancer, with a transform for each instance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom

from lookdev.arrays import Bools, Floats
from lookdev.asset.shape import MAX_COORDINATE
from lookdev.asset.usd.attributes import check_range, read_any_token, read_array, read_texts, sample_time
from lookdev.errors import AssetError
from lookdev.stage import error_message, quote, relationship_targets

_SCENE_PRIMS = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
# A prototype may be an `over` or a `class`, which is visible only through its instancer.
_PROTOTYPE_PRIMS = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
# The attributes of a point instancer with a value for each instance.
_INSTANCE_ATTRIBUTES: tuple[tuple[str, type[np.generic], tuple[int, ...]], ...] = (
    ("positions", np.float64, (3,)),
    ("scales", np.float64, (3,)),
    ("orientations", np.float64, (4,)),
    ("orientationsf", np.float64, (4,)),
    ("ids", np.intp, ()),
)
_MAX_DEPTH = 32  # levels of instancers that are in prototypes of other instancers
_MAX_INSTANCES = 2_000_000  # in an asset: a quarter of a gigabyte of matrices
PURPOSES = ("default", "render", "proxy", "guide")
_VISIBILITIES = ("inherited", "invisible")


@dataclass(frozen=True, eq=False)
class PlacedGprim:
    """A visible gprim and its placements in the stage, as matrices for row vectors.

    `transforms` (k, 4, 4) map the gprim's space to the stage. `prototype` is the prototype of a point instancer that
    contains the gprim, and `prototype_placements` (j, 4, 4) map the prototype's space to the stage. For a gprim that is
    not in a prototype, `prototype` is None, and `prototype_placements` is one identity matrix.
    """

    prim: Usd.Prim
    transforms: Floats
    prototype: Usd.Prim | None
    prototype_placements: Floats


def is_affine(matrices: Floats) -> Bools:
    """Return which matrices (..., 4, 4) for row vectors are bounded and affine: with the last column 0 0 0 1."""
    is_bounded = (np.abs(matrices) <= MAX_COORDINATE).all(axis=(-2, -1))
    return np.asarray(is_bounded & (np.abs(matrices[..., 3] - (0.0, 0.0, 0.0, 1.0)) < 1e-9).all(axis=-1))


def faulty_transform_path(prim: Usd.Prim, time: Usd.TimeCode) -> str:
    """Return the path of the transform operation that makes the transform of a prim not computable or not affine.

    The operation is on the prim or an ancestor. If there is no such operation, return the path of the prim itself.
    """
    ancestor = prim
    while ancestor:
        order_path = path = f"{ancestor.GetPath()}.xformOpOrder"
        try:
            for operation in (
                UsdGeom.Xformable(ancestor).GetOrderedXformOps() if ancestor.IsA(UsdGeom.Xformable) else ()
            ):
                path = str(operation.GetAttr().GetPath())
                if not is_affine(np.array(operation.GetOpTransform(time), np.float64)):
                    return path
            path = order_path
            UsdGeom.XformCache(time).GetLocalTransformation(ancestor)
        except Tf.ErrorException:
            return path
        ancestor = ancestor.GetParent()
    return str(prim.GetPath())


def prototype_path(prim: Usd.Prim | None) -> str:
    """Return the path of a prim in its scene-graph prototype, which is the same for all instances; "" for None."""
    if prim is None:
        return ""
    return str((prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath())


class Walk:
    """Visits the visible gprims of a stage at a given time.

    Hidden ancestors of the prim at which a walk starts do not hide this prim. A walk calls `note` with a message and
    the prim for content that is not rendered, and for values that have no effect.
    """

    def __init__(
        self,
        stage: Usd.Stage,
        time: Usd.TimeCode,
        purposes: tuple[str, ...],
        note: Callable[[str, Usd.Prim], None],
    ) -> None:
        self._stage = stage
        self._time = time
        self._purposes = purposes
        self._note = note
        self._transforms = UsdGeom.XformCache(time)
        self._placement_count = 0
        self._flags_of_type: dict[str, tuple[bool, bool, bool]] = {}  # the results of `_type_flags`, by type

    def gprims_below(self, path: str) -> Iterator[PlacedGprim]:
        """Yield the visible gprims at and below a path; raises AssetError if an instancer contradicts itself."""
        yield from self._walk(self._stage.GetPrimAtPath(path), _SCENE_PRIMS, None, np.eye(4)[None], ())

    def place_in_space(self, gprim: PlacedGprim, space: Usd.Prim, copies: Floats | None = None) -> PlacedGprim:
        """Return a gprim placed by the transform of the prim `space` instead of its own.

        `copies` (k, 4, 4), if given, place k copies of the gprim in the space of that prim.

        Raises
        ------
        AssetError
            The prim `space` is not in the gprim's prototype or has no transform, or there are too many copies.
        """
        path, transforms = gprim.prim.GetPath(), gprim.transforms
        if space != gprim.prim:
            if gprim.prototype is not None and not space.GetPath().HasPrefix(gprim.prototype.GetPath()):
                raise AssetError(
                    f"{path}: {space.GetPath()} moves it, but is not in its prototype {gprim.prototype.GetPath()}"
                )
            transforms = self._matrix(space, gprim.prototype) @ gprim.prototype_placements
        if copies is not None:
            transforms = self._place_copies(copies, transforms, path, "points")
        return replace(gprim, transforms=transforms)

    def _walk(
        self,
        root: Usd.Prim,
        predicate: Usd._PrimFlagsPredicate,
        prototype: Usd.Prim | None,
        prototype_placements: Floats,
        outer_instancers: tuple[Sdf.Path, ...],
    ) -> Iterator[PlacedGprim]:
        """Yield the visible gprims at and below `root`.

        `prototype` and `prototype_placements` are as in `PlacedGprim`. `outer_instancers` are the instancers whose
        prototypes contain the root.
        """
        prims = iter(Usd.PrimRange(root, predicate))
        for prim in prims:
            imageable, instancer, gprim = self._type_flags(prim)
            if not imageable:
                if prim.GetTypeName() and not prim.IsA(Usd.Typed):
                    self._note(f"of the type {prim.GetTypeName()}, which USD does not know, not rendered", prim)
                continue
            self._check_order(prim)
            if not self._is_visible(prim):
                prims.PruneChildren()
                continue
            if instancer:
                prims.PruneChildren()
            if not (instancer or gprim):
                continue
            if UsdGeom.Imageable(prim).ComputePurpose() not in self._purposes:
                continue
            transforms = self._matrix(prim, prototype) @ prototype_placements
            if instancer:
                yield from self._walk_instancer(UsdGeom.PointInstancer(prim), transforms, outer_instancers)
            else:
                yield PlacedGprim(prim, transforms, prototype, prototype_placements)

    def _type_flags(self, prim: Usd.Prim) -> tuple[bool, bool, bool]:
        """Return whether a prim is Imageable, whether it is a point instancer, and whether it is a gprim."""
        name = prim.GetTypeName()
        if name not in self._flags_of_type:
            # A GenerativeProcedural counts as a gprim, so that a note reports that it is not rendered.
            gprim = prim.IsA(UsdGeom.Gprim) or name == "GenerativeProcedural"
            self._flags_of_type[name] = prim.IsA(UsdGeom.Imageable), prim.IsA(UsdGeom.PointInstancer), gprim
        return self._flags_of_type[name]

    def _is_visible(self, prim: Usd.Prim) -> bool:
        """Return whether a prim is not invisible itself, and note a purpose or a visibility that USD does not know.

        As in Hydra, a prim of an unknown purpose is not rendered, and an unknown visibility hides nothing. Raises
        AssetError if a value is not a token.
        """
        if (purpose := read_any_token(prim, "purpose", Usd.TimeCode.Default())) not in PURPOSES:
            self._note(f"of the purpose {quote(purpose)}, which USD does not know, not rendered", prim)
        if (visibility := read_any_token(prim, "visibility", self._time)) not in _VISIBILITIES:
            self._note(f"with the visibility {quote(visibility)}, which USD does not know, shown", prim)
        return bool(visibility != UsdGeom.Tokens.invisible)

    def _check_order(self, prim: Usd.Prim) -> None:
        """Note the names in a prim's xformOpOrder that are not operations of the prim; USD silently ignores them."""
        for name in read_texts(prim, "xformOpOrder"):
            operation = name.removeprefix("!invert!")
            if name != "!resetXformStack!" and not (operation and prim.HasAttribute(operation)):
                self._note(f"xformOpOrder names {quote(name)}, which is not there", prim)

    def _matrix(self, prim: Usd.Prim, prototype: Usd.Prim | None) -> Floats:
        """Return the matrix (4, 4), for row vectors, from a prim's space to its prototype, or to the stage for None.

        Raises AssetError if USD cannot compute it.
        """
        try:
            if prototype is None:
                return np.array(self._transforms.GetLocalToWorldTransform(prim), np.float64)
            return np.array(self._transforms.ComputeRelativeTransform(prim, prototype)[0], np.float64)
        except Tf.ErrorException as error:
            path = faulty_transform_path(prim, self._time)
            raise AssetError(f"{path}: USD cannot compute the transform: {error_message(error)}") from error

    def _walk_instancer(
        self, instancer: UsdGeom.PointInstancer, transforms: Floats, outer_instancers: tuple[Sdf.Path, ...]
    ) -> Iterator[PlacedGprim]:
        """Yield the visible gprims of a point instancer's prototypes, with a placement for every visible instance.

        `transforms` (j, 4, 4) are the placements of the instancer itself. `outer_instancers` are the instancers whose
        prototypes contain this instancer.
        """
        path = instancer.GetPath()
        if len(outer_instancers) >= _MAX_DEPTH:
            depth = len(outer_instancers)
            raise AssetError(f"{path}: is an instancer inside {depth} others; at most {_MAX_DEPTH - 1} would be right")
        prim = instancer.GetPrim()
        targets = relationship_targets(instancer.GetPrototypesRel())
        numbers = read_array(prim, "protoIndices", self._time, np.intp)
        check_range(numbers, len(targets), prim, "protoIndices", "prototypes")
        # These arrays are read only to check them; USD computes the transforms from the attributes.
        for name, kind, shape in _INSTANCE_ATTRIBUTES:
            count = len(read_array(prim, name, self._time, kind, shape)) if prim.HasAttribute(name) else 0
            if count != len(numbers) and (count or name == "positions"):
                raise AssetError(f"{path}: has {count} {name}, but {len(numbers)} protoIndices; they must agree")
        read_array(prim, "invisibleIds", self._time, np.intp)
        if len(numbers) == 0:
            return
        time = sample_time(self._time, instancer.GetPositionsAttr())
        matrices = np.array(
            instancer.ComputeInstanceTransformsAtTime(
                time, time, UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
            ),
            np.float64,
        )
        if len(matrices) != len(numbers):
            raise AssetError(f"{path}: USD computes {len(matrices)} placements; {len(numbers)} are needed")
        mask = instancer.ComputeMaskAtTime(self._time)
        is_visible = np.array(mask, bool) if len(mask) else np.ones(len(numbers), bool)
        for number, target in enumerate(targets):
            copies = matrices[is_visible & (numbers == number)]
            prototype = self._stage.GetPrimAtPath(target)
            if len(copies) == 0:
                continue
            if not prototype:
                raise AssetError(f"{path}: prototypes names {target}, which is not there; the path of a prim is needed")
            if any(outer.HasPrefix(target) for outer in (path, *outer_instancers)):
                raise AssetError(f"{path}: prototypes names {target}, which holds the instancer; it must not")
            placements = self._place_copies(copies, transforms, path, f"instances of {target}")
            yield from self._walk(prototype, _PROTOTYPE_PRIMS, prototype, placements, (*outer_instancers, path))

    def _place_copies(self, copies: Floats, transforms: Floats, path: Sdf.Path, noun: str) -> Floats:
        """Return the placements (j * k, 4, 4) of k `copies` (k, 4, 4) in j spaces, which `transforms` (j, 4, 4) place.

        Raises AssetError if the walk has more than `_MAX_INSTANCES` placements; `noun` names the copies.
        """
        count = len(copies) * len(transforms)
        self._placement_count += count
        if self._placement_count > _MAX_INSTANCES:
            raise AssetError(f"{path}: its {count} {noun} are too many: an asset can have {_MAX_INSTANCES} instances")
        return np.asarray((copies[None] @ transforms[:, None]).reshape(-1, 4, 4))
