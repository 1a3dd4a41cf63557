"""Computes the smallest sphere around an asset; a camera that frames it shows the asset in one size over a turntable.

`bounding_sphere` finds the sphere, and `center_asset` moves its centre to the world origin. `smallest_ball`,
`bounding_boxes` and `grid_cells` serve other modules, too.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lookdev.arrays import Floats, Floats32, Indices, Reals
from lookdev.asset.mesh import Asset, Instance, Mesh

_MAX_ROUNDS = 100  # of the search for the smallest ball
_TOLERANCE = 1e-7  # relative to the ball's radius: points farther out by less count as inside
_CELLS = 8  # grid cells along each side of a mesh's bounding box
# A part is a run of consecutive points of a mesh (`_InstancedPoints`).
_MAX_PARTS = 512  # parts of a mesh
_FEW_POINTS, _FEW_INSTANCES = 512, 16  # the points of a mesh with fewer points or instances are not sorted by cells
_PART_POINTS, _SHORT_PART_POINTS = 1024, 128  # points of a part, if the mesh is not sorted by cells, and if it is
_INSTANCE_BLOCK = 32  # instances whose parts are examined together


class _InstancedPoints:
    """All points of all instances, with bounding boxes of the meshes and of their parts, to find the farthest point.

    A part is a run of consecutive points of a mesh. Consecutive points mostly lie near each other. If a mesh has many
    points and many instances, its points are first sorted by the cells of a grid in its bounding box, so that its parts
    become compact. `centers` (k, 3) has the centre of each instance's bounding box in world space.
    """

    def __init__(self, meshes: Sequence[Mesh], instances: Sequence[Instance]) -> None:
        self._points, counts, boxes = _join_points(meshes)
        mesh_numbers = np.array([instance.mesh for instance in instances])
        is_gridded = (counts >= _FEW_POINTS) & (np.bincount(mesh_numbers, minlength=len(meshes)) >= _FEW_INSTANCES)
        begins = np.cumsum(counts) - counts
        for number in np.flatnonzero(is_gridded):
            mesh_points = self._points[begins[number] : begins[number] + counts[number]]
            mesh_points[:] = mesh_points[np.argsort(grid_cells(mesh_points, boxes[number]), kind="stable")]
        # For each mesh: `runs` is the number of points in a part, `parts` the number of parts, and `first` the number
        # of the first part. For each part: `_starts` and `_lengths` are its points in the array of all points.
        runs = np.maximum(np.where(is_gridded, _SHORT_PART_POINTS, _PART_POINTS), -(-counts // _MAX_PARTS))
        parts = -(-counts // runs)
        first = np.cumsum(parts) - parts
        self._starts = np.repeat(begins - first * runs, parts) + np.arange(parts.sum()) * np.repeat(runs, parts)
        self._lengths = np.diff(self._starts, append=len(self._points))
        self._part_centers, self._part_half_extents = _centers_and_half_extents(
            bounding_boxes(self._points, self._starts)
        )
        self._first_part, self._parts = first[mesh_numbers], parts[mesh_numbers]
        # For each instance: its matrix, and the centre and the half-extents of its mesh's bounding box.
        matrices = np.array([instance.matrix for instance in instances])
        self._linear, self._offset = matrices[:, :3, :3], matrices[:, :3, 3]
        self._boxes = tuple(values[mesh_numbers] for values in _centers_and_half_extents(boxes))
        self.centers = self._transform(np.arange(len(mesh_numbers)), self._boxes[0])

    def farthest(self, center: Floats) -> tuple[Floats, float]:
        """Return the point (3,) farthest from `center` (3,) in world space, and its distance.

        The distance to the farthest corner of a box bounds the distances of the points in it. Instances are visited in
        descending order of this bound, in blocks; so are the parts of the instances in a block. An instance or a part
        is skipped if its bound does not exceed the largest distance so far.
        """
        best, distance = center, -1.0
        limits = self._bounds(center, np.arange(len(self._parts)), *self._boxes)
        order = np.argsort(-limits)
        for first in range(0, len(order), _INSTANCE_BLOCK):
            block = order[first : first + _INSTANCE_BLOCK]
            block = block[limits[block] > distance]
            # `parts` has the numbers of all parts of the block's instances, and `owners` the instance of each.
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
                if squares[i] > distance * abs(distance):  # `distance` is negative before the first point
                    best, distance = world[i], float(np.sqrt(squares[i]))
        return best, distance

    def _bounds(self, center: Floats, instances: Indices, centers: Floats, half_extents: Floats) -> Floats:
        """Return upper bounds (k,) of the distances from `center` to the points in k boxes.

        `centers` and `half_extents` (k, 3) are those of the boxes, each in the object space of an instance, whose
        number is in `instances` (k,).
        """
        away = np.abs(self._transform(instances, centers) - center)
        extents = np.einsum("nij,nj->ni", np.abs(self._linear[instances]), half_extents)
        return np.asarray(np.linalg.norm(away + extents, axis=1))

    def _transform(self, instances: Indices, points: Floats) -> Floats:
        """Return points (k, 3) in world space, each given in the object space of its instance in `instances` (k,)."""
        return np.asarray(np.einsum("nij,nj->ni", self._linear[instances], points) + self._offset[instances])


def bounding_sphere(meshes: Sequence[Mesh], instances: Sequence[Instance]) -> tuple[tuple[float, float, float], float]:
    """Return centre and radius, in metres, of the smallest sphere around all instanced points.

    The centre is rounded (`smallest_ball`). The radius is measured from the rounded centre to the farthest point.
    """
    cloud = _InstancedPoints(meshes, instances)
    center = smallest_ball(cloud.farthest, cloud.centers.mean(axis=0))
    x, y, z = center.tolist()
    return (x, y, z), cloud.farthest(center)[1]


def smallest_ball(farthest: Callable[[Floats], tuple[Floats, float]], start: Floats) -> Floats:
    """Return the centre (d,) of the smallest ball around points, in d = 3 dimensions, or circle, in d = 2.

    `farthest(center)` returns the point farthest from a centre, and its distance. The support is the few points on the
    ball's surface that determine the ball. The first support is the point farthest from `start`. Each round adds the
    point farthest from the current centre, until no point lies outside (Gärtner, "Fast and Robust Smallest Enclosing
    Balls", 1999). The centre is rounded to a millionth of the radius, so that it does not depend on the machine's
    linear algebra.
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
    """Return the asset with its bounding sphere centred at the world origin, and each mesh centred in object space.

    Small coordinates keep precision: at a distance of 100 km, float32 divides a metre into only 128 steps. The asset
    keeps its digest.
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
    """Return the number (n,) of the cell that contains each point (n, 3), in a grid of `_CELLS`**3 cells over a box.

    The box (2, 3) has the least and the greatest coordinates of the points.
    """
    extent = np.ptp(box, axis=0)
    # The factor 0.999 keeps points on the far sides of the box in the last cells.
    cells = np.floor((points - box[0]) * (0.999 * _CELLS / np.where(extent > 0.0, extent, 1.0)))
    return np.asarray(cells @ np.array([_CELLS**2, _CELLS, 1.0]), np.intp)


def _update_ball(support: Floats, outside: Floats) -> tuple[Floats, Floats, float]:
    """Return the support, the centre and the radius of the smallest ball around `support` (k, d) and `outside` (d,).

    `outside` is a point outside the ball of the old support, and so lies on the surface of the new ball. The new
    support is that point and up to three points of the old support.
    """
    points = np.vstack([support, outside])
    best: tuple[Floats, Floats, float] | None = None
    for count in range(1, min(len(support), 3) + 1):
        for subset in itertools.combinations(support, count):
            # The centre has equal distances to the subset and to `outside`: 2 legs · (center - outside) = |legs|².
            legs = np.stack(subset) - outside
            center = outside + np.linalg.lstsq(2.0 * legs, (legs * legs).sum(axis=1), rcond=None)[0]
            radius = float(np.max(np.linalg.norm(points - center, axis=1)))
            if best is None or radius < best[2]:
                best = np.vstack([legs + outside, outside]), center, radius
    assert best is not None, "a support is never empty"
    return best
