"""Finds the points that determine an asset's silhouette from all directions.

`lookdev.scene.framing.frame_fill` places the camera by these points, and `lookdev.asset.bounds` computes the bounding
sphere from them. A point cloud here is the points of a mesh or of a part of a mesh.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from lookdev.arrays import Bools, Floats, Indices
from lookdev.asset.mesh import Instance, Mesh
from lookdev.asset.normals import concatenate

# A mesh with at least `_HULL_INSTANCES` instances and more than `_FEW_POINTS` points is first reduced to the corners of
# its convex hull, which is faster than to transform all its points.
_HULL_INSTANCES = 8
_FEW_POINTS = 32
_PART_POINTS = 2**11  # points of a part of a mesh, at most
_CELLS = 8  # along each side of a mesh's bounding box: cells of the grid that splits the mesh into parts
_COARSE, _FINE = 64, 1024  # planes of the coarse and of the fine polytope
_MANY_POINTS = 2**18  # with more points outside the coarse polytope, a fine polytope is built
_SEEDS = 2**15  # points from which the fine polytope is built, approximately
_BLOCK = 2**20  # numbers in an intermediate array, approximately
_TOLERANCE = 1e-12  # relative to the extent of all points: a point beyond a plane by less counts as inside


def hull_points(meshes: Sequence[Mesh], instances: Sequence[Instance]) -> Floats:
    """Return points (n, 3) in world space that have the same convex hull as the faces of all instances.

    These points determine the silhouette in every perspective view from outside. They may include points inside the
    hull. For one instance, all its points are returned. For several instances, the hull of some extreme points is
    computed first: a polytope. Everything inside the polytope is dropped: instances and parts of instances if their
    bounding boxes are inside, then single points. The corners of the polytope and the remaining points are returned.
    """
    if len(instances) == 1:
        return world_points(meshes, instances)
    uses = np.bincount([instance.mesh for instance in instances]).tolist()
    clouds = {number: _mesh_points(meshes[number], count) for number, count in enumerate(uses) if count}
    placed = _PlacedClouds.of_instances(clouds, instances)
    # The points of each mesh that are extreme along a coordinate axis.
    extremes = {
        number: np.concatenate([cloud[cloud.argmin(axis=0)], cloud[cloud.argmax(axis=0)]])
        for number, cloud in clouds.items()
    }
    seeds = replace(placed, clouds=extremes).points()
    polytope = _Polytope(_extreme_points(seeds, _directions(_COARSE))).grow(seeds, _COARSE)
    if not polytope.is_solid:
        return _hull_points(placed.points())
    placed = placed.select_outside(polytope)
    if placed.size > _MANY_POINTS:
        directions = _directions(min(max(_SEEDS // len(placed.cloud_numbers), 8), _COARSE))
        numbers = np.unique(placed.cloud_numbers).tolist()
        extremes = {number: _extreme_points(clouds[number], directions) for number in numbers}
        polytope = polytope.grow(replace(placed, clouds=extremes).points(), _FINE)
        placed = placed.select_outside(polytope)
    return np.concatenate([polytope.corners, *placed.split().points_outside(polytope)])


def world_points(meshes: Sequence[Mesh], instances: Sequence[Instance]) -> Floats:
    """Return the points (n, 3) of the faces of all instances in world space."""
    clouds = {number: _face_points(meshes[number]) for number in {instance.mesh for instance in instances}}
    return _PlacedClouds.of_instances(clouds, instances).points()


class _Polytope:
    """The convex hull of points: its `corners` (c, 3) and its outward `planes` (p, 4).

    A point is beyond a plane (a, b, c, d) if a x + b y + c z + d > 0, with coordinates relative to the mean of the
    points. If the points lie in one plane, the corners are all the points, and there are no planes.
    """

    def __init__(self, points: Floats) -> None:
        from scipy.spatial import ConvexHull, QhullError

        self.corners = points
        self._middle = points.mean(axis=0)
        self.planes = np.zeros((0, 4))
        with suppress(QhullError):
            hull = ConvexHull(points - self._middle)
            self.corners, self.planes = points[hull.vertices], np.unique(hull.equations, axis=0)
            self.planes[:, 3] -= _TOLERANCE * np.ptp(points, axis=0).max()

    @property
    def is_solid(self) -> bool:
        """Whether the polytope has a volume."""
        return len(self.planes) > 0

    def grow(self, points: Floats, count: int) -> _Polytope:
        """Return the hull, extended by the given points that are farthest beyond its planes.

        The extension is repeated until the hull has at least `count` planes or contains all the points (n, 3).
        """
        polytope = self
        while 0 < len(polytope.planes) < count:
            extremes = _extreme_points(points, polytope.planes[:, :3])
            distances = (extremes - polytope._middle) @ polytope.planes[:, :3].T + polytope.planes[:, 3]
            is_outside = (distances > 0.0).any(axis=1)
            if not is_outside.any():
                break
            polytope = _Polytope(np.concatenate([polytope.corners, extremes[is_outside]]))
        return polytope

    def local_planes(self, matrices: Floats) -> Floats:
        """Return the polytope's p planes in the object spaces of n instances, (n, p, 4), from their matrices (n, 4, 4).

        A point (x, y, z, 1) of object space is beyond a plane if the dot product of point and plane is positive.
        """
        centered = matrices.copy()
        centered[:, :3, 3] -= self._middle
        return np.asarray(self.planes @ centered)


@dataclass(frozen=True, eq=False)
class _PlacedClouds:
    """Instances of point clouds.

    `clouds` maps the number of a cloud to its points (k, 3) in object space. Instance i, of n, is the cloud
    `cloud_numbers[i]`, placed by `matrices[i]`, a matrix (4, 4) to world space.
    """

    clouds: Mapping[int, Floats]
    cloud_numbers: Indices
    matrices: Floats

    @classmethod
    def of_instances(cls, clouds: Mapping[int, Floats], instances: Sequence[Instance]) -> _PlacedClouds:
        """Return instances of meshes, whose points are `clouds`, by the number of the mesh."""
        cloud_numbers = np.array([instance.mesh for instance in instances])
        return cls(clouds, cloud_numbers, np.array([instance.matrix for instance in instances]))

    @property
    def size(self) -> int:
        """The number of points of all instances."""
        return sum(len(self.clouds[number]) for number in self.cloud_numbers.tolist())

    def points(self) -> Floats:
        """Return all points in world space."""
        placements = zip(self.cloud_numbers.tolist(), self.matrices, strict=True)
        return concatenate([self.clouds[number] @ matrix[:3, :3].T + matrix[:3, 3] for number, matrix in placements])

    def select_outside(self, polytope: _Polytope) -> _PlacedClouds:
        """Return the instances whose bounding boxes are not completely inside a polytope."""
        is_outside = np.zeros(len(self.cloud_numbers), np.bool_)
        boxes = {number: np.array([cloud.min(axis=0), cloud.max(axis=0)]) for number, cloud in self.clouds.items()}
        for block in _blocks(np.arange(len(self.cloud_numbers)), 4 * len(polytope.planes)):
            planes = polytope.local_planes(self.matrices[block])
            box = np.array([boxes[number] for number in self.cloud_numbers[block].tolist()])
            is_outside[block] = _is_box_beyond(planes, box).any(axis=1)
        return replace(self, cloud_numbers=self.cloud_numbers[is_outside], matrices=self.matrices[is_outside])

    def split(self) -> _PlacedClouds:
        """Return the same points as instances of smaller clouds, of at most `_PART_POINTS` points near each other."""
        parts: list[Floats] = []
        parts_of_cloud: dict[int, Indices] = {}
        for number in np.unique(self.cloud_numbers).tolist():
            cloud_parts = _split_cloud(self.clouds[number])
            parts_of_cloud[number] = np.arange(len(parts), len(parts) + len(cloud_parts))
            parts += cloud_parts
        part_numbers = [parts_of_cloud[number] for number in self.cloud_numbers.tolist()]
        matrices = np.repeat(self.matrices, [len(numbers) for numbers in part_numbers], axis=0)
        return _PlacedClouds(dict(enumerate(parts)), np.concatenate([np.zeros(0, np.intp), *part_numbers]), matrices)

    def points_outside(self, polytope: _Polytope) -> Iterator[Floats]:
        """Yield the points, in world space, that are not inside a polytope."""
        # `members` are the numbers of all instances of one cloud.
        order = np.argsort(self.cloud_numbers, kind="stable")
        for members in np.split(order, np.flatnonzero(np.diff(self.cloud_numbers[order])) + 1) if len(order) else []:
            cloud = self.clouds[int(self.cloud_numbers[members[0]])]
            box = np.array([cloud.min(axis=0), cloud.max(axis=0)])
            for block in _blocks(members, 4 * len(polytope.planes)):
                planes = polytope.local_planes(self.matrices[block])
                # Points can be beyond a plane only if a part of the cloud's bounding box is beyond it.
                owners, numbers = np.nonzero(_is_box_beyond(planes, box[None]))
                planes = planes[owners, numbers]
                # The planes are processed in batches of limited memory; all planes of an instance are in one batch.
                batch = np.searchsorted(owners, owners) // max(_BLOCK // len(cloud), 1)
                for pairs in np.split(np.arange(len(owners)), np.flatnonzero(np.diff(batch)) + 1):
                    yield _points_beyond(cloud, self.matrices[block], planes[pairs], owners[pairs])


def _points_beyond(cloud: Floats, matrices: Floats, planes: Floats, owners: Indices) -> Floats:
    """Return, in world space, the points of a cloud's instances that are beyond at least one plane.

    `cloud` (c, 3) has the points of the cloud, and `matrices` (n, 4, 4) place its instances. Each of the planes (k, 4)
    is in the object space of one instance; `owners` (k,) has the numbers of these instances, sorted.
    """
    is_beyond = planes[:, :3] @ cloud.T + planes[:, 3:] > 0.0
    first = np.flatnonzero(np.diff(owners, prepend=-1))
    instances, points = np.nonzero(np.logical_or.reduceat(is_beyond, first, axis=0))
    matrices_of_points = matrices[owners[first]][instances]
    return np.asarray(
        np.einsum("nij,nj->ni", matrices_of_points[:, :3, :3], cloud[points]) + matrices_of_points[:, :3, 3]
    )


def _is_box_beyond(planes: Floats, boxes: Floats) -> Bools:
    """Return, for each plane (n, k), whether a part of the plane's box is beyond the plane.

    `planes` (n, k, 4) has k planes for each of n boxes. `boxes` (n, 2, 3) has the least and the greatest corner of each
    box; with (1, 2, 3), all planes have the same box.
    """
    middles, halves = 0.5 * boxes.sum(axis=1)[..., None], 0.5 * np.ptp(boxes, axis=1)[..., None]
    normals = planes[..., :3]
    return np.asarray((normals @ middles + np.abs(normals) @ halves)[..., 0] + planes[..., 3] > 0.0)


def _blocks(indices: Indices, numbers_per_index: int) -> list[Indices]:
    """Split indices into blocks of about `_BLOCK` numbers, if each index needs `numbers_per_index` numbers."""
    size = max(_BLOCK // numbers_per_index, 1)
    return [indices[start : start + size] for start in range(0, len(indices), size)]


def _directions(count: int) -> Floats:
    """Return unit vectors (count, 3), nearly uniform over the sphere: a spiral that turns by the golden angle."""
    heights = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angles, radii = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(count), np.sqrt(1.0 - heights**2)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles), heights], axis=-1)


def _extreme_points(points: Floats, directions: Floats) -> Floats:
    """Return the points that are farthest along at least one of the directions (d, 3), each point once."""
    return np.asarray(points[np.unique([(points @ direction).argmax() for direction in directions])])


def _face_points(mesh: Mesh) -> Floats:
    """Return the points (k, 3) of a mesh's faces in float64."""
    is_used = np.zeros(len(mesh.points), np.bool_)
    is_used[mesh.corner_points] = True
    return mesh.points[is_used].astype(np.float64)


def _mesh_points(mesh: Mesh, uses: int) -> Floats:
    """Return the points of a mesh's faces, or only the corners of their convex hull for many instances.

    `uses` is the number of instances of the mesh.
    """
    points = _face_points(mesh)
    return _hull_points(points) if uses >= _HULL_INSTANCES and len(points) > _FEW_POINTS else points


def _hull_points(points: Floats) -> Floats:
    """Return the corners of the points' convex hull, which is a solid, a plane polygon or a line segment."""
    from scipy.spatial import ConvexHull, QhullError

    local = points - points.mean(axis=0)
    axes = np.linalg.svd(local, full_matrices=False)[2]
    # Qhull rejects points that span no volume. Then the hull is computed in the plane in which the points extend most,
    # and if that fails, too, along a line.
    for coordinates in (local, local @ axes[:2].T):
        with suppress(QhullError):
            return np.asarray(points[ConvexHull(coordinates).vertices])
    along = local @ axes[0]
    return np.asarray(points[[along.argmin(), along.argmax()]])


def _split_cloud(points: Floats) -> list[Floats]:
    """Split points into parts of at most `_PART_POINTS`, sorted by the cells of a grid if there are several parts."""
    if len(points) <= _PART_POINTS:
        return [points]
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    # The factor 0.999 keeps points on the far sides of the box in the last cells.
    cells = np.floor((points - low) * (0.999 * _CELLS / np.where(extent > 0.0, extent, 1.0)))
    sorted_points = points[np.argsort(cells @ [_CELLS**2, _CELLS, 1.0], kind="stable")]
    return [sorted_points[start : start + _PART_POINTS] for start in range(0, len(sorted_points), _PART_POINTS)]
