"""The smallest sphere around an asset: what the camera frames, so that a turntable never pumps."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lookdev.asset.mesh import Asset, Floats, Instance, Mesh
from lookdev.asset.normals import Doubles

_ROUNDS = 100
_TOLERANCE = 1e-7


class _Cloud:
    """All points of all instances, searched for the farthest one without visiting every instance."""

    def __init__(self, meshes: Sequence[Mesh], instances: Sequence[Instance]) -> None:
        self._points: list[Floats] = [meshes[instance.mesh].points for instance in instances]
        boxes = [(mesh.points.min(axis=0), mesh.points.max(axis=0)) for mesh in meshes]
        middles = [0.5 * (np.float64(low) + np.float64(high)) for low, high in boxes]
        radii = [0.5 * float(np.linalg.norm(np.float64(high) - np.float64(low))) for low, high in boxes]
        self._linear = np.stack([instance.matrix[:3, :3] for instance in instances])
        self._offset = np.stack([instance.matrix[:3, 3] for instance in instances])
        local = np.stack([middles[instance.mesh] for instance in instances])
        self.centers = np.einsum("kij,kj->ki", self._linear, local) + self._offset
        stretch = np.linalg.norm(self._linear, ord=2, axis=(1, 2))
        self._reach = stretch * np.array([radii[instance.mesh] for instance in instances])

    def farthest(self, center: Doubles) -> tuple[Doubles, float]:
        """Return the point farthest from `center` and its distance."""
        limits = np.linalg.norm(self.centers - center, axis=1) + self._reach
        best, distance = center, -1.0
        for i in np.argsort(-limits):
            if limits[i] <= distance:
                break
            world = self._points[i] @ self._linear[i].T + self._offset[i]
            squares = ((world - center) ** 2).sum(axis=1)
            j = int(squares.argmax())
            if squares[j] > distance * abs(distance):
                best, distance = world[j], float(np.sqrt(squares[j]))
        return best, distance


def bounding_sphere(meshes: Sequence[Mesh], instances: Sequence[Instance]) -> tuple[tuple[float, float, float], float]:
    """Return centre and radius, in metres, of the smallest sphere around all instanced points.

    Starts with one point and adds the farthest point to the support again and again (Gärtner, "Fast and
    Robust Smallest Enclosing Balls", 1999). The centre is rounded to a millionth of the radius, so that it
    does not depend on the machine's linear algebra; the radius is exact for it: every point is inside.
    """
    cloud = _Cloud(meshes, instances)
    support, _ = cloud.farthest(cloud.centers.mean(axis=0))
    support, center, radius = support[None], support, 0.0
    for _ in range(_ROUNDS):
        far, distance = cloud.farthest(center)
        if distance <= radius * (1.0 + _TOLERANCE):
            break
        support, center, radius = _smallest_ball(support, far)
    if radius > 0.0:
        center = np.round(center, 6 - int(np.floor(np.log10(radius)))) + 0.0
    x, y, z = center.tolist()
    return (x, y, z), cloud.farthest(center)[1]


def about_origin(asset: Asset) -> Asset:
    """Return the asset moved so that its bounding sphere lies about the origin, and each mesh about its own.

    In float32, a metre that lies 100 km away is 128 steps long; a renderer that computes in it wants to be near.
    The digest stays that of the asset as it was.
    """
    middles = [
        0.5 * (np.float64(mesh.points.min(axis=0)) + np.float64(mesh.points.max(axis=0))) for mesh in asset.meshes
    ]
    meshes = [
        replace(mesh, points=(mesh.points - middle).astype(np.float32))
        for mesh, middle in zip(asset.meshes, middles, strict=True)
    ]
    instances = []
    for instance in asset.instances:
        matrix = instance.matrix.copy()
        matrix[:3, 3] += matrix[:3, :3] @ middles[instance.mesh] - asset.center
        instances.append(Instance(instance.mesh, matrix))
    return replace(asset, meshes=tuple(meshes), instances=tuple(instances), center=(0.0, 0.0, 0.0))


def _smallest_ball(support: Doubles, outside: Doubles) -> tuple[Doubles, Doubles, float]:
    """Return support (at most 4 points), centre and radius of the smallest ball of `support` and `outside`.

    The point outside the old ball lies on the new one: its support is that point and up to three old ones.
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
