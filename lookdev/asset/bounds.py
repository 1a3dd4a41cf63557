"""The smallest sphere around an asset. The camera frames it, so that its size is constant over a turntable."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lookdev.arrays import Floats, Floats32, Indices, Reals
from lookdev.asset.mesh import Asset, Instance, Mesh

_MAX_ROUNDS = 100
_TOLERANCE = 1e-7
_CELLS = 8  # along each side of a mesh's bounding box
_MAX_PARTS = 512  # of a mesh
_FEW_POINTS, _FEW_INSTANCES = 512, 16  # the points of a mesh with fewer points or instances are not sorted by cells
_PART_POINTS, _SHORT_PART_POINTS = 1024, 128  # points of a part, if the mesh is not sorted by cells, and if it is
_INSTANCE_BLOCK = 32  # instances whose parts are sorted together


class _InstancedPoints:
    """All points of all instances, with bounds of instances and of their parts for the search of the farthest point.

    The parts of a mesh are runs of consecutive points, which mostly lie near each other. The points of a mesh that has
    many, and many instances, are first sorted by the cells of a grid in its bounding box.
    """

    def __init__(self, meshes: Sequence[Mesh], instances: Sequence[Instance]) -> None:
        self._points, counts, boxes = _join_points(meshes)
        mesh = np.array([instance.mesh for instance in instances])
        is_gridded = (counts >= _FEW_POINTS) & (np.bincount(mesh, minlength=len(meshes)) >= _FEW_INSTANCES)
        begins = np.cumsum(counts) - counts
        for number in np.flatnonzero(is_gridded):
            mesh_points = self._points[begins[number] : begins[number] + counts[number]]
            mesh_points[:] = mesh_points[np.argsort(grid_cells(mesh_points, boxes[number]), kind="stable")]
        # Of each mesh: the number of points in a part, the number of parts, and the number of the first part.
        runs = np.maximum(np.where(is_gridded, _SHORT_PART_POINTS, _PART_POINTS), -(-counts // _MAX_PARTS))
        parts = -(-counts // runs)
        first = np.cumsum(parts) - parts
        self._starts = np.repeat(begins - first * runs, parts) + np.arange(parts.sum()) * np.repeat(runs, parts)
        self._lengths = np.diff(self._starts, append=len(self._points))
        self._part_centers, self._part_half_extents = _centers_and_half_extents(
            bounding_boxes(self._points, self._starts)
        )
        self._first_part, self._parts = first[mesh], parts[mesh]
        matrices = np.array([instance.matrix for instance in instances])
        self._linear, self._offset = matrices[:, :3, :3], matrices[:, :3, 3]
        self._boxes = tuple(values[mesh] for values in _centers_and_half_extents(boxes))
        self.centers = self._transform(np.arange(len(mesh)), self._boxes[0])

    def farthest(self, center: Floats) -> tuple[Floats, float]:
        """Return the point farthest from `center` and its distance.

        A box gives an upper bound of the distance of its points. Instances, then parts in a block of instances, are
        visited from the largest bound on; those whose bound does not exceed the largest distance so far are skipped.
        """
        best, distance = center, -1.0
        limits = self._bounds(center, np.arange(len(self._parts)), *self._boxes)
        order = np.argsort(-limits)
        for first in range(0, len(order), _INSTANCE_BLOCK):
            block = order[first : first + _INSTANCE_BLOCK]
            block = block[limits[block] > distance]
            counts = self._parts[block]
            owners = np.repeat(block, counts)
            parts = self._first_part[owners] + np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
            bounds = self._bounds(center, owners, self._part_centers[parts], self._part_half_extents[parts])
            for k in np.argsort(-bounds):
                if bounds[k] <= distance:
                    break
                start = self._starts[parts[k]]
                points = self._points[start : start + self._lengths[parts[k]]]
                world = points @ self._linear[owners[k]].T + self._offset[owners[k]]
                squares = ((world - center) ** 2).sum(axis=1)
                i = int(squares.argmax())
                if squares[i] > distance * abs(distance):  # a negative `distance`: no point so far
                    best, distance = world[i], float(np.sqrt(squares[i]))
        return best, distance

    def _bounds(self, center: Floats, instances: Indices, centers: Floats, half_extents: Floats) -> Floats:
        """Return upper bounds (k,) of the distances from `center` to the points in boxes of instances."""
        away = np.abs(self._transform(instances, centers) - center)
        extents = np.einsum("nij,nj->ni", np.abs(self._linear[instances]), half_extents)
        return np.asarray(np.linalg.norm(away + extents, axis=1))

    def _transform(self, instances: Indices, points: Floats) -> Floats:
        """Return points (k, 3), one of each instance (k,), in world space."""
        return np.asarray(np.einsum("nij,nj->ni", self._linear[instances], points) + self._offset[instances])


def bounding_sphere(meshes: Sequence[Mesh], instances: Sequence[Instance]) -> tuple[tuple[float, float, float], float]:
    """Return centre and radius, in metres, of the smallest sphere around all instanced points.

    `smallest_ball` rounds the centre; the radius reaches all points from the rounded centre.
    """
    cloud = _InstancedPoints(meshes, instances)
    center = smallest_ball(cloud.farthest, cloud.centers.mean(axis=0))
    x, y, z = center.tolist()
    return (x, y, z), cloud.farthest(center)[1]


def smallest_ball(farthest: Callable[[Floats], tuple[Floats, float]], start: Floats) -> Floats:
    """Return the centre of the smallest ball, or circle, around points.

    `farthest(center)` returns the point farthest from a centre, and its distance. Starting at `start`, the farthest
    point is added to the support until none lies outside (Gärtner, "Fast and Robust Smallest Enclosing Balls", 1999).
    The centre is rounded to a millionth of the radius, so that it does not depend on the machine's linear algebra.
    """
    support, _ = farthest(start)
    support, center, radius = support[None], support, 0.0
    for _ in range(_MAX_ROUNDS):
        far, distance = farthest(center)
        if distance <= radius * (1.0 + _TOLERANCE):
            break
        support, center, radius = _update_ball(support, far)
    if radius > 0.0:
        center = np.round(center, 6 - int(np.floor(np.log10(radius)))) + 0.0
    return center


def center_asset(asset: Asset) -> Asset:
    """Return the asset with its bounding sphere centred at the world origin, and each mesh at its own origin.

    This keeps precision: in float32, a metre at a distance of 100 km has 128 steps. The digest does not change.
    """
    centers = _join_points(asset.meshes)[2].mean(axis=1)
    centered_points = [_translate(mesh.points, center) for mesh, center in zip(asset.meshes, centers, strict=True)]
    matrices = np.array([instance.matrix for instance in asset.instances])
    mesh_numbers = [instance.mesh for instance in asset.instances]
    matrices[:, :3, 3] += (matrices[:, :3, :3] @ centers[mesh_numbers, :, None])[..., 0] - asset.center
    return replace(
        asset,
        meshes=tuple(replace(mesh, points=points) for mesh, points in zip(asset.meshes, centered_points, strict=True)),
        instances=tuple(
            replace(instance, matrix=matrix) for instance, matrix in zip(asset.instances, matrices, strict=True)
        ),
        center=(0.0, 0.0, 0.0),
    )


def _translate(points: Floats32, origin: Floats) -> Floats32:
    """Return points relative to another origin, subtracted in float64."""
    return np.subtract(points, origin, out=np.empty_like(points), dtype=np.float64, casting="same_kind")


def _join_points(meshes: Sequence[Mesh]) -> tuple[Floats32, Indices, Floats]:
    """Return the points of all meshes, the number of points of each (k,), and the bounding boxes (k, 2, 3)."""
    points = np.concatenate([mesh.points for mesh in meshes])
    counts = np.array([len(mesh.points) for mesh in meshes])
    return points, counts, bounding_boxes(points, np.cumsum(counts) - counts)


def bounding_boxes(points: Reals, starts: Indices) -> Floats:
    """Return the least and the greatest coordinates (k, 2, 3) of runs of points that begin at `starts`."""
    boxes = [extremum.reduceat(points, starts) for extremum in (np.minimum, np.maximum)]
    return np.asarray(np.stack(boxes, axis=1), np.float64)


def _centers_and_half_extents(boxes: Floats) -> tuple[Floats, Floats]:
    """Return the centres (k, 3) of boxes and half their extents (k, 3)."""
    return boxes.mean(axis=1), 0.5 * np.ptp(boxes, axis=1)


def grid_cells(points: Reals, box: Floats) -> Indices:
    """Return the number of the grid cell of each point (n, 3) in a box (2, 3)."""
    extent = np.ptp(box, axis=0)
    cells = np.floor((points - box[0]) * (0.999 * _CELLS / np.where(extent > 0.0, extent, 1.0)))
    return np.asarray(cells @ np.array([_CELLS**2, _CELLS, 1.0]), np.intp)


def _update_ball(support: Floats, outside: Floats) -> tuple[Floats, Floats, float]:
    """Return support (at most 4 points), centre and radius of the smallest ball around `support` and `outside`.

    The point `outside` the old ball lies on the new one: the new support is that point and up to three old ones.
    """
    points = np.vstack([support, outside])
    best: tuple[Floats, Floats, float] | None = None
    for count in range(1, min(len(support), 3) + 1):
        for subset in itertools.combinations(support, count):
            legs = np.stack(subset) - outside
            center = outside + np.linalg.lstsq(2.0 * legs, (legs * legs).sum(axis=1), rcond=None)[0]
            radius = float(np.max(np.linalg.norm(points - center, axis=1)))
            if best is None or radius < best[2]:
                best = np.vstack([legs + outside, outside]), center, radius
    assert best is not None, "a support is never empty"
    return best
