"""A plain Blender script that renders turntables: the baseline of ``lookdev bench --sequence``.

The bench runs the script as ``python -m lookdev.cycles.plain_sequence REQUEST.json``. The script works as such scripts
usually do, in one process and with the Principled BSDF. It rotates the object of the asset, rotates the light by a
Mapping node, and calls ``render.render`` for each frame.

Settings that affect only speed are Blender's defaults: no persistent data, and an automatic importance map. Settings
that affect the picture are the same as in this package: filter, bounces, samples, no adaptive sampling and no denoiser.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import TypedDict

import bpy
import numpy as np
from mathutils import Matrix

from lookdev.asset.bounds import center_asset
from lookdev.asset.mesh import Asset, Mesh
from lookdev.asset.store import read_asset
from lookdev.codegen.source import PrincipledSource
from lookdev.cycles import version
from lookdev.cycles.nodes import add_node
from lookdev.cycles.principled import build_principled_material
from lookdev.processes import exit_after_block


class SequenceCamera(TypedDict):
    """The camera. Angles are in degrees, lengths in metres."""

    fov: float  # horizontal
    elevation: float
    distance: float  # the distance from the target
    target: list[float]  # the point that it looks at


class SequenceFrame(TypedDict):
    """A frame to render."""

    file: str  # the file to write
    light: str  # the file of the lat-long map
    element: float  # degrees by which the asset is turned
    lighting: float  # degrees by which the light is turned


class SequenceRequest(TypedDict):
    """The content of the request's file: the frames to render, and everything that they have in common."""

    asset: str  # a file of `lookdev.asset.store`
    principled: dict[str, float | tuple[float, ...]]  # inputs of the Principled BSDF, by the names of its sockets
    camera: SequenceCamera
    resolution: tuple[int, int]
    samples: int
    bounces: int
    seed: int
    frames: list[SequenceFrame]


def render(request: SequenceRequest) -> None:
    """Render every frame of a request to its file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.data.scenes[0]
    _configure(scene, request)
    asset = read_asset(Path(request["asset"]))
    material = build_principled_material(PrincipledSource("principled", request["principled"]))
    root = _add_asset(scene, center_asset(asset), material)
    _add_camera(scene, request["camera"], asset)
    texture, mapping = add_environment_texture(scene)
    light = None
    for frame in request["frames"]:
        if frame["light"] != light:
            light = frame["light"]
            texture.image = bpy.data.images.load(light)
            texture.image.colorspace_settings.name = "Non-Color"
        root.rotation_euler.z = math.radians(frame["element"])
        # The node rotates the direction of the look-up, not the map: hence the sign.
        mapping.inputs["Rotation"].default_value[2] = -math.radians(frame["lighting"])
        scene.render.filepath = frame["file"]
        bpy.ops.render.render(write_still=True)


def _configure(scene: bpy.types.Scene, request: SequenceRequest) -> None:
    """Set the settings of the render and of the written files."""
    settings, output = scene.cycles, scene.render.image_settings
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = request["resolution"]
    scene.render.film_transparent = True
    scene.render.use_persistent_data = False
    output.file_format, output.color_mode, output.color_depth = "OPEN_EXR", "RGBA", "32"
    settings.samples, settings.seed = request["samples"], request["seed"]
    settings.use_adaptive_sampling = settings.use_denoising = False
    settings.pixel_filter_type, settings.filter_width = "BOX", 1.0
    settings.max_bounces = settings.diffuse_bounces = request["bounces"]
    settings.glossy_bounces = settings.transmission_bounces = request["bounces"]
    settings.sample_clamp_indirect = settings.blur_glossy = 0.0


def _add_asset(scene: bpy.types.Scene, asset: Asset, material: bpy.types.Material) -> bpy.types.Object:
    """Add an object for each instance of the asset; return the empty that is their parent."""
    root = bpy.data.objects.new("turntable", None)
    scene.collection.objects.link(root)
    meshes = [_build_mesh(mesh, material) for mesh in asset.meshes]
    for instance in asset.instances:
        item = bpy.data.objects.new(asset.name, meshes[instance.mesh])
        item.parent = root
        item.matrix_parent_inverse = Matrix(instance.matrix.tolist())
        scene.collection.objects.link(item)
    return root


def _build_mesh(mesh: Mesh, material: bpy.types.Material) -> bpy.types.Mesh:
    """Build a mesh with its first UV set, its normals and the material."""
    data = bpy.data.meshes.new(mesh.name)
    faces = np.split(mesh.corner_points, np.cumsum(mesh.face_sizes)[:-1])
    data.from_pydata(mesh.points.tolist(), [], [face.tolist() for face in faces])
    if mesh.uvs:
        data.uv_layers.new(name="st").data.foreach_set("uv", next(iter(mesh.uvs.values())).ravel())
    data.normals_split_custom_set(mesh.normals)
    data.materials.append(material)
    return data


def _add_camera(scene: bpy.types.Scene, camera: SequenceCamera, asset: Asset) -> None:
    """Add the camera; the asset's centre is at the origin of the scene."""
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.angle = "HORIZONTAL", math.radians(camera["fov"])
    lens.clip_start, lens.clip_end = 1e-3 * camera["distance"], 1e3 * camera["distance"]
    elevation = math.radians(camera["elevation"])
    item = bpy.data.objects.new("camera", lens)
    offset = camera["distance"] * np.array([0.0, -math.cos(elevation), math.sin(elevation)])
    item.location = (np.array(camera["target"]) - asset.center + offset).tolist()
    item.rotation_euler = (math.pi / 2 - elevation, 0.0, 0.0)
    scene.collection.objects.link(item)
    scene.camera = item


def add_environment_texture(
    scene: bpy.types.Scene,
) -> tuple[bpy.types.ShaderNodeTexEnvironment, bpy.types.ShaderNodeMapping]:
    """Light a scene by an environment texture; return its node and the node that rotates it."""
    scene.world = bpy.data.worlds.new("light")
    tree = version.clear_node_tree(scene.world)
    mapping = add_node(tree, "Mapping", {"Vector": add_node(tree, "TexCoord").outputs["Generated"]})
    texture = add_node(tree, "TexEnvironment", {"Vector": mapping.outputs["Vector"]})
    background = add_node(tree, "Background", {"Color": texture.outputs["Color"]})
    add_node(tree, "OutputWorld", {"Surface": background.outputs["Background"]})
    return texture, mapping


if __name__ == "__main__":
    with exit_after_block():
        render(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
