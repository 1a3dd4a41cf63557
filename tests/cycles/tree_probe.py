"""Render what node trees compute, a pixel a point: ``python tree_probe.py SOURCES.pickle OUT.npz``.

The surface is the square from (-1, -1) to (1, 1), seen from straight above.
"""

from __future__ import annotations

import os
import pickle
import sys
import traceback
from pathlib import Path

import bpy
import numpy as np

from lookdev.codegen import NodeSource
from lookdev.cycles import engine
from lookdev.cycles.nodes import build_material

SIDE = 32


def main(request: Path, out: Path) -> None:
    """Write the picture of each source, (SIDE, SIDE, 3), row 0 at y = -1."""
    sources: dict[str, NodeSource] = pickle.loads(request.read_bytes())
    scene = engine.empty_scene()
    engine.configure_closures(scene, (SIDE, SIDE), bounces=0, device="cpu")
    scene.world = bpy.data.worlds.new("black")
    mesh = bpy.data.meshes.new("plane")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(None)
    lens = bpy.data.cameras.new("camera")
    lens.type, lens.ortho_scale = "ORTHO", 2.0
    for data in (mesh, lens):
        scene.collection.objects.link(bpy.data.objects.new(data.name, data))
    scene.camera = bpy.data.objects["camera"]
    scene.camera.location = (0.0, 0.0, 1.0)
    pictures = {}
    for name, source in sources.items():
        mesh.materials[0] = build_material(source)
        pictures[name] = engine.render_passes(scene, 1)["Combined"][..., :3].copy()
    np.savez(out, **pictures)


if __name__ == "__main__":
    try:
        main(*map(Path, sys.argv[1:]))
    except BaseException:  # noqa: BLE001  (Blender's own exit can hang)
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)
    os._exit(0)
