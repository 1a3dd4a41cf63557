"""The smallest sphere around an asset, which the camera frames, and the asset with this sphere at the origin."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lookdev.arrays import Floats, Floats32
from lookdev.asset.mesh import Asset, Instance, Mesh
from lookdev.asset.silhouette import hull_points

_MAX_ROUNDS = 100
_TOLERANCE = 1e-7


def bounding_sphere(meshes: Sequence[Mesh], instances: Sequence[Instance]) -> tuple[tuple[float, float, float], float]:
    """Return centre and radius, in metres, of the smallest sphere around the faces of all instances.

    `smallest_ball` rounds the centre; the radius reaches all points from the rounded centre.
    """
    (x, y, z), radius = smallest_ball(hull_points(meshes, instances))
    return (x, y, z), radius


def turning_axis(points: Floats) -> tuple[float, float]:
    """Return x and y of the turntable's axis: the centre of the smallest circle around the points (n, 3) from above."""
    (x, y), _ = smallest_ball(points[:, :2])
    return x, y


def smallest_ball(points: Floats) -> tuple[list[float], float]:
    """Return centre (d,) and radius of the smallest ball, or circle, around points (n, d).

    The farthest point is added to the support until none lies outside (Gärtner, "Fast and Robust Smallest Enclosing
    Balls", 1999). The centre is rounded to a millionth of the radius: so it does not depend on the linear algebra
    of the machine.
    """
    coordinates = np.ascontiguousarray(points.T)

    def farthest(center: Floats) -> tuple[Floats, float]:
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
    """Return the asset with its bounding sphere centred at the world origin, and each mesh at its own origin.

    This keeps precision: in float32, a metre at a distance of 100 km has 128 steps. The digest does not change.
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
