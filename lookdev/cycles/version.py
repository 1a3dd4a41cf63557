"""All differences between the supported versions of Blender (4.5 LTS and 5.2 LTS) that matter to this package."""

from __future__ import annotations

import bpy

BLENDER_5 = bpy.app.version >= (5, 0, 0)

VERSION: str = ".".join(str(number) for number in bpy.app.version)
"""The version of Blender, such as "4.5.1"."""

OSL_DEFINES: tuple[str, ...] = (f"#define LOOKDEV_ROW_0_AT_T_1 {int(BLENDER_5)}",)
"""The lines at the start of each generated OSL shader.

Blender 4.5 evaluates OSL's texture() by OpenImageIO, where t = 0 is the top row of an image. Blender 5 evaluates it
itself, and t = 0 is the bottom row."""


def clear_node_tree(datablock: bpy.types.Material | bpy.types.World | bpy.types.Light) -> bpy.types.ShaderNodeTree:
    """Remove all nodes from the shader node tree of a material, world or light; return the tree."""
    if not BLENDER_5:  # in Blender 5 there always is a tree, and setting this causes a warning
        datablock.use_nodes = True
    datablock.node_tree.nodes.clear()
    return datablock.node_tree


def center_motion_blur_on_frame(scene: bpy.types.Scene) -> None:
    """Open the shutter symmetrically about the time of the frame. Blender 5 has this among its render settings."""
    owner = scene.render if hasattr(scene.render, "motion_blur_position") else scene.cycles
    owner.motion_blur_position = "CENTER"
