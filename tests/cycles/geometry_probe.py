"""Build an asset in Blender and report what is there: ``python geometry_probe.py REQUEST.pickle OUT.pickle``."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from lookdev.cycles import engine
from lookdev.cycles.geometry import add_asset
from lookdev.lifetime import leaving

_FIELDS = {"FLOAT": "value", "INT": "value", "FLOAT_VECTOR": "vector", "FLOAT2": "vector", "FLOAT4X4": "value"}


def values(attribute: Any) -> np.ndarray:
    field = _FIELDS[attribute.data_type]
    return np.array([np.ravel(getattr(each, field)) for each in attribute.data], np.float32)


def at_corners(data: Any, attribute: Any) -> np.ndarray:
    """Return an attribute of faces, points or corners at every corner."""
    owners = {
        "CORNER": range(len(data.loops)),
        "POINT": [loop.vertex_index for loop in data.loops],
        "FACE": [face.index for face in data.polygons for _ in face.loop_indices],
    }
    return values(attribute)[owners[attribute.domain]]


def main(request: Path, out: Path) -> None:
    """Write, for each case, its meshes by name and the objects that an evaluated scene shows."""
    answers = {}
    for name, (asset, sources, worn, options) in pickle.loads(request.read_bytes()).items():
        scene = engine.empty_scene()
        materials = [bpy.data.materials.new(source.name) for source in sources]
        shown = add_asset(scene, asset, sources, worn, materials, **options)
        for number, item in enumerate(shown.objects):
            item.color = (0.25, 0.5, 0.75, float(number))
        meshes = {}
        for data, mesh in shown.meshes:
            index = data.attributes.get("material_index")
            meshes[mesh.name] = {
                "materials": [material.name for material in data.materials],
                "material_index": None if index is None else values(index).ravel(),
                "uvs": [layer.name for layer in data.uv_layers],
                "edges": len(data.edges),
                "attributes": {
                    each.name: at_corners(data, each)
                    for each in data.attributes
                    if each.name != "position" and each.data_type in ("FLOAT", "FLOAT_VECTOR", "FLOAT2")
                },
                "domains": {each.name: each.domain for each in data.attributes},
            }
        seen = [
            (each.object.data.name, np.array(each.matrix_world), tuple(each.object.color))
            for each in bpy.context.evaluated_depsgraph_get().object_instances
            if each.object.type == "MESH" and len(each.object.data.polygons) and "speck" not in each.object.name
        ]
        answers[name] = {"meshes": meshes, "seen": seen, "objects": len(shown.objects)}
    out.write_bytes(pickle.dumps(answers))


if __name__ == "__main__":
    with leaving():
        main(*map(Path, sys.argv[1:]))
