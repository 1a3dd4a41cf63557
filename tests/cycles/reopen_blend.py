"""Read an exported .blend as an artist's Blender: run in a process of its own, which never imports lookdev.

``python reopen_blend.py FILE.blend FACTS.json [SCENE WORLD FRAME SEED SAMPLES OUT.exr]...`` writes the content of
the file, and renders frames with the second block of twice the samples, as the halves of lookdev's frames.
"""

import json
import os
import sys
import traceback
from pathlib import Path
from typing import Any

import bpy

LONGEST_TABLE = 8192  # of lookdev.cycles.engine, which is not imported here


def facts() -> dict[str, Any]:
    opens = bpy.context.window_manager.windows[0].scene.name
    trees = [*bpy.data.node_groups, *(datablock.node_tree for datablock in [*bpy.data.materials, *bpy.data.worlds])]
    return {
        "opens": opens,
        "scenes": {scene.name: scene_facts(scene) for scene in bpy.data.scenes},
        "worlds": {world.name: world.use_fake_user for world in bpy.data.worlds},
        "nodes": sorted({node.bl_idname for tree in trees for node in tree.nodes}),
        "images": {i.filepath: bool(i.packed_files) for i in bpy.data.images if i.source == "FILE"},
        "texts": [text.name for text in bpy.data.texts],
        "libraries": [library.filepath for library in bpy.data.libraries],
        "attributes": sorted({a.name for mesh in bpy.data.meshes for a in mesh.attributes}),
        "modules": [name for name in sys.modules if name.startswith("lookdev")],
    }


def scene_facts(scene: Any) -> dict[str, Any]:
    bpy.context.window_manager.windows[0].scene = scene  # only the scene of a window is evaluated
    frames = []
    asset = next(item for item in scene.objects if item.type == "EMPTY")
    for frame in [step / 2 for step in range(2 * scene.frame_start, 2 * scene.frame_end + 1)]:
        scene.frame_set(int(frame), subframe=frame % 1.0)
        root, camera = (item.evaluated_get(scene.view_layers[0].depsgraph) for item in (asset, scene.camera))
        depsgraph = scene.view_layers[0].depsgraph
        lights = {
            item.name: [*item.evaluated_get(depsgraph).location] for item in scene.objects if item.type == "LIGHT"
        }
        placement = {"turn": root.rotation_euler.z, "asset": [*root.location], "lights": lights}
        frames.append({"camera": [*camera.location]} | placement)
    rigs = [rig for rig in scene.view_layers[0].layer_collection.children if rig.name.startswith("rig ")]
    return {
        "rigs": {rig.name: [not rig.exclude, sorted(item.name for item in rig.collection.objects)] for rig in rigs},
        "engine": scene.render.engine,
        "world": scene.world.name,
        "view": scene.view_settings.view_transform,
        "size": [scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage],
        "samples": [scene.cycles.samples, scene.cycles.use_sample_subset, scene.cycles.seed],
        "range": [scene.frame_start, scene.frame_end],
        "markers": {marker.name: marker.frame for marker in scene.timeline_markers},
        "device": scene.cycles.device,
        "transparent": scene.render.film_transparent,
        "half_frames": frames,
        "materials": sorted({slot.material.name for item in scene.objects for slot in item.material_slots}),
    }


def render(name: str, world: str, frame: str, seed: str, samples: str, out: str) -> None:
    scene = bpy.data.scenes[name]
    bpy.context.window_manager.windows[0].scene = scene
    scene.world = bpy.data.worlds[world]
    scene.frame_set(int(frame))
    settings, image = scene.cycles, scene.render.image_settings
    settings.use_sample_subset = True
    # As before every frame of lookdev: Cycles' table of sample points has its full length, so that points are the same.
    render_settings = scene.render
    render_settings.use_persistent_data = True
    render_settings.use_border, render_settings.border_max_x, render_settings.border_max_y = True, 0.1, 0.1
    settings.samples, settings.sample_offset, settings.sample_subset_length = LONGEST_TABLE, 0, 1
    bpy.ops.render.render()
    render_settings.use_border = False
    settings.seed, settings.samples = int(seed), 2 * int(samples)
    settings.sample_offset = settings.sample_subset_length = int(samples)
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGBA", "32"
    scene.render.filepath = out
    bpy.ops.render.render(write_still=True)


def main(file: str, facts_file: str, *renders: str) -> None:
    bpy.ops.wm.open_mainfile(filepath=file)
    Path(facts_file).write_text(json.dumps(facts()))
    for start in range(0, len(renders), 6):
        render(*renders[start : start + 6])


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except BaseException:  # noqa: BLE001  (the interpreter would otherwise run Blender's exit, which can hang)
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)
    os._exit(0)
