"""Functions that tests call in a process with bpy, by `BlenderProcess.call` of warm_blender.py."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import bpy
import node_sources
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from lookdev.arrays import Floats, Floats32
from lookdev.asset import load_asset, save_asset
from lookdev.cache import Content
from lookdev.codegen.source import NodeSource, ShaderSource
from lookdev.cycles import engine, version
from lookdev.cycles.geometry import add_asset
from lookdev.cycles.lights import add_lights
from lookdev.cycles.nodes import Groups, build_material
from lookdev.cycles.points import add_plane, render_table
from lookdev.cycles.scene import BlenderScene
from lookdev.cycles.shaders import array_text, insert_arrays
from lookdev.cycles.world import build_world
from lookdev.light import Dome, Light
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.scene import Camera, Pose, Sampling

_FIELDS = {"FLOAT": "value", "INT": "value", "FLOAT_VECTOR": "vector", "FLOAT2": "vector", "FLOAT4X4": "value"}


def build_assets(cases: Mapping[str, tuple[Any, ...]]) -> dict[str, dict[str, Any]]:
    """Return, for each case, its meshes by name and the visible objects of the evaluated scene."""
    answers = {}
    for name, (asset, sources, slot_sources, options) in cases.items():
        scene = engine.empty_scene()
        materials = [bpy.data.materials.new(source.name) for source in sources]
        added = add_asset(scene, asset, sources, slot_sources, materials, **options)
        for number, item in enumerate(added.objects):
            item.color = (0.25, 0.5, 0.75, float(number))
        visible = [
            (instance.object.data.name, np.array(instance.matrix_world), tuple(instance.object.color))
            for instance in bpy.context.evaluated_depsgraph_get().object_instances
            if instance.object.type == "MESH"
            and len(instance.object.data.polygons)
            and "speck" not in instance.object.name
        ]
        meshes = {mesh.name: _describe_mesh(data) for data, mesh in added.meshes}
        answers[name] = {"meshes": meshes, "seen": visible, "objects": len(added.objects)}
    return answers


def _describe_mesh(data: Any) -> dict[str, Any]:
    index = data.attributes.get("material_index")
    return {
        "materials": [material.name for material in data.materials],
        "material_index": None if index is None else _values(index).ravel(),
        "uvs": [layer.name for layer in data.uv_layers],
        "edges": len(data.edges),
        "attributes": {
            attribute.name: _at_corners(data, attribute)
            for attribute in data.attributes
            if attribute.name != "position" and attribute.data_type in ("FLOAT", "FLOAT_VECTOR", "FLOAT2")
        },
        "domains": {attribute.name: attribute.domain for attribute in data.attributes},
    }


def _values(attribute: Any) -> Floats32:
    field = _FIELDS[attribute.data_type]
    return np.array([np.ravel(getattr(element, field)) for element in attribute.data], np.float32)


def _at_corners(data: Any, attribute: Any) -> Floats32:
    """Return an attribute of faces, points or corners at every corner."""
    owners = {
        "CORNER": range(len(data.loops)),
        "POINT": [loop.vertex_index for loop in data.loops],
        "FACE": [face.index for face in data.polygons for _ in face.loop_indices],
    }
    return _values(attribute)[owners[attribute.domain]]


SIDE = 0.004
RECEIVERS: dict[str, tuple[str, int, float]] = {
    "diffuse": ("BsdfDiffuse", 256, math.pi),
    "mirror": ("BsdfGlossy", 16, 1.0),
}


def measure_lamps(
    lights: Mapping[str, Light], towards: Mapping[str, Any], position: Any, normal: Any
) -> dict[str, dict[str, Floats]]:
    """Return the irradiance of each light about the normal, and its radiance along a direction to the light.

    A white diffuse square reflects the first, a mirror the second.
    """
    position, normal = Vector(position), Vector(normal)
    return {
        kind: {name: _measure(light, position, normal, Vector(towards[name]), kind) for name, light in lights.items()}
        for kind in RECEIVERS
    }


def _measure(light: Light, position: Vector, normal: Vector, towards: Vector, receiver: str) -> Floats:
    kind, samples, scale = RECEIVERS[receiver]
    scene = engine.empty_scene()
    engine.configure_closures(scene, (16, 16), 4, "cpu")
    scene.world = build_world("world", [light], sampled=receiver == "diffuse")  # for a mirror no light is sampled
    add_lights(scene.collection, [light], np.zeros(3))
    _add_square(scene, position, normal, kind)
    lens = bpy.data.cameras.new("camera")
    lens.type, lens.ortho_scale, lens.clip_start = "ORTHO", SIDE / 2.0, 1e-3
    camera = scene.camera = bpy.data.objects.new("camera", lens)
    mirrored = 2.0 * towards.dot(normal) * normal - towards
    camera.location, camera.rotation_euler = position + 0.1 * mirrored, mirrored.to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    picture = engine.render_whole(scene, samples)["Combined"]
    return np.asarray(scale * picture[..., :3].mean(axis=(0, 1), dtype=np.float64))


def _add_square(scene: Any, position: Vector, normal: Vector, kind: str) -> None:
    mesh = bpy.data.meshes.new("square")
    corners = [(-SIDE, -SIDE, 0.0), (SIDE, -SIDE, 0.0), (SIDE, SIDE, 0.0), (-SIDE, SIDE, 0.0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("white")
    tree = version.clear_node_tree(material)
    node = tree.nodes.new(f"ShaderNode{kind}")
    node.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    node.inputs["Roughness"].default_value = 0.0
    tree.links.new(node.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    mesh.materials.append(material)
    item = bpy.data.objects.new("square", mesh)
    item.location, item.rotation_euler = position, normal.to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(item)


def build_nodes(light: Dome) -> dict[str, Any]:
    """Return facts of materials built from hand-written nodes, and two pictures of four seeds each, (4, H, W, 4).

    Both show suzanne in one pose: the first is rotated by `BlenderScene`, the second by its world instead.
    """
    pose, samples = Pose(30.0, 75.0), 16
    asset = load_asset(builtin="suzanne")
    camera = Camera(30.0, 20.0, asset.center, 4.2 * asset.radius)
    source = node_sources.diffuse((0.5, 0.4, 0.3))
    slot_sources, file = (0,) * len(asset.slots), Content.store_copy(save_asset(asset))
    scene = BlenderScene(
        SceneTask(file, "nodes", (source,), slot_sources, (light,), (48, 48), Sampling(samples, bounces=1), camera)
    )

    def shoot() -> Floats32:
        return np.stack([engine.render_passes(scene.scene, samples, seed)["Combined"] for seed in range(4)])

    scene.pose(camera, pose)
    rotated = shoot()
    # The asset at rest, the camera orbited by the asset's angle, and the world rotated about both.
    scene.pose(camera, Pose(pose.element, pose.element))
    scene.scene.world = build_world("turned", [light], sampled=True, turn=pose.lighting - pose.element)
    world_turned = shoot()

    groups: Groups = {}
    materials = [build_material(node_sources.diffuse(color), groups) for color in ((0.1, 0.2, 0.3), (0.5, 0.5, 0.5))]
    nodes = [material.node_tree.nodes["Surface"] for material in materials]
    (socket,) = [item for item in nodes[0].node_tree.interface.items_tree if item.in_out == "INPUT"]
    images = [image for image in bpy.data.images if image.filepath == str(light.radiance_file.path)]
    facts = {
        "groups": len({node.node_tree.name for node in nodes}),
        "colors": [[round(x, 6) for x in node.inputs["baseColor"].default_value] for node in nodes],
        "default": [round(x, 6) for x in socket.default_value],
        "help": socket.description,
        "bump": materials[0].cycles.use_bump_map_correction,
        "emission": materials[0].cycles.emission_sampling,
        "images": [[image.colorspace_settings.name, image.alpha_mode] for image in images],
    }
    return {"turned": rotated, "world_turned": world_turned, "facts": json.loads(json.dumps(facts))}


def render_tables(
    shaders: Mapping[str, tuple[str, Floats32, int]], arrays: Mapping[str, NDArray[Any]]
) -> dict[str, Floats32]:
    """Return the emission (n, 3) of OSL shaders, each of a text, a table (n, 12) and samples; arrays are parameters."""
    pictures = {}
    for name, (osl, table, samples) in shaders.items():
        # Half a million numbers take longer than the rest of a shader that does not read them.
        declared = {array: values for array, values in arrays.items() if f" {array}[" in osl}
        pictures[name] = render_table(ShaderSource("probe", osl, (), (), ""), table, 4, samples, declared)
    return pictures


def write_arrays(oso: str, arrays: Mapping[str, NDArray[Any]]) -> str:
    """Return the text of a compiled shader with arrays written into it."""
    return insert_arrays(oso, {name: array_text(values) for name, values in arrays.items()})


def render_regions(task: FrameTask, boxes: Sequence[engine.PixelBounds], samples: int) -> dict[str, Floats32]:
    """Return the pixels of each box, rendered alone, twice, and as part of the whole frame, before and after."""
    scene = BlenderScene(task.scene)
    scene.pose(task.scene.camera, task.pose)
    engine.fill_sample_table(scene.scene)
    pictures = {}

    def render(number: int, samples: int, within: engine.PixelBounds | None) -> Floats32:
        scene.set_controls(task.pose, number, samples)
        return engine.render_passes(scene.scene, samples, number, within)["Combined"].copy()

    for number, box in enumerate(boxes):
        left, bottom, right, top = box
        pictures[f"before{number}"] = render(number, samples, None)[bottom:top, left:right]
        # Between the renders, everything changes that can change from call to call.
        render(number + 7, 2 * samples, boxes[number - 1])
        pictures[f"part{number}"] = render(number, samples, box)
        render(number + 9, samples, box)
        pictures[f"again{number}"] = render(number, samples, box)
        pictures[f"after{number}"] = render(number, samples, None)[bottom:top, left:right]
    return pictures


def render_trees(sources: Mapping[str, NodeSource], side: int) -> dict[str, Floats32]:
    """Return the values that node trees compute (side, side, 3), a pixel for a point, row 0 at y = -1.

    The surface is the square from (-1, -1) to (1, 1), seen from straight above.
    """
    scene = engine.empty_scene()
    engine.configure_closures(scene, (side, side), bounces=0, device="cpu")
    scene.world = bpy.data.worlds.new("black")
    mesh = add_plane(scene, height=1.0)
    mesh.materials.append(None)
    pictures = {}
    for name, source in sources.items():
        mesh.materials[0] = build_material(source)
        pictures[name] = engine.render_passes(scene, 1)["Combined"][..., :3].copy()
    return pictures
