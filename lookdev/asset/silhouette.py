"""The points that decide an asset's silhouette from everywhere, and the axis about which it is turned."""

from __future__ import annotations

import math
from contextlib import suppress
from copy import copy

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from lookdev.asset.bounds import bounding_boxes, bounding_spheres, grid_cells, smallest_ball
from lookdev.asset.mesh import Asset, Mesh
from lookdev.asset.normals import Doubles

_OFTEN = 8  # instances: the corners of a mesh's hull are found faster than the points of so many are placed
_SMALL = 32  # points of a mesh that are placed faster than its corners are found
_LARGE = 1024  # points of a mesh that is used often, whose instances are looked at one by one, cell by cell
_SEEDS = 2**13  # points, of all instances of large meshes, between which their polytope is; more have more planes
_BLOCK = 2**18  # points at a time
_TOLERANCE = 1e-9


def outline(asset: Asset) -> Doubles:
    """Return points (n, 3) of an asset in world space whose convex hull is that of all its faces.

    They decide the silhouette in every perspective from outside. Of an asset of many instances, what is inside a
    polytope of its outermost points is left out.
    """
    shown = np.array([instance.mesh for instance in asset.instances])
    linear = np.stack([instance.matrix[:3, :3] for instance in asset.instances])
    offset = np.stack([instance.matrix[:3, 3] for instance in asset.instances])
    uses = np.bincount(shown, minlength=len(asset.meshes))
    clouds = [_cloud(mesh, count) for mesh, count in zip(asset.meshes, uses, strict=True)]
    if len(shown) == 1:
        return np.asarray(clouds[shown[0]] @ linear[0].T + offset[0])

    extremes = np.stack([np.concatenate([c[c.argmin(axis=0)], c[c.argmax(axis=0)]]) for c in clouds])
    seeds = np.einsum("kij,kpj->kpi", linear, extremes[shown]) + offset[:, None]
    middles = 0.5 * (extremes.min(axis=1) + extremes.max(axis=1))
    radii = 0.5 * np.linalg.norm(np.ptp(extremes, axis=1), axis=1)
    centers = np.einsum("kij,kj->ki", linear, middles[shown]) + offset
    stretch = np.linalg.norm(linear, ord=2, axis=(1, 2))
    reach = stretch * radii[shown]
    outer = np.flatnonzero(_Polytope(seeds.reshape(-1, 3), 64).outside(centers, reach))

    inner = _Polytope(seeds.reshape(-1, 3), 24)
    large = ((uses >= _OFTEN) & (np.array([len(cloud) for cloud in clouds]) >= _LARGE))[shown[outer]]
    single, outer = outer[large], outer[~large]
    batch = np.cumsum([len(clouds[each]) for each in shown[outer]]) // _BLOCK
    kept = [np.zeros((0, 3))]
    for numbers in np.split(outer, np.flatnonzero(np.diff(batch)) + 1) if len(outer) else []:
        points = np.concatenate([clouds[shown[each]] @ linear[each].T + offset[each] for each in numbers])
        kept.append(points[inner.outside(points)])
    cells = {number: _Cells(clouds[number]) for number in np.unique(shown[single])}
    if len(single):
        # Corners of many directions of each instance: little is outside of their hull.
        most = max(_SEEDS // len(single), 6)
        ends = {number: _extremes(clouds[number], most) for number in cells}
        more = [ends[shown[k]] @ linear[k].T + offset[k] for k in single]
        seeds = np.concatenate([seeds.reshape(-1, 3), *more])
        inner = _Polytope(seeds[inner.outside(seeds)])
        kept += [cells[shown[k]].outside(inner, linear[k], offset[k], stretch[k]) for k in single]
    outermost = np.concatenate(kept)
    return outermost if inner.is_solid else _corners(outermost)


def turning_axis(points: Doubles) -> tuple[float, float]:
    """Return x and y of the vertical axis through the centre of the smallest circle around points (n, 3) from above."""
    footprint = points[:, :2]

    def farthest(center: Doubles) -> tuple[Doubles, float]:
        squares = ((footprint - center) ** 2).sum(axis=1)
        index = int(squares.argmax())
        return footprint[index], math.sqrt(squares[index])

    x, y = smallest_ball(farthest, footprint.mean(axis=0)).tolist()
    return x, y


class _Cells:
    """A cloud of points, sorted into cells that have bounding spheres."""

    def __init__(self, points: Doubles) -> None:
        box = np.array([points.min(axis=0), points.max(axis=0)])
        cells = grid_cells(points, box)
        order = np.argsort(cells, kind="stable")
        starts = np.flatnonzero(np.diff(cells[order], prepend=-1))
        self._points, self._lengths = points[order], np.diff(starts, append=len(points))
        self._middles, self._radii = bounding_spheres(bounding_boxes(self._points, starts))
        (self._middle,), (self._radius,) = bounding_spheres(box[None])

    def outside(self, polytope: _Polytope, linear: Doubles, offset: Doubles, stretch: float) -> Doubles:
        """Return the points, placed in the world, that are not inside a polytope."""
        near = polytope.near(linear @ self._middle + offset, stretch * self._radius)
        if polytope.is_solid and not near.is_solid:
            return np.zeros((0, 3))
        cells = near.outside(self._middles @ linear.T + offset, stretch * self._radii)
        points = self._points[np.repeat(cells, self._lengths)] @ linear.T + offset
        return np.asarray(points[near.outside(points)])


class _Polytope:
    """The convex hull of points, or of those that are extreme along some directions; that of a flat set is empty."""

    def __init__(self, points: Doubles, directions: int | None = None) -> None:
        corners = points if directions is None else _extremes(points, directions)
        self._middle = corners.mean(axis=0)
        self._normals, self._offsets = np.zeros((0, 3)), np.zeros(0)
        with suppress(QhullError):
            planes = ConvexHull(corners - self._middle).equations
            self._normals, self._offsets = planes[:, :3], planes[:, 3]
        self._rounding = _TOLERANCE * self._offsets.min(initial=0.0)

    @property
    def is_solid(self) -> bool:
        """Whether anything is inside."""
        return len(self._normals) > 0

    def near(self, center: Doubles, radius: float) -> _Polytope:
        """Return the polytope with those planes alone that have a part of the ball about a point (3,) beyond them."""
        part = copy(self)
        beyond = self._normals @ (center - self._middle) + self._offsets + radius > self._rounding
        part._normals, part._offsets = self._normals[beyond], self._offsets[beyond]
        return part

    def outside(self, points: Doubles, radii: Doubles | float = 0.0) -> NDArray[np.bool_]:
        """Return which balls about points (n, 3) are not inside, (n,); on the surface is not inside."""
        if not self.is_solid:
            return np.ones(len(points), np.bool_)
        beyond = ((points - self._middle) @ self._normals.T + self._offsets).max(axis=1)
        return np.asarray(beyond + radii > self._rounding)


def _extremes(points: Doubles, directions: int) -> Doubles:
    """Return the points (k, 3) that are extreme along some directions."""
    # Nearly even over the sphere, by the golden angle.
    heights = 1.0 - (2.0 * np.arange(directions) + 1.0) / directions
    angles, levels = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(directions), np.sqrt(1.0 - heights**2)
    along = points @ np.stack([levels * np.cos(angles), levels * np.sin(angles), heights])
    return np.asarray(points[np.unique(along.argmax(axis=0))])


def _cloud(mesh: Mesh, uses: int) -> Doubles:
    """Return the points of a mesh's faces, or, of a mesh that is used often, those at the corners of their hull."""
    shown = np.zeros(len(mesh.points), np.bool_)
    shown[mesh.corner_points] = True
    points = mesh.points[shown].astype(np.float64)
    return _corners(points) if uses >= _OFTEN and len(points) > _SMALL else points


def _corners(points: Doubles) -> Doubles:
    """Return the points at the corners of their hull: of flat ones in their plane, of those on a line its two ends."""
    local = points - points.mean(axis=0)
    axes = np.linalg.svd(local, full_matrices=False)[2]
    for turned in (local, local @ axes[:2].T):
        with suppress(QhullError):
            return np.asarray(points[ConvexHull(turned).vertices])
    along = local @ axes[0]
    return np.asarray(points[[along.argmin(), along.argmax()]])
