"""The points that decide an asset's silhouette from everywhere, and the axis about which it is turned."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.bounds import Index, grid_cells, smallest_ball
from lookdev.asset.mesh import Asset, Mesh
from lookdev.asset.normals import Doubles, together

_OFTEN = 8  # instances: the corners of a mesh's hull are found faster than the points of so many are placed
_SMALL = 32  # points of a mesh that are placed faster than its corners are found
_PART = 2**11  # points of a mesh that are looked at together
_COARSE, _FINE = 64, 1024  # planes of a polytope
_MANY = 2**18  # points that are left by a coarse polytope: a fine one leaves fewer
_SEEDS = 2**15  # points that decide a fine one
_BLOCK = 2**20  # numbers at a time
_TOLERANCE = 1e-12  # of the size of the whole


def outline(asset: Asset) -> Doubles:
    """Return points (n, 3) of an asset in world space whose convex hull is that of all its faces.

    They decide the silhouette in every perspective from outside. Of an asset of several instances, what is in or on a
    polytope of outermost points is left out: instances, then parts of them, by their boxes, and at last points.
    """
    meshes = np.array([instance.mesh for instance in asset.instances])
    uses = np.bincount(meshes, minlength=len(asset.meshes)).tolist()
    clouds = {number: _cloud(asset.meshes[number], count) for number, count in enumerate(uses) if count}
    shown = _Placed(clouds, meshes, np.array([instance.matrix for instance in asset.instances]))
    if len(meshes) == 1:
        return shown.points()
    ends = {each: np.concatenate([c[c.argmin(axis=0)], c[c.argmax(axis=0)]]) for each, c in clouds.items()}
    seeds = replace(shown, clouds=ends).points()
    inner = _Polytope(_extremes(seeds, _directions(_COARSE))).grown(seeds, _COARSE)
    if not inner.is_solid:
        return _corners(shown.points())
    shown = shown.outside(inner)
    if shown.size > _MANY:
        along = _directions(min(max(_SEEDS // len(shown.of), 8), _COARSE))
        ends = {each: _extremes(clouds[each], along) for each in np.unique(shown.of).tolist()}
        inner = inner.grown(replace(shown, clouds=ends).points(), _FINE)
        shown = shown.outside(inner)
    return np.concatenate([inner.corners, *shown.divided().points_outside(inner)])


def turning_axis(points: Doubles) -> tuple[float, float]:
    """Return x and y of the vertical axis through the centre of the smallest circle around points (n, 3) from above."""
    footprint = points[:, :2]
    x, y = np.ascontiguousarray(footprint.T)

    def farthest(center: Doubles) -> tuple[Doubles, float]:
        squares = (x - center[0]) ** 2 + (y - center[1]) ** 2
        index = int(squares.argmax())
        return footprint[index], math.sqrt(squares[index])

    east, north = smallest_ball(farthest, footprint.mean(axis=0)).tolist()
    return east, north


class _Polytope:
    """The convex hull of points; that of a flat set has no planes."""

    def __init__(self, points: Doubles) -> None:
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
        """Whether anything is inside."""
        return len(self.planes) > 0

    def grown(self, points: Doubles, count: int) -> _Polytope:
        """Return it with the points that are farthest beyond its planes, until it has so many planes or all points."""
        inner = self
        while 0 < len(inner.planes) < count:
            found = _extremes(points, inner.planes[:, :3])
            outside = ((found - inner._middle) @ inner.planes[:, :3].T + inner.planes[:, 3] > 0.0).any(axis=1)
            if not outside.any():
                break
            inner = _Polytope(np.concatenate([inner.corners, found[outside]]))
        return inner

    def local(self, matrices: Doubles) -> Doubles:
        """Return its planes (n, k, 4) in the spaces of matrices (n, 4, 4).

        A point (x, y, z, 1) is beyond a plane where their product is positive.
        """
        about = matrices.copy()
        about[:, :3, 3] -= self._middle
        return np.asarray(self.planes @ about)


@dataclass(frozen=True, eq=False)
class _Placed:
    """Clouds of points (k, 3) by their numbers, and the number (n,) and the place (n, 4, 4) of each that is shown."""

    clouds: Mapping[int, Doubles]
    of: Index
    matrices: Doubles

    @property
    def size(self) -> int:
        """The number of points."""
        return sum(len(self.clouds[each]) for each in self.of.tolist())

    def points(self) -> Doubles:
        """Return all points in the world."""
        placed = zip(self.of.tolist(), self.matrices, strict=True)
        return together([self.clouds[each] @ matrix[:3, :3].T + matrix[:3, 3] for each, matrix in placed])

    def outside(self, inner: _Polytope) -> _Placed:
        """Return those whose box is not inside a polytope."""
        kept = np.zeros(len(self.of), np.bool_)
        boxes = {each: np.array([cloud.min(axis=0), cloud.max(axis=0)]) for each, cloud in self.clouds.items()}
        for chosen in _blocks(np.arange(len(self.of)), 4 * len(inner.planes)):
            planes = inner.local(self.matrices[chosen])
            box = np.array([boxes[each] for each in self.of[chosen].tolist()])
            kept[chosen] = _beyond(planes, box).any(axis=1)
        return replace(self, of=self.of[kept], matrices=self.matrices[kept])

    def divided(self) -> _Placed:
        """Return the same points as parts of `_PART` points that are near each other."""
        parts: list[Doubles] = []
        own: dict[int, Index] = {}
        for each in np.unique(self.of).tolist():
            made = _parts(self.clouds[each])
            own[each] = np.arange(len(parts), len(parts) + len(made))
            parts += made
        of = [own[each] for each in self.of.tolist()]
        matrices = np.repeat(self.matrices, [len(each) for each in of], axis=0)
        return _Placed(dict(enumerate(parts)), np.concatenate([np.zeros(0, np.intp), *of]), matrices)

    def points_outside(self, inner: _Polytope) -> Iterator[Doubles]:
        """Yield the points in the world that are not inside a polytope."""
        order = np.argsort(self.of, kind="stable")
        for alike in np.split(order, np.flatnonzero(np.diff(self.of[order])) + 1) if len(order) else []:
            cloud = self.clouds[int(self.of[alike[0]])]
            box = np.array([cloud.min(axis=0), cloud.max(axis=0)])
            for chosen in _blocks(alike, 4 * len(inner.planes)):
                planes = inner.local(self.matrices[chosen])
                owners, numbers = np.nonzero(_beyond(planes, box[None]))
                planes = planes[owners, numbers]
                block = np.searchsorted(owners, owners) // max(_BLOCK // len(cloud), 1)
                for pairs in np.split(np.arange(len(owners)), np.flatnonzero(np.diff(block)) + 1):
                    yield _outside(cloud, self.matrices[chosen], planes[pairs], owners[pairs])


def _outside(cloud: Doubles, matrices: Doubles, planes: Doubles, owners: Index) -> Doubles:
    """Return the points in the world of a cloud, placed by matrices (n, 4, 4), that are beyond a plane of theirs.

    The planes (k, 4) are in the spaces of their `owners`, numbers of matrices in order.
    """
    outside = planes[:, :3] @ cloud.T + planes[:, 3:] > 0.0
    first = np.flatnonzero(np.diff(owners, prepend=-1))
    which, points = np.nonzero(np.logical_or.reduceat(outside, first, axis=0))
    placed = matrices[owners[first]][which]
    return np.asarray(np.einsum("nij,nj->ni", placed[:, :3, :3], cloud[points]) + placed[:, :3, 3])


def _beyond(planes: Doubles, boxes: Doubles) -> NDArray[np.bool_]:
    """Return which of the planes (n, k, 4) have a part of a box (n, 2, 3) beyond them."""
    middles, halves = 0.5 * boxes.sum(axis=1)[..., None], 0.5 * np.ptp(boxes, axis=1)[..., None]
    normals = planes[..., :3]
    return np.asarray((normals @ middles + np.abs(normals) @ halves)[..., 0] + planes[..., 3] > 0.0)


def _blocks(numbers: Index, each: int) -> list[Index]:
    """Return numbers in blocks of `_BLOCK`, where each of them takes so much."""
    size = max(_BLOCK // each, 1)
    return [numbers[start : start + size] for start in range(0, len(numbers), size)]


def _directions(count: int) -> Doubles:
    """Return directions (count, 3), nearly even over the sphere, by the golden angle."""
    heights = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angles, levels = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(count), np.sqrt(1.0 - heights**2)
    return np.stack([levels * np.cos(angles), levels * np.sin(angles), heights], axis=-1)


def _extremes(points: Doubles, directions: Doubles) -> Doubles:
    """Return the points (k, 3) that are extreme along some directions."""
    return np.asarray(points[np.unique([(points @ direction).argmax() for direction in directions])])


def _cloud(mesh: Mesh, uses: int) -> Doubles:
    """Return the points of a mesh's faces, or, of a mesh that is used often, those at the corners of their hull."""
    shown = np.zeros(len(mesh.points), np.bool_)
    shown[mesh.corner_points] = True
    points = mesh.points[shown].astype(np.float64)
    return _corners(points) if uses >= _OFTEN and len(points) > _SMALL else points


def _corners(points: Doubles) -> Doubles:
    """Return the points at the corners of their hull: of flat ones in their plane, of those on a line its two ends."""
    from scipy.spatial import ConvexHull, QhullError

    local = points - points.mean(axis=0)
    axes = np.linalg.svd(local, full_matrices=False)[2]
    for turned in (local, local @ axes[:2].T):
        with suppress(QhullError):
            return np.asarray(points[ConvexHull(turned).vertices])
    along = local @ axes[0]
    return np.asarray(points[[along.argmin(), along.argmax()]])


def _parts(points: Doubles) -> list[Doubles]:
    if len(points) <= _PART:
        return [points]
    near = points[np.argsort(grid_cells(points, np.array([points.min(axis=0), points.max(axis=0)])), kind="stable")]
    return [near[start : start + _PART] for start in range(0, len(near), _PART)]
