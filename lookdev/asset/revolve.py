"""Makes meshes of surfaces of revolution, for the built-in sphere and shader ball.

A profile is a curve in the half plane of radius and height; it is revolved about the z axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset.mesh import Mesh


@dataclass(frozen=True, eq=False)
class RevolvedProfile:
    """A curve from the lower pole to the upper pole, both on the axis, with the outside on the right of its direction.

    - points (k, 2): radius and height in metres; only the first and the last point are on the axis
    - normals (k, 2): outward unit normals, as radial and axial components
    - v (k,): the texture coordinate v, from 0 at the first point to 1 at the last
    """

    points: Floats
    normals: Floats
    v: Floats


def revolve(name: str, profile: RevolvedProfile, segments: int, slot: int = 0) -> Mesh:
    """Revolve a profile about the z axis to a closed mesh with one UV set, ``st``.

    u grows around the axis from +x, counter-clockwise seen from above. The tangents are the exact directions around the
    axis. Faces are quads, except for triangles at the two poles. A triangle's corner at a pole has the u of the
    triangle's middle. All faces have the slot `slot`.
    """
    rings = len(profile.points) - 2
    angles = 2.0 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    body = profile.points[1:-1]
    points = np.empty((rings, segments, 3))
    points[..., :2] = body[:, None, :1] * ring
    points[..., 2] = body[:, 1:]
    poles = np.array([[0.0, 0.0, profile.points[end, 1]] for end in (0, -1)])

    # The row of each corner is the number of its profile point, and the column its number around the axis. Column
    # `segments` has the points of column 0, but u = 1. The arrays have the corners of the triangles at the first pole,
    # then of the quads, then of the triangles at the last pole.
    j, i = np.arange(segments), np.arange(1, rings)
    rows = np.concatenate(
        [
            np.tile([0, 1, 1], segments),
            np.repeat(np.stack([i, i, i + 1, i + 1], axis=-1), segments, axis=0).ravel(),
            np.tile([rings, rings, rings + 1], segments),
        ]
    )
    columns = np.concatenate(
        [
            np.stack([j + 0.5, j + 1, j], axis=-1).ravel(),
            np.tile(np.stack([j, j + 1, j + 1, j], axis=-1).ravel(), rings - 1),
            np.stack([j, j + 1, j + 0.5], axis=-1).ravel(),
        ]
    )
    # The point of each corner; the two poles are the last points.
    index = (rows - 1) * segments + columns.astype(np.intp) % segments
    index[rows == 0] = rings * segments
    index[rows == rings + 1] = rings * segments + 1
    face_sizes = np.repeat([3, 4, 3], [segments, (rings - 1) * segments, segments])
    # The azimuth of each corner.
    phi = 2.0 * np.pi * columns / segments
    radial, axial = profile.normals[rows].T
    return Mesh(
        name=name,
        points=np.vstack([points.reshape(-1, 3), poles]).astype(np.float32),
        corner_points=index.astype(np.int32),
        face_sizes=face_sizes.astype(np.int32),
        face_slots=np.full(len(face_sizes), slot, np.int32),
        normals=np.stack([radial * np.cos(phi), radial * np.sin(phi), axial], axis=-1).astype(np.float32),
        tangents=np.stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)], axis=-1).astype(np.float32),
        uvs={"st": np.stack([columns / segments, profile.v[rows]], axis=-1).astype(np.float32)},
        default_uv="st",
    )
