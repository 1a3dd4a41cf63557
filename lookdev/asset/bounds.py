"""The smallest sphere around an asset, which the camera frames, so that its size is constant over a turntable."""

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
    """All points of all instances; the search for the farthest one skips instances by their bounds."""

    def __init__(self, meshes: Sequence[Mesh], instances: Sequence[Instance]) -> None:
        self._points: list[Floats] = [meshes[instance.mesh].points for instance in instances]
        boxes = [_box(mesh) for mesh in meshes]
        radii = [0.5 * float(np.linalg.norm(np.ptp(box, axis=0))) for box in boxes]
        self._linear = np.stack([instance.matrix[:3, :3] for instance in instances])
        self._offset = np.stack([instance.matrix[:3, 3] for instance in instances])
        local = np.stack([boxes[instance.mesh].mean(axis=0) for instance in instances])
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

    Starts with one point and repeatedly adds the farthest point to the support (Gärtner, "Fast and Robust Smallest
    Enclosing Balls", 1999). The centre is rounded to a millionth of the radius, so that it does not depend on the
    machine's linear algebra; the radius is that of all points about the rounded centre.
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
    """Return the asset moved so that its bounding sphere is about the origin, and each mesh about its own.

    In float32, a metre at a distance of 100 km has 128 steps. The digest remains that of the asset before.
    """
    middles = [_box(mesh).mean(axis=0) for mesh in asset.meshes]
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


def _box(mesh: Mesh) -> Doubles:
    """Return the least and the greatest coordinates of a mesh's points, (2, 3)."""
    return np.asarray([mesh.points.min(axis=0), mesh.points.max(axis=0)], np.float64)


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
