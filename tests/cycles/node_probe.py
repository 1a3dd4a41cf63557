"""Build hand-written nodes in Blender and report what they are there: ``python node_probe.py LIGHT.json OUT.npz``.

Renders suzanne twice in one pose, first as `Scene` turns it, then with the world turned instead.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy
import node_sources
import numpy as np
from pydantic import TypeAdapter

from lookdev.asset import load_asset, save_asset
from lookdev.cache import Content
from lookdev.cycles import engine
from lookdev.cycles.nodes import Groups, build_material
from lookdev.cycles.scene import Scene
from lookdev.cycles.world import build_world
from lookdev.lifetime import leaving
from lookdev.light import Dome
from lookdev.render.task import SceneTask
from lookdev.scene import Camera, Pose, Sampling

POSE = Pose(30.0, 75.0)
SAMPLES = 64


def main(light_file: Path, out: Path) -> None:
    """Write the two pictures of four seeds each, (4, H, W, 3), and what became of the nodes, as JSON."""
    light = TypeAdapter(Dome).validate_json(light_file.read_bytes())
    asset = load_asset(builtin="suzanne")
    camera = Camera(30.0, 20.0, asset.center, 4.2 * asset.radius)
    source = node_sources.diffuse((0.5, 0.4, 0.3))
    worn = (0,) * len(asset.slots)
    file = Content.of(save_asset(asset))
    scene = Scene(SceneTask(file, "nodes", (source,), worn, (light,), (48, 48), Sampling(SAMPLES, bounces=1), camera))

    def shoot() -> np.ndarray:
        return np.stack([engine.render_passes(scene.scene, SAMPLES, seed)["Combined"] for seed in range(4)])

    scene.pose(camera, POSE)
    turned = shoot()
    # The asset at rest, the camera where the asset's angle has it, and the world turned about both.
    scene.pose(camera, Pose(POSE.element, POSE.element))
    scene.scene.world = build_world("turned", [light], sampled=True, turn=POSE.lighting - POSE.element)
    world_turned = shoot()

    groups: Groups = {}
    materials = [build_material(node_sources.diffuse(color), groups) for color in ((0.1, 0.2, 0.3), (0.5, 0.5, 0.5))]
    shown = [material.node_tree.nodes["Surface"] for material in materials]
    (socket,) = [item for item in shown[0].node_tree.interface.items_tree if item.in_out == "INPUT"]
    images = [image for image in bpy.data.images if image.filepath == str(light.radiance_file.path)]
    facts = {
        "groups": len({node.node_tree.name for node in shown}),
        "colors": [[round(x, 6) for x in node.inputs["baseColor"].default_value] for node in shown],
        "default": [round(x, 6) for x in socket.default_value],
        "help": socket.description,
        "bump": materials[0].cycles.use_bump_map_correction,
        "emission": materials[0].cycles.emission_sampling,
        "images": [(image.colorspace_settings.name, image.alpha_mode) for image in images],
    }
    np.savez(out, turned=turned, world_turned=world_turned, facts=json.dumps(facts))


if __name__ == "__main__":
    with leaving():
        main(*map(Path, sys.argv[1:]))
