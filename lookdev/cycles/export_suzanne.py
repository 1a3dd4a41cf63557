"""Exports the data of the built-in asset ``suzanne``: ``python -m lookdev.cycles.export_suzanne OUT.npz``.

The result is a file of the package, ``lookdev/asset/data/suzanne.npz``. The asset is Blender's monkey after two levels
of Catmull-Clark subdivision, at the modifier's limit positions. The file has the arrays ``points`` (n, 3) float32 in
metres, ``faces`` (f, 4) uint16 counter-clockwise seen from outside, and ``uvs`` (f, 4, 2) float32.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy  # isort: split

import bmesh  # can be imported only after bpy
import numpy as np

from lookdev.cache import atomic_path


def export_suzanne(out: Path) -> None:
    """Write the subdivided monkey to an ``.npz`` file."""
    mesh = bpy.data.meshes.new("suzanne")
    monkey = bmesh.new()
    monkey.loops.layers.uv.new("st")
    bmesh.ops.create_monkey(monkey, calc_uvs=True)
    monkey.to_mesh(mesh)
    monkey.free()
    item = bpy.data.objects.new("suzanne", mesh)
    bpy.context.scene.collection.objects.link(item)
    modifier = item.modifiers.new("subdivision", "SUBSURF")
    modifier.levels = 2
    result = item.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()

    points = np.empty(3 * len(result.vertices), np.float32)
    result.vertices.foreach_get("co", points)
    faces = np.empty(len(result.loops), np.int32)
    result.loops.foreach_get("vertex_index", faces)
    uvs = np.empty(2 * len(result.loops), np.float32)
    result.uv_layers[0].uv.foreach_get("vector", uvs)
    points, quads, uvs = points.reshape(-1, 3), faces.reshape(-1, 4).astype(np.uint16), uvs.reshape(-1, 4, 2)
    with atomic_path(out) as temporary:
        np.savez_compressed(temporary, points=points, faces=quads, uvs=uvs)


if __name__ == "__main__":
    export_suzanne(Path(sys.argv[1]))
