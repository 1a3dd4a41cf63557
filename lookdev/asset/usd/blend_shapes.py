"""Reads UsdSkel's blend shapes, with inbetweens, as weighted offsets that are added to points and normals.

An inbetween is a further shape of a blend shape, at another weight than 1. The offsets are computed here because USD's
own functions read beyond their arrays if a target is missing or inactive.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdSkel

from lookdev.arrays import Floats, Indices
from lookdev.asset.usd.attributes import read_array
from lookdev.errors import AssetError

_DEFAULT_TIME = Usd.TimeCode.Default()
_WEIGHT_TOLERANCE = 1e-6  # USD takes weights for equal if they differ by less


@dataclass(frozen=True, eq=False)
class Offsets:
    """The offsets of a blend shape at its weight.

    `path` is the path of the blend shape. `points` (k, 3) are offsets of points; `normals` (k, 3) are offsets of
    normals, or (0, 3) if the shape has none. `indices` (k,) are the indices of the mesh's points to which the offsets
    are added; None means all points.
    """

    path: str
    indices: Indices | None
    points: Floats
    normals: Floats

    def offset_points(self, points: Floats) -> Floats:
        """Return points (n, 3) with the offsets added."""
        return self._add(points, self.points)

    def offset_normals(self, normals: Floats) -> Floats:
        """Return normals (n, 3), one for each point, with the offsets added; the results are not normalised."""
        return self._add(normals, self.normals)

    def _add(self, values: Floats, offsets: Floats) -> Floats:
        """Return values (n, 3) with offsets (k, 3) added at `indices`."""
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
    """Yield the offsets of a gprim's blend shapes; shapes of weight 0 are left out.

    The offsets are interpolated linearly between the two shapes with the nearest weights below and above. The shapes
    are: no offset at weight 0, each inbetween at its weight, and the blend shape itself at weight 1. `names` and
    `targets` are the gprim's blend shapes: their names and the paths of their prims. `weights` has the weights by name.
    Messages about inbetweens without effect are appended to `notes`.

    Raises
    ------
    AssetError
        Names and targets do not agree, a target is not a blend shape, or inbetweens contradict each other.
    """
    path = prim.GetPath()
    if len(names) != len(targets):
        raise AssetError(f"{path}: has {len(names)} skel:blendShapes, but {len(targets)} skel:blendShapeTargets")
    for name, target in zip(names, targets, strict=True):
        shape = UsdSkel.BlendShape(prim.GetStage().GetPrimAtPath(target))
        if not shape:
            raise AssetError(f"{path}: skel:blendShapeTargets {target} is not a BlendShape; the path of one is needed")
        weight = weights.get(name, 0.0)
        if weight == 0.0 or not shape.GetPrim().IsActive():
            continue
        # By the weight of a shape: its offsets of points and of normals.
        offsets_by_weight: dict[float, tuple[Floats, Floats]] = {
            0.0: (np.zeros((0, 3)), np.zeros((0, 3))),
            1.0: _read_offsets(shape.GetOffsetsAttr(), shape.GetNormalOffsetsAttr()),
        }
        for inbetween in shape.GetInbetweens():
            inbetween_weight = inbetween.GetWeight()
            if inbetween_weight is None or any(
                abs(inbetween_weight - other) < _WEIGHT_TOLERANCE for other in offsets_by_weight
            ):
                notes.append(f"{inbetween.GetAttr().GetPath()}: no weight, or that of another shape: it has no effect")
            else:
                offsets_by_weight[inbetween_weight] = _read_offsets(
                    inbetween.GetAttr(), inbetween.GetNormalOffsetsAttr()
                )
        # Weights below the least or above the greatest extrapolate from the two nearest shapes.
        shape_weights = sorted(offsets_by_weight)
        upper = min(max(bisect_right(shape_weights, weight), 1), len(shape_weights) - 1)
        low, high = shape_weights[upper - 1 : upper + 1]
        fraction = (weight - low) / (high - low)
        points, normals = (
            _interpolate_offsets(a, b, fraction, str(target))
            for a, b in zip(offsets_by_weight[low], offsets_by_weight[high], strict=True)
        )
        indices = read_array(shape.GetPrim(), "pointIndices", _DEFAULT_TIME, np.intp)
        yield Offsets(str(target), indices if len(indices) else None, points, normals)


def _read_offsets(points: Usd.Attribute, normals: Usd.Attribute) -> tuple[Floats, Floats]:
    """Return the values (k, 3) of two attributes, the offsets of points and of normals; (0, 3) if there are none."""
    point_offsets, normal_offsets = (
        read_array(attribute.GetPrim(), attribute.GetName(), _DEFAULT_TIME, np.float64, (3,))
        if attribute
        else np.zeros((0, 3))
        for attribute in (points, normals)
    )
    if len(normal_offsets) not in (0, len(point_offsets)):
        raise AssetError(
            f"{points.GetPrim().GetPath()}: has {len(point_offsets)} {points.GetName()}, but {len(normal_offsets)} "
            f"{normals.GetName()}; they must agree"
        )
    return point_offsets, normal_offsets


def _interpolate_offsets(before: Floats, after: Floats, fraction: float, path: str) -> Floats:
    """Interpolate linearly between the offsets (k, 3) of two shapes; a shape without offsets has offsets of 0.

    `fraction` is 0 at the shape `before` and 1 at the shape `after`.
    """
    if len(before) and len(after) and len(before) != len(after):
        raise AssetError(f"{path}: its shapes have {len(before)} and {len(after)} offsets; they must agree")
    result = np.zeros((max(len(before), len(after)), 3))
    for weight, offsets in ((1.0 - fraction, before), (fraction, after)):
        if len(offsets):
            result += weight * offsets
    return result
