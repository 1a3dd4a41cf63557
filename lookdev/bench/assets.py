"""An asset of any number of triangles."""

from __future__ import annotations

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset import Asset, Instance, Mesh, Slot
from lookdev.asset.builtin import make_sphere
from lookdev.asset.normals import area_vectors, smooth_normals
from lookdev.asset.store import make_asset

# Directions and phases of the waves; each octave is twice as fine as the one before.
_SEED = 6
_OCTAVES = 5


def make_boulder(triangles: int) -> Asset:
    """Return a sphere, radius about 1 m, with waves that occlude each other, of about so many triangles.

    The surface does not depend on the number of triangles.
    """
    # A mesh of s segments and r = s / 2 rings has s (r - 2) quads and 2 s triangles: s (s - 2) triangles in all.
    segments = 2 * max(4, round(0.5 * (1.0 + np.sqrt(1.0 + triangles))))
    sphere = make_sphere(segments, segments // 2).meshes[0]
    points = (sphere.points * (1.0 + _waves(sphere.points.astype(np.float64)))[:, None]).astype(np.float32)
    corners, sizes = sphere.corner_points, sphere.face_sizes
    areas = area_vectors(points[corners].astype(np.float64), sizes)
    normals = smooth_normals(areas, corners, sizes, len(points)).astype(np.float32)
    mesh = Mesh("/boulder", points, corners, sizes, sphere.face_slots, normals, None, sphere.uvs)
    return make_asset(f"boulder of {triangles} triangles", [mesh], [Instance(0, np.eye(4))], [Slot("/boulder")])


def triangle_count(asset: Asset) -> int:
    """Return the number of triangles of an asset, over all instances."""
    return sum(int((asset.meshes[each.mesh].face_sizes - 2).sum()) for each in asset.instances)


def _waves(points: Floats) -> Floats:
    """Return the displacement (n,) at points (n, 3) of the unit sphere: sums of plane waves."""
    rng = np.random.default_rng(_SEED)
    total = np.zeros(len(points))
    for octave in range(_OCTAVES):
        for direction in rng.normal(size=(4, 3)):
            frequency = 3.0 * 2.0**octave * direction / np.linalg.norm(direction)
            total += 0.03 * 0.5**octave * np.sin(points @ frequency + rng.uniform(0.0, 2.0 * np.pi))
    return total
