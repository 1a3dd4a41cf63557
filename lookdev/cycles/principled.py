"""Cycles' own Principled BSDF under its own light, as a user would set them up: what the benchmark compares with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy

from lookdev.asset import Asset
from lookdev.codegen import PrincipledSource
from lookdev.cycles import version
from lookdev.ibl import LightTables


def principled_material(source: PrincipledSource) -> Any:
    """Make a material of one Principled BSDF node.

    Raises
    ------
    KeyError
        The node has no such socket.
    """
    material = bpy.data.materials.new(source.name)
    tree = version.empty_node_tree(material)
    node = tree.nodes.new("ShaderNodeBsdfPrincipled")
    node.distribution = "MULTI_GGX"
    for name, value in source.inputs.items():
        node.inputs[name].default_value = (*value, 1.0) if isinstance(value, tuple) else value
    if source.inputs.get("Anisotropic", 0.0):
        tangent = tree.nodes.new("ShaderNodeTangent")
        tangent.direction_type = "UV_MAP"
        tree.links.new(tangent.outputs["Tangent"], node.inputs["Tangent"])
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(node.outputs["BSDF"], output.inputs["Surface"])
    return material


def shade_by_normals(objects: Sequence[Any], asset: Asset) -> None:
    """Give the meshes of an asset's instances their normals the way that Blender's own BSDFs read them, in 16 bits."""
    for item, instance in zip(objects, asset.instances, strict=True):
        item.data.normals_split_custom_set(asset.meshes[instance.mesh].normals)


def light_by_world(scene: Any, light: LightTables, bounces: int) -> Any:
    """Light a scene by a world with the environment map, importance-sampled by Cycles.

    Returns the input of the node that turns it: Euler angles, radians.
    """
    settings = scene.cycles
    settings.shading_system = False
    scene.render.use_motion_blur = False
    settings.max_bounces = settings.diffuse_bounces = settings.glossy_bounces = settings.transmission_bounces = bounces
    settings.transparent_max_bounces = 8
    settings.caustics_reflective = settings.caustics_refractive = True
    settings.blur_glossy = 0.0

    tree = version.empty_node_tree(scene.world)
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    mapping.vector_type = "POINT"
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.load(str(light.radiance))
    texture.image.colorspace_settings.name = "Non-Color"
    # The fourth channel is the density of our own sampling.
    texture.image.alpha_mode = "CHANNEL_PACKED"
    background = tree.nodes.new("ShaderNodeBackground")
    output = tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    tree.links.new(background.outputs["Background"], output.inputs["Surface"])
    # Its map is of 4096 x 2048 then, and the picture less noisy for the same time than with one of the light's size.
    scene.world.cycles.sampling_method = "AUTOMATIC"
    return mapping.inputs["Rotation"]
