"""What Cycles' own lights send: run in a process of its own, ``python lamp_probe.py REQUEST.json OUT.npz``.

The request has `lights`, `place`, `normal`, and of each light a direction to it. For each light the result has the
irradiance about the normal, by a white diffuse square, and the radiance along the direction, as a mirror shows it.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Vector
from pydantic import TypeAdapter

from lookdev.cycles import engine, version
from lookdev.cycles.lights import add_lights
from lookdev.cycles.world import build_world
from lookdev.lifetime import leaving
from lookdev.light import AnyLight, Light

SIDE = 0.004
SHOWN: dict[str, tuple[str, int, float]] = {
    "diffuse": ("BsdfDiffuse", 1024, math.pi),
    "mirror": ("BsdfGlossy", 16, 1.0),
}


def square(scene: Any, place: Vector, normal: Vector, kind: str) -> None:
    mesh = bpy.data.meshes.new("square")
    corners = [(-SIDE, -SIDE, 0.0), (SIDE, -SIDE, 0.0), (SIDE, SIDE, 0.0), (-SIDE, SIDE, 0.0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("white")
    tree = version.empty_node_tree(material)
    node = tree.nodes.new(f"ShaderNode{kind}")
    node.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    node.inputs["Roughness"].default_value = 0.0
    tree.links.new(node.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    mesh.materials.append(material)
    item = bpy.data.objects.new("square", mesh)
    item.location, item.rotation_euler = place, normal.to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(item)


def measure(light: Light, place: Vector, normal: Vector, towards: Vector, shown: str) -> list[float]:
    kind, samples, scale = SHOWN[shown]
    scene = engine.empty_scene()
    engine.configure_closures(scene, (16, 16), 4, "cpu")
    scene.world = build_world("world", [light], sampled=True)
    add_lights(scene.collection, [light], np.zeros(3))
    square(scene, place, normal, kind)
    lens = bpy.data.cameras.new("camera")
    lens.type, lens.ortho_scale, lens.clip_start = "ORTHO", SIDE / 2.0, 1e-3
    camera = scene.camera = bpy.data.objects.new("camera", lens)
    mirrored = 2.0 * towards.dot(normal) * normal - towards
    camera.location, camera.rotation_euler = place + 0.1 * mirrored, mirrored.to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    picture = engine.render_whole(scene, samples)["Combined"]
    return [scale * float(channel) for channel in picture[..., :3].mean(axis=(0, 1), dtype=np.float64)]


def main(request: str, out: str) -> None:
    asked = json.loads(Path(request).read_text())
    adapter: TypeAdapter[Light] = TypeAdapter(AnyLight)
    place, normal = Vector(asked["place"]), Vector(asked["normal"])
    lights, towards = map(adapter.validate_python, asked["lights"]), map(Vector, asked["towards"])
    for_each = list(zip(lights, towards, strict=True))
    found = {key: [measure(light, place, normal, to, key) for light, to in for_each] for key in SHOWN}
    np.savez(out, **{key: np.array(values) for key, values in found.items()})


if __name__ == "__main__":
    with leaving():
        main(*sys.argv[1:])
