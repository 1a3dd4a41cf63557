"""Which prims of a stage are shown, and where: visibility, purpose, instances and point instancers.

A prim inside a point instancer is visited once for each instancer above it, with a transform for every instance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom

from lookdev.asset.shape import LARGEST, Doubles
from lookdev.asset.usd.attributes import check_range, read_array, read_texts, read_token
from lookdev.asset.usd.velocities import numbered
from lookdev.errors import AssetError
from lookdev.stage import error_words, relationship_targets, shown

_SCENE = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
# A prototype may be an `over` or a `class`, which is visible only through its instancer.
_PROTOTYPE = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
_VISIBILITIES = (UsdGeom.Tokens.inherited, UsdGeom.Tokens.invisible)
# The attributes of a point instancer with a value for each instance.
_INSTANCES: tuple[tuple[str, Any, tuple[int, ...]], ...] = (
    ("positions", np.float64, (3,)),
    ("scales", np.float64, (3,)),
    ("orientations", np.float64, (4,)),
    ("orientationsf", np.float64, (4,)),
    ("ids", np.intp, ()),
)
_DEEPEST = 32  # instancers inside each other's prototypes
_MOST_INSTANCES = 2_000_000  # of all prims: a quarter of a gigabyte of matrices
PURPOSES = ("default", "render", "proxy", "guide")


@dataclass(frozen=True, eq=False)
class Seen:
    """A gprim that is shown, and its placements (k, 4, 4) in the stage, which multiply row vectors.

    `placed` (j, 4, 4) are those of `origin`, the prototype that it is in, or of the stage.
    """

    prim: Usd.Prim
    transforms: Doubles
    origin: Usd.Prim | None
    placed: Doubles


def affine(matrices: Doubles) -> Any:
    """Return which matrices (..., 4, 4) for row vectors place something: bounded, and with 0 0 0 1 as last column."""
    bounded = (np.abs(matrices) <= LARGEST).all(axis=(-2, -1))
    return bounded & (np.abs(matrices[..., 3] - (0.0, 0.0, 0.0, 1.0)) < 1e-9).all(axis=-1)


def misplaced_by(prim: Usd.Prim, time: Usd.TimeCode) -> str:
    """Return the operation of a prim, or of one above it, that USD cannot compute or that is not `affine`.

    Where there is none, it is the prim itself.
    """
    above = prim
    while above:
        order = place = f"{above.GetPath()}.xformOpOrder"
        try:
            for operation in UsdGeom.Xformable(above).GetOrderedXformOps() if above.IsA(UsdGeom.Xformable) else ():
                place = str(operation.GetAttr().GetPath())
                if not affine(np.array(operation.GetOpTransform(time), np.float64)):
                    return place
            place = order
            UsdGeom.XformCache(time).GetLocalTransformation(above)
        except Tf.ErrorException:
            return place
        above = above.GetParent()
    return str(prim.GetPath())


class Walk:
    """Walks over a stage at a time.

    Hidden ancestors of the prim where a walk starts do not hide it. An `unknown` prim is of a type that USD does not
    know, such as one of another program's plug-in; `astray` are operations of transforms that are not there, with the
    prims that name them.
    """

    def __init__(self, stage: Usd.Stage, time: Usd.TimeCode, purposes: tuple[str, ...]) -> None:
        self.unknown: list[Usd.Prim] = []
        self.astray: dict[str, list[Usd.Prim]] = {}
        self._stage = stage
        self._time = time
        self._purposes = purposes
        self._transforms = UsdGeom.XformCache(time)
        self._placed = 0
        self._kinds: dict[str, tuple[bool, bool, bool]] = {}

    def below(self, path: str) -> Iterator[Seen]:
        """Yield the gprims at and below a path; raises AssetError where an instancer contradicts itself."""
        yield from self._walk(self._stage.GetPrimAtPath(path), _SCENE, None, np.eye(4)[None], ())

    def moved(self, seen: Seen, space: Usd.Prim, copies: Doubles | None = None) -> Seen:
        """Return a gprim placed by the transform of another prim, and by `copies` (k, 4, 4) in its space.

        Raises
        ------
        AssetError
            The other prim is not in the same prototype or has no transform, or there are too many copies.
        """
        path, transforms = seen.prim.GetPath(), seen.transforms
        if space != seen.prim:
            if seen.origin is not None and not space.GetPath().HasPrefix(seen.origin.GetPath()):
                raise AssetError(
                    f"{path}: {space.GetPath()} moves it, but is not in its prototype {seen.origin.GetPath()}"
                )
            transforms = self._transform(space, seen.origin) @ seen.placed
        if copies is not None:
            transforms = self._copied(copies, transforms, path, "points")
        return replace(seen, transforms=transforms)

    def _walk(
        self, root: Usd.Prim, predicate: Any, origin: Usd.Prim | None, placed: Doubles, around: tuple[Sdf.Path, ...]
    ) -> Iterator[Seen]:
        """Yield what is shown at and below `root`.

        `placed` (k, 4, 4) are the placements in the stage of `origin`, a prototype or the stage itself; `around` are
        the instancers whose prototypes contain the root.
        """
        prims = iter(Usd.PrimRange(root, predicate))
        for prim in prims:
            imageable, instancer, gprim = self._kind(prim)
            if not imageable:
                if prim.GetTypeName() and not prim.IsA(Usd.Typed):
                    self.unknown.append(prim)
                continue
            self._check_order(prim)
            if prim.GetAttribute("purpose").Get() not in PURPOSES:
                read_token(prim, "purpose", Usd.TimeCode.Default(), PURPOSES)
            if prim.GetAttribute("visibility").Get(self._time) != UsdGeom.Tokens.inherited:
                read_token(prim, "visibility", self._time, _VISIBILITIES)
                prims.PruneChildren()
                continue
            if instancer:
                prims.PruneChildren()
            if not (instancer or gprim):
                continue
            if UsdGeom.Imageable(prim).ComputePurpose() not in self._purposes:
                continue
            transforms = self._transform(prim, origin) @ placed
            if instancer:
                yield from self._instanced(UsdGeom.PointInstancer(prim), transforms, around)
            else:
                yield Seen(prim, transforms, origin, placed)

    def _kind(self, prim: Usd.Prim) -> tuple[bool, bool, bool]:
        """Return whether prims of this type are Imageable, whether point instancers, and whether gprims."""
        name = prim.GetTypeName()
        if name not in self._kinds:
            gprim = prim.IsA(UsdGeom.Gprim) or name == "GenerativeProcedural"
            self._kinds[name] = prim.IsA(UsdGeom.Imageable), prim.IsA(UsdGeom.PointInstancer), gprim
        return self._kinds[name]

    def _check_order(self, prim: Usd.Prim) -> None:
        """Note the operations that a prim's xformOpOrder names in vain: USD leaves them out without a word."""
        for name in read_texts(prim, "xformOpOrder"):
            operation = name.removeprefix("!invert!")
            if name != "!resetXformStack!" and not (operation and prim.HasAttribute(operation)):
                self.astray.setdefault(shown(name), []).append(prim)

    def _transform(self, prim: Usd.Prim, origin: Usd.Prim | None) -> Doubles:
        """Return the matrix (4, 4) from a prim to `origin`, or to the stage; raises AssetError where it has none."""
        try:
            if origin is None:
                return np.array(self._transforms.GetLocalToWorldTransform(prim), np.float64)
            return np.array(self._transforms.ComputeRelativeTransform(prim, origin)[0], np.float64)
        except Tf.ErrorException as error:
            place = misplaced_by(prim, self._time)
            raise AssetError(f"{place}: USD cannot compute the transform: {error_words(error)}") from error

    def _instanced(
        self, instancer: UsdGeom.PointInstancer, transforms: Doubles, around: tuple[Sdf.Path, ...]
    ) -> Iterator[Seen]:
        """Yield what is shown of a point instancer's prototypes, with a placement for every visible instance."""
        path = instancer.GetPath()
        if len(around) >= _DEEPEST:
            raise AssetError(
                f"{path}: is an instancer inside {len(around)} others; at most {_DEEPEST - 1} would be right"
            )
        prim = instancer.GetPrim()
        targets = relationship_targets(instancer.GetPrototypesRel())
        numbers = read_array(prim, "protoIndices", self._time, np.intp)
        check_range(numbers, len(targets), prim, "protoIndices", "prototypes")
        for name, kind, shape in _INSTANCES:
            count = len(read_array(prim, name, self._time, kind, shape)) if prim.HasAttribute(name) else 0
            if count != len(numbers) and (count or name == "positions"):
                raise AssetError(f"{path}: has {count} {name}, but {len(numbers)} protoIndices; they must agree")
        read_array(prim, "invisibleIds", self._time, np.intp)
        if len(numbers) == 0:
            return
        time = numbered(self._time, instancer.GetPositionsAttr())
        placed = np.array(
            instancer.ComputeInstanceTransformsAtTime(
                time, time, UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
            ),
            np.float64,
        )
        if len(placed) != len(numbers):
            raise AssetError(f"{path}: USD cannot compute its {len(numbers)} placements, but {len(placed)}")
        mask = instancer.ComputeMaskAtTime(self._time)
        seen = np.array(mask, bool) if len(mask) else np.ones(len(numbers), bool)
        for number, target in enumerate(targets):
            chosen = placed[seen & (numbers == number)]
            prototype = self._stage.GetPrimAtPath(target)
            if len(chosen) == 0:
                continue
            if not prototype:
                raise AssetError(f"{path}: prototypes names {target}, which is not there; the path of a prim is needed")
            if any(each.HasPrefix(target) for each in (path, *around)):
                raise AssetError(f"{path}: prototypes names {target}, which holds the instancer; it must not")
            inside = self._copied(chosen, transforms, path, f"instances of {target}")
            yield from self._walk(prototype, _PROTOTYPE, prototype, inside, (*around, path))

    def _copied(self, copies: Doubles, transforms: Doubles, path: Sdf.Path, what: str) -> Doubles:
        """Return the placements (j * k, 4, 4) of copies (k, 4, 4) in the spaces that transforms (j, 4, 4) place."""
        count = len(copies) * len(transforms)
        self._placed += count
        if self._placed > _MOST_INSTANCES:
            raise AssetError(f"{path}: its {count} {what} are too many: an asset can have {_MOST_INSTANCES} instances")
        return np.asarray((copies[None] @ transforms[:, None]).reshape(-1, 4, 4))
