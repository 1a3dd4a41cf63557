"""Computes the smallest sphere around an asset, and the vertical axis of a turntable.

A camera that frames the sphere shows the asset in one size over a turntable. `bounding_sphere` finds the sphere, and
`center_asset` moves the asset so that the sphere's centre is the world origin. `turning_axis` finds the axis.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lookdev.arrays import Floats, Floats32
from lookdev.asset.mesh import Asset, Instance, Mesh
from lookdev.asset.silhouette import hull_points, world_points

_MANY_POINTS = 2**20  # of all instances: with more, only points that can be extreme are searched
_MAX_ROUNDS = 100  # the most rounds of the search for the smallest ball
_TOLERANCE = 1e-7  # relative to the ball's radius: a point that is outside by less counts as inside


def bounding_sphere(meshes: Sequence[Mesh], instances: Sequence[Instance]) -> tuple[tuple[float, float, float], float]:
    """Return centre and radius, in metres, of the smallest sphere around the faces of all instances.

    The centre is rounded (`smallest_ball`). The radius is the distance from the rounded centre to the farthest point.
    """
    count = sum(len(meshes[instance.mesh].points) for instance in instances)
    # The hull takes SciPy, whose import takes longer than the search among a million points.
    points = hull_points(meshes, instances) if count > _MANY_POINTS else world_points(meshes, instances)
    (x, y, z), radius = smallest_ball(points)
    return (x, y, z), radius


def turning_axis(points: Floats) -> tuple[float, float]:
    """Return x and y of the turntable's vertical axis, the centre of the smallest circle around the points (n, 3).

    The circle is horizontal, and the points are projected along z.
    """
    (x, y), _ = smallest_ball(points[:, :2])
    return x, y


def smallest_ball(points: Floats) -> tuple[list[float], float]:
    """Return centre (d,) and radius of the smallest ball, or circle, around points (n, d).

    The support is the few points on the ball's surface that determine the ball. The first support is the point farthest
    from the mean of all points. Each round adds the point farthest from the current centre, until no point lies outside
    (Gärtner, "Fast and Robust Smallest Enclosing Balls", 1999). The centre is rounded to a millionth of the radius, so
    that the result does not depend on the machine's linear algebra.
    """
    coordinates = np.ascontiguousarray(points.T)

    def farthest(center: Floats) -> tuple[Floats, float]:
        """Return the point (d,) farthest from a centre (d,), and its distance."""
        squares = np.square(coordinates - center[:, None]).sum(axis=0)
        index = int(squares.argmax())
        return points[index], math.sqrt(squares[index])

    support, _ = farthest(points.mean(axis=0))
    support, center, radius = support[None], support, 0.0
    for _ in range(_MAX_ROUNDS):
        far, distance = farthest(center)
        if distance <= radius * (1.0 + _TOLERANCE):
            break
        support, center, radius = _update_ball(support, far)
    if radius > 0.0:
        center = np.round(center, 6 - int(np.floor(np.log10(radius)))) + 0.0
    return center.tolist(), farthest(center)[1]


def center_asset(asset: Asset) -> Asset:
    """Return the asset with its bounding sphere centred at the world origin, and each mesh centred in object space.

    Small coordinates keep precision: at a distance of 100 km, float32 divides a metre into only 128 steps. The asset
    keeps its digest.
    """
    boxes = [(mesh.points.min(axis=0), mesh.points.max(axis=0)) for mesh in asset.meshes]
    centers = np.array(boxes, np.float64).mean(axis=1)
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
