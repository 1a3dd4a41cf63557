"""The smallest sphere around an asset, which the camera frames, so that its size is constant over a turntable."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.mesh import Asset, Floats, Instance, Mesh
from lookdev.asset.normals import Doubles

Index = NDArray[np.intp]

_ROUNDS = 100
_TOLERANCE = 1e-7
_CELLS = 8  # along each side of the box of a mesh
_PARTS = 512  # of a mesh, at most
_FEW_POINTS, _FEW_INSTANCES = 512, 16  # of a mesh that has no cells
_RUN, _SHORT_RUN = 1024, 128  # points
_INSTANCES = 32  # whose parts are sorted at once


class _Cloud:
    """All points of all instances; the search for the farthest one skips instances, and parts of them, by their bounds.

    The parts of a mesh are runs of its points, which mostly lie near each other; those of a mesh of many points and
    many instances are sorted by the cells of a grid in its box.
    """

    def __init__(self, meshes: Sequence[Mesh], instances: Sequence[Instance]) -> None:
        self._points, counts, boxes = _joined(meshes)
        mesh = np.array([instance.mesh for instance in instances])
        divided = (counts >= _FEW_POINTS) & (np.bincount(mesh, minlength=len(meshes)) >= _FEW_INSTANCES)
        begins = np.cumsum(counts) - counts
        for number in np.flatnonzero(divided):
            own = self._points[begins[number] : begins[number] + counts[number]]
            own[:] = own[np.argsort(grid_cells(own, boxes[number]), kind="stable")]
        runs = np.maximum(np.where(divided, _SHORT_RUN, _RUN), -(-counts // _PARTS))
        parts = -(-counts // runs)
        first = np.cumsum(parts) - parts
        self._starts = np.repeat(begins - first * runs, parts) + np.arange(parts.sum()) * np.repeat(runs, parts)
        self._lengths = np.diff(self._starts, append=len(self._points))
        self._middles, self._halves = _middles_and_halves(bounding_boxes(self._points, self._starts))
        self._first_part, self._parts = first[mesh], parts[mesh]
        matrices = np.array([instance.matrix for instance in instances])
        self._linear, self._offset = matrices[:, :3, :3], matrices[:, :3, 3]
        self._boxes = tuple(each[mesh] for each in _middles_and_halves(boxes))
        self.centers = self._placed(np.arange(len(mesh)), self._boxes[0])

    def farthest(self, center: Doubles) -> tuple[Doubles, float]:
        """Return the point farthest from `center` and its distance."""
        best, distance = center, -1.0
        limits = self._bounds(center, np.arange(len(self._parts)), *self._boxes)
        order = np.argsort(-limits)
        for first in range(0, len(order), _INSTANCES):
            instances = order[first : first + _INSTANCES]
            instances = instances[limits[instances] > distance]
            counts = self._parts[instances]
            owner = np.repeat(instances, counts)
            part = self._first_part[owner] + np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
            bounds = self._bounds(center, owner, self._middles[part], self._halves[part])
            for k in np.argsort(-bounds):
                if bounds[k] <= distance:
                    break
                start = self._starts[part[k]]
                points = self._points[start : start + self._lengths[part[k]]]
                world = points @ self._linear[owner[k]].T + self._offset[owner[k]]
                squares = ((world - center) ** 2).sum(axis=1)
                i = int(squares.argmax())
                if squares[i] > distance * abs(distance):
                    best, distance = world[i], float(np.sqrt(squares[i]))
        return best, distance

    def _bounds(self, center: Doubles, owner: Index, middles: Doubles, halves: Doubles) -> Doubles:
        """Return distances (k,) from a place that no point of boxes of some instances exceeds."""
        away = np.abs(self._placed(owner, middles) - center)
        return np.asarray(np.linalg.norm(away + np.einsum("nij,nj->ni", np.abs(self._linear[owner]), halves), axis=1))

    def _placed(self, owner: Index, points: Doubles) -> Doubles:
        """Return a point of each instance in the world."""
        return np.asarray(np.einsum("nij,nj->ni", self._linear[owner], points) + self._offset[owner])


def bounding_sphere(meshes: Sequence[Mesh], instances: Sequence[Instance]) -> tuple[tuple[float, float, float], float]:
    """Return centre and radius, in metres, of the smallest sphere around all instanced points.

    The centre is rounded as by `smallest_ball`; the radius is that of all points about the rounded centre.
    """
    cloud = _Cloud(meshes, instances)
    center = smallest_ball(cloud.farthest, cloud.centers.mean(axis=0))
    x, y, z = center.tolist()
    return (x, y, z), cloud.farthest(center)[1]


def smallest_ball(farthest: Callable[[Doubles], tuple[Doubles, float]], start: Doubles) -> Doubles:
    """Return the centre of the smallest ball, or circle, around points; `farthest` finds the one farthest from a place.

    From `start` on, the farthest point is added to the support again and again (Gärtner, "Fast and Robust Smallest
    Enclosing Balls", 1999). The centre is rounded to a millionth of the radius, so that it does not depend on the
    machine's linear algebra.
    """
    support, _ = farthest(start)
    support, center, radius = support[None], support, 0.0
    for _ in range(_ROUNDS):
        far, distance = farthest(center)
        if distance <= radius * (1.0 + _TOLERANCE):
            break
        support, center, radius = _smallest_ball(support, far)
    if radius > 0.0:
        center = np.round(center, 6 - int(np.floor(np.log10(radius)))) + 0.0
    return center


def about_origin(asset: Asset) -> Asset:
    """Return the asset moved so that its bounding sphere is about the origin, and each mesh about its own.

    In float32, a metre at a distance of 100 km has 128 steps. The digest remains that of the asset before.
    """
    middles = _joined(asset.meshes)[2].mean(axis=1)
    local = [_moved(mesh.points, middle) for mesh, middle in zip(asset.meshes, middles, strict=True)]
    matrices = np.array([instance.matrix for instance in asset.instances])
    shown = [instance.mesh for instance in asset.instances]
    matrices[:, :3, 3] += (matrices[:, :3, :3] @ middles[shown, :, None])[..., 0] - asset.center
    return replace(
        asset,
        meshes=tuple(replace(mesh, points=each) for mesh, each in zip(asset.meshes, local, strict=True)),
        instances=tuple(
            replace(instance, matrix=matrix) for instance, matrix in zip(asset.instances, matrices, strict=True)
        ),
        center=(0.0, 0.0, 0.0),
    )


def _moved(points: Floats, origin: Doubles) -> Floats:
    """Return points about another origin, subtracted in float64."""
    return np.subtract(points, origin, out=np.empty_like(points), dtype=np.float64, casting="same_kind")


def _joined(meshes: Sequence[Mesh]) -> tuple[Floats, Index, Doubles]:
    """Return the points of all meshes, how many each has, and its least and greatest coordinates (k, 2, 3)."""
    points = np.concatenate([mesh.points for mesh in meshes])
    counts = np.array([len(mesh.points) for mesh in meshes])
    return points, counts, bounding_boxes(points, np.cumsum(counts) - counts)


def bounding_boxes(points: NDArray[np.floating[Any]], starts: Index) -> Doubles:
    """Return the least and the greatest coordinates (k, 2, 3) of runs of points."""
    boxes = [each.reduceat(points, starts) for each in (np.minimum, np.maximum)]
    return np.asarray(np.stack(boxes, axis=1), np.float64)


def _middles_and_halves(boxes: Doubles) -> tuple[Doubles, Doubles]:
    """Return the middles (k, 3) of boxes and half their extents (k, 3)."""
    return boxes.mean(axis=1), 0.5 * np.ptp(boxes, axis=1)


def grid_cells(points: NDArray[np.floating[Any]], box: Doubles) -> Index:
    """Return the cell of each point of a mesh."""
    extent = np.ptp(box, axis=0)
    cells = np.floor((points - box[0]) * (0.999 * _CELLS / np.where(extent > 0.0, extent, 1.0)))
    return np.asarray(cells @ np.array([_CELLS**2, _CELLS, 1.0]), np.intp)


def _smallest_ball(support: Doubles, outside: Doubles) -> tuple[Doubles, Doubles, float]:
    """Return support (at most 4 points), centre and radius of the smallest ball of `support` and `outside`.

    The point outside the old ball is on the new one: the support is that point and up to three old ones.
    """
    points = np.vstack([support, outside])
    best: tuple[Doubles, Doubles, float] | None = None
    for count in range(1, min(len(support), 3) + 1):
        for chosen in itertools.combinations(support, count):
            legs = np.stack(chosen) - outside
            center = outside + np.linalg.lstsq(2.0 * legs, (legs * legs).sum(axis=1), rcond=None)[0]
            radius = float(np.max(np.linalg.norm(points - center, axis=1)))
            if best is None or radius < best[2]:
                best = np.vstack([legs + outside, outside]), center, radius
    assert best is not None, "a support is never empty"
    return best
