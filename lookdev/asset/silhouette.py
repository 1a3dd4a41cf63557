"""The points that decide an asset's silhouette from everywhere, and the axis about which it is turned."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from lookdev.asset.bounds import smallest_ball
from lookdev.asset.mesh import Asset, Mesh
from lookdev.asset.normals import Doubles

_OFTEN = 8  # instances: the corners of a mesh's hull are found faster than the points of so many are placed
_SMALL = 32  # points of a mesh that are placed faster than its corners are found
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
    reach = np.linalg.norm(linear, ord=2, axis=(1, 2)) * radii[shown]
    outer = np.flatnonzero(_Polytope(seeds.reshape(-1, 3), 64).outside(centers, reach))

    inner = _Polytope(seeds.reshape(-1, 3), 24)
    batch = np.cumsum([len(clouds[each]) for each in shown[outer]]) // _BLOCK
    kept = []
    for numbers in np.split(outer, np.flatnonzero(np.diff(batch)) + 1):
        points = np.concatenate([clouds[shown[each]] @ linear[each].T + offset[each] for each in numbers])
        kept.append(points[inner.outside(points)])
    return np.concatenate(kept)


def turning_axis(points: Doubles) -> tuple[float, float]:
    """Return x and y of the vertical axis through the centre of the smallest circle around points (n, 3) from above."""
    footprint = points[:, :2]

    def farthest(center: Doubles) -> tuple[Doubles, float]:
        squares = ((footprint - center) ** 2).sum(axis=1)
        index = int(squares.argmax())
        return footprint[index], math.sqrt(squares[index])

    x, y = smallest_ball(farthest, footprint.mean(axis=0)).tolist()
    return x, y


class _Polytope:
    """The convex hull of the extreme points of a set along some directions; nothing is inside that of a flat set."""

    def __init__(self, points: Doubles, directions: int) -> None:
        # Nearly even over the sphere, by the golden angle.
        heights = 1.0 - (2.0 * np.arange(directions) + 1.0) / directions
        angles, levels = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(directions), np.sqrt(1.0 - heights**2)
        along = points @ np.stack([levels * np.cos(angles), levels * np.sin(angles), heights])
        corners = points[np.unique(along.argmax(axis=0))]
        self._middle = corners.mean(axis=0)
        self._normals, self._offsets = np.zeros((0, 3)), np.zeros(0)
        with suppress(QhullError):
            planes = ConvexHull(corners - self._middle).equations
            self._normals, self._offsets = planes[:, :3], planes[:, 3]

    def outside(self, points: Doubles, radii: Doubles | float = 0.0) -> NDArray[np.bool_]:
        """Return which balls about points (n, 3) are not inside, (n,); on the surface is not inside."""
        if not len(self._normals):
            return np.ones(len(points), np.bool_)
        beyond = ((points - self._middle) @ self._normals.T + self._offsets).max(axis=1)
        return np.asarray(beyond + radii > _TOLERANCE * self._offsets.min())


def _cloud(mesh: Mesh, uses: int) -> Doubles:
    """Return the points of a mesh's faces, or, of a mesh that is used often, those at the corners of their hull."""
    shown = np.zeros(len(mesh.points), np.bool_)
    shown[mesh.corner_points] = True
    points = mesh.points[shown].astype(np.float64)
    if uses >= _OFTEN and len(points) > _SMALL:
        with suppress(QhullError):  # flat
            return np.asarray(points[ConvexHull(points - points.mean(axis=0)).vertices])
    return points
