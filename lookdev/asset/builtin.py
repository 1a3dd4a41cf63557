"""Makes the built-in assets, which a job selects by `asset.builtin` instead of a USD file."""

from __future__ import annotations

import io
from collections.abc import Callable
from importlib import resources

import numpy as np

from lookdev.asset.mesh import Asset, Instance, Mesh, Slot
from lookdev.asset.normals import area_vectors, smooth_normals
from lookdev.asset.revolve import RevolvedProfile, revolve
from lookdev.asset.shaderball import make_shaderball
from lookdev.asset.store import make_asset


def make_plane() -> Asset:
    """Return an upright card, 2 m by 2 m, centred at the origin, that faces -y; u grows along +x, v along +z."""
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    mesh = Mesh(
        name="/plane",
        points=np.stack([2 * uvs[:, 0] - 1, 0 * uvs[:, 0], 2 * uvs[:, 1] - 1], axis=-1),
        corner_points=np.arange(4, dtype=np.int32),
        face_sizes=np.array([4], np.int32),
        face_slots=np.array([0], np.int32),
        normals=np.tile(np.array([0, -1, 0], np.float32), (4, 1)),
        tangents=np.tile(np.array([1, 0, 0], np.float32), (4, 1)),
        uvs={"st": uvs},
        default_uv="st",
    )
    return make_asset("plane", [mesh], [Instance(0, np.eye(4))], [Slot("/plane")], convex=True, sheet=True)


def make_sphere(segments: int = 512, rings: int = 256) -> Asset:
    """Return the unit sphere at the origin, with exact normals and tangents.

    u grows around the z axis, and v grows with the polar angle from the pole at -z to the pole at +z.
    """
    theta = np.pi * np.arange(rings + 1) / rings
    # On a unit sphere, the points of the profile are also its normals.
    points = np.stack([np.sin(theta), -np.cos(theta)], axis=-1)
    mesh = revolve("/sphere", RevolvedProfile(points, points, theta / np.pi), segments)
    return make_asset("sphere", [mesh], [Instance(0, np.eye(4))], [Slot("/sphere")], convex=True, revolved=True)


def make_suzanne() -> Asset:
    """Return Blender's monkey after two levels of Catmull-Clark subdivision; z is up, and it faces -y.

    Its arrays come from `data/suzanne.npz`, which `lookdev.cycles.export_suzanne` writes: points (n, 3), faces (f, 4)
    as indices of points, uvs (f, 4, 2) at the corners of the faces.
    """
    data = resources.files("lookdev.asset").joinpath("data", "suzanne.npz").read_bytes()
    with np.load(io.BytesIO(data)) as arrays:
        points, faces, uvs = arrays["points"], arrays["faces"], arrays["uvs"].reshape(-1, 2)
    corner_points = faces.ravel().astype(np.int32)
    face_sizes = np.full(len(faces), faces.shape[1], np.int32)
    areas = area_vectors(points[corner_points].astype(np.float64), face_sizes)
    normals = smooth_normals(areas, corner_points, face_sizes, len(points)).astype(np.float32)
    mesh = Mesh(
        name="/suzanne",
        points=points,
        corner_points=corner_points,
        face_sizes=face_sizes,
        face_slots=np.zeros_like(face_sizes),
        normals=normals,
        tangents=None,
        uvs={"st": uvs},
        default_uv="st",
    )
    return make_asset("suzanne", [mesh], [Instance(0, np.eye(4))], [Slot("/suzanne")])


BUILTINS: dict[str, Callable[[], Asset]] = {
    "plane": make_plane,
    "shaderball": make_shaderball,
    "sphere": make_sphere,
    "suzanne": make_suzanne,
}
