"""Assets of a few squares, and looks for them."""

from collections.abc import Sequence

import numpy as np

from lookdev.asset import Asset, Instance, Mesh, Slot
from lookdev.asset.store import make_asset
from lookdev.material import Input, Layer, Look


def squares(name: str, slots: Sequence[int] = (0,), uvs: Sequence[str] = ("st",), default_uv: str = "") -> Mesh:
    """Return a row of unit squares in the plane y = 0; `slots` has the slot of each square."""
    x = np.repeat(np.arange(len(slots)), 4) + np.tile([0.0, 1.0, 1.0, 0.0], len(slots))
    z = np.tile([0.0, 0.0, 1.0, 1.0], len(slots))
    corners = len(x)
    st = np.stack([x, z], axis=1).astype(np.float32)
    points = np.stack([x, np.zeros(corners), z], axis=1).astype(np.float32)
    numbers, sizes = np.arange(corners, dtype=np.int32), np.full(len(slots), 4, np.int32)
    normals, tangents = (np.tile(np.float32(axis), (corners, 1)) for axis in ([0, -1, 0], [1, 0, 0]))
    sets = {uv: st + np.float32(number) for number, uv in enumerate(uvs)}
    face_slots = np.array(slots, np.int32)
    return Mesh(name, points, numbers, sizes, face_slots, normals, tangents, sets, default_uv=default_uv)


def asset_of(meshes: Sequence[Mesh], placed: Sequence[tuple[int, str]], slots: Sequence[Slot]) -> Asset:
    """Return an asset; `placed` has the mesh and the path of each instance, one above the other."""
    instances = []
    for height, (mesh, path) in enumerate(placed):
        matrix = np.eye(4)
        matrix[2, 3] = 2.0 * height
        instances.append(Instance(mesh, matrix, path))
    return make_asset("toy", meshes, instances, slots)


def look(name: str, **inputs: Input) -> Look:
    return Look(name, (Layer("Base", "disney", inputs),))
