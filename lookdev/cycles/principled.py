"""Builds materials of Blender's own Principled BSDF, as a user would, for backend `principled` of the bench."""

from __future__ import annotations

import bpy

from lookdev.codegen.source import PrincipledSource
from lookdev.cycles import version
from lookdev.cycles.geometry import AssetObjects
from lookdev.cycles.nodes import SocketInput, add_node


def build_principled_material(source: PrincipledSource) -> bpy.types.Material:
    """Build a material of a single Principled BSDF node."""
    material = bpy.data.materials.new(source.name)
    tree = version.clear_node_tree(material)
    inputs: dict[str, SocketInput] = {
        name: value if isinstance(value, float | int) else (*value, 1.0) for name, value in source.inputs.items()
    }
    if source.inputs.get("Anisotropic", 0.0):
        inputs["Tangent"] = add_node(tree, "Tangent", direction_type="UV_MAP").outputs["Tangent"]
    node = add_node(tree, "BsdfPrincipled", inputs, distribution="MULTI_GGX")
    add_node(tree, "OutputMaterial", {"Surface": node.outputs["BSDF"]})
    return material


def set_blender_normals(added: AssetObjects) -> None:
    """Set the 16-bit normals that Blender's own BSDFs read, and Blender's default offset at the shadow terminator."""
    for data, mesh in added.meshes:
        data.normals_split_custom_set(mesh.normals)
    for item in added.objects:
        item.shadow_terminator_geometry_offset = 0.1


def configure_user_defaults(scene: bpy.types.Scene) -> None:
    """Set Blender's defaults for the settings in which `engine.configure_closures` differs from them."""
    settings = scene.cycles
    if scene.world.cycles.sampling_method == "MANUAL":
        scene.world.cycles.sampling_method = "AUTOMATIC"
    settings.sampling_pattern = "AUTOMATIC"
    settings.light_sampling_threshold = 0.01
    settings.transparent_max_bounces = 8
