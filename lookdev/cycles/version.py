"""Every difference between the supported Blenders (4.5 LTS and 5.2 LTS) that matters to this package."""

from __future__ import annotations

import bpy

BLENDER_5 = bpy.app.version >= (5, 0, 0)

VERSION: str = ".".join(str(number) for number in bpy.app.version)

# 4.5 evaluates OSL's texture() by OpenImageIO, with t = 0 at the top row; 5.x evaluates it itself, with t = 0 at the
# bottom row.
OSL_DEFINES: tuple[str, ...] = (f"#define LOOKDEV_ROW_0_AT_T_1 {int(BLENDER_5)}",)


def clear_node_tree(datablock: bpy.types.Material | bpy.types.World | bpy.types.Light) -> bpy.types.ShaderNodeTree:
    """Remove all nodes from the shader node tree of a material, world or light; return the tree."""
    if not BLENDER_5:  # 5.x always has a tree, and warns if this is set
        datablock.use_nodes = True
    datablock.node_tree.nodes.clear()
    return datablock.node_tree


def center_motion_blur_on_frame(scene: bpy.types.Scene) -> None:
    """Open the shutter symmetrically about the frame; the setting moved to the render settings in 5.x."""
    owner = scene.render if hasattr(scene.render, "motion_blur_position") else scene.cycles
    owner.motion_blur_position = "CENTER"
