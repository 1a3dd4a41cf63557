"""UsdSkel's blend shapes, with inbetweens: what they add to points and normals by their weights.

Computed here, since USD's own functions read beyond their arrays where a target is missing or inactive.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdSkel

from lookdev.asset.shape import Doubles, Index
from lookdev.asset.usd.attributes import read_array
from lookdev.errors import AssetError

_ALWAYS = Usd.TimeCode.Default()
_SAME = 1e-6  # weights that USD takes for equal


@dataclass(frozen=True, eq=False)
class Offsets:
    """What a blend shape adds to the points `indices` (k,), or to all points, and to their normals: (k, 3) or none."""

    path: str
    indices: Index | None
    points: Doubles
    normals: Doubles

    def moved(self, points: Doubles) -> Doubles:
        """Return points (n, 3) with their offsets."""
        return self._added(points, self.points)

    def turned(self, normals: Doubles) -> Doubles:
        """Return normals (n, 3) by point with their offsets, not unit."""
        return self._added(normals, self.normals)

    def _added(self, values: Doubles, offsets: Doubles) -> Doubles:
        if len(offsets) == 0:
            return values
        indices = np.arange(len(values)) if self.indices is None else self.indices
        if len(offsets) != len(indices):
            raise AssetError(f"{self.path}: has {len(offsets)} offsets, but {len(indices)} points; they must agree")
        if not 0 <= indices.min() <= indices.max() < len(values):
            raise AssetError(f"{self.path}: pointIndices must lie in 0..{len(values) - 1}, the points of the mesh")
        result = values.copy()
        np.add.at(result, indices, offsets)
        return result


def blend_offsets(
    prim: Usd.Prim, names: Sequence[str], targets: Sequence[Sdf.Path], weights: Mapping[str, float], notes: list[str]
) -> Iterator[Offsets]:
    """Yield what each blend shape with a weight adds to a prim, in proportion between the two nearest inbetweens.

    Raises
    ------
    AssetError
        Names and targets do not agree, a target is no blend shape, or inbetweens do not fit together.
    """
    where = prim.GetPath()
    if len(names) != len(targets):
        raise AssetError(f"{where}: has {len(names)} skel:blendShapes, but {len(targets)} skel:blendShapeTargets")
    for name, target in zip(names, targets, strict=True):
        shape = UsdSkel.BlendShape(prim.GetStage().GetPrimAtPath(target))
        if not shape:
            raise AssetError(f"{where}: skel:blendShapeTargets {target} is no BlendShape; the path of one is needed")
        weight = weights.get(name, 0.0)
        if weight == 0.0 or not shape.GetPrim().IsActive():
            continue
        rows: dict[float, tuple[Doubles, Doubles]] = {
            0.0: (np.zeros((0, 3)), np.zeros((0, 3))),
            1.0: _offsets(shape.GetOffsetsAttr(), shape.GetNormalOffsetsAttr()),
        }
        for inbetween in shape.GetInbetweens():
            at = inbetween.GetWeight()
            if at is None or any(abs(at - other) < _SAME for other in rows):
                notes.append(f"{inbetween.GetAttr().GetPath()}: no weight, or that of another shape: it has no effect")
            else:
                rows[at] = _offsets(inbetween.GetAttr(), inbetween.GetNormalOffsetsAttr())
        known = sorted(rows)
        upper = min(max(bisect_right(known, weight), 1), len(known) - 1)
        low, high = known[upper - 1 : upper + 1]
        part = (weight - low) / (high - low)
        points, normals = (_mixed(a, b, part, str(target)) for a, b in zip(rows[low], rows[high], strict=True))
        indices = read_array(shape.GetPrim(), "pointIndices", _ALWAYS, np.intp)
        yield Offsets(str(target), indices if len(indices) else None, points, normals)


def _offsets(points: Any, normals: Any) -> tuple[Doubles, Doubles]:
    """Return the values (k, 3) of two attributes, none where they are not authored."""
    moved, turned = (
        read_array(each.GetPrim(), each.GetName(), _ALWAYS, np.float64, (3,)) if each else np.zeros((0, 3))
        for each in (points, normals)
    )
    if len(turned) not in (0, len(moved)):
        raise AssetError(
            f"{points.GetPrim().GetPath()}: has {len(moved)} {points.GetName()}, but {len(turned)} "
            f"{normals.GetName()}; they must agree"
        )
    return moved, turned


def _mixed(before: Doubles, after: Doubles, part: float, where: str) -> Doubles:
    """Return offsets a part of the way between two shapes; one without offsets moves nothing."""
    if len(before) and len(after) and len(before) != len(after):
        raise AssetError(f"{where}: its shapes have {len(before)} and {len(after)} offsets; they must agree")
    result = np.zeros((max(len(before), len(after)), 3))
    for weight, offsets in ((1.0 - part, before), (part, after)):
        if len(offsets):
            result += weight * offsets
    return result
