"""Render what node trees compute, a pixel a point: ``python tree_probe.py SOURCES.pickle OUT.npz``.

The surface is the square from (-1, -1) to (1, 1), seen from straight above.
"""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import bpy
import numpy as np

from lookdev.codegen import NodeSource
from lookdev.cycles import engine
from lookdev.cycles.nodes import build_material
from lookdev.cycles.points import add_plane
from lookdev.lifetime import leaving

SIDE = 32


def main(request: Path, out: Path) -> None:
    """Write the picture of each source, (SIDE, SIDE, 3), row 0 at y = -1."""
    sources: dict[str, NodeSource] = pickle.loads(request.read_bytes())
    scene = engine.empty_scene()
    engine.configure_closures(scene, (SIDE, SIDE), bounces=0, device="cpu")
    scene.world = bpy.data.worlds.new("black")
    mesh = add_plane(scene, height=1.0)
    mesh.materials.append(None)
    pictures = {}
    for name, source in sources.items():
        mesh.materials[0] = build_material(source)
        pictures[name] = engine.render_passes(scene, 1)["Combined"][..., :3].copy()
    np.savez(out, **pictures)


if __name__ == "__main__":
    with leaving():
        main(*map(Path, sys.argv[1:]))
