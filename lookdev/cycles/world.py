"""Blender's worlds: the sum of a scene's dome lights."""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Matrix

from lookdev.cycles import version
from lookdev.cycles.nodes import load_image
from lookdev.light import Dome, Light
from lookdev.light.native import world_domes

_ROW = 400.0  # between the nodes of two domes

# Texels across the importance map that Cycles chooses for any light; one of twice the light's width has the same noise
# (docs/notebook/cycles-importance-map.md).
_MAX_MAP_WIDTH = 4096


def build_world(
    name: str,
    lights: Sequence[Light],
    *,
    sampled: bool,
    after_portals: bool = False,
    strength: float = 1.0,
    turn: float = 0.0,
) -> bpy.types.World:
    """Build a world from the lat-long images of a scene's domes; without domes it is black.

    Parameters
    ----------
    sampled
        Whether Cycles samples its directions, by an importance map that it builds again after any change of the world.
    after_portals
        Whether only rays that passed a ray portal see it; other rays of the camera see black.
    strength, turn
        Factor of the radiance, and degrees about z, counter-clockwise seen from above.

    Raises
    ------
    RenderError
        A map cannot be read.
    """
    world = bpy.data.worlds.new(name)
    tree = version.clear_node_tree(world)
    domes = world_domes(lights)
    portal_strength = _add_portal_strength(tree, strength) if after_portals and domes else None
    surface = None
    for number, dome in enumerate(domes):
        background = _add_dome(tree, dome, turn, -_ROW * number)
        background.inputs["Strength"].default_value = strength
        if portal_strength is not None:
            tree.links.new(portal_strength, background.inputs["Strength"])
        if surface is None:
            surface = background.outputs[0]
        else:
            both = tree.nodes.new("ShaderNodeAddShader")
            both.location = (1200.0 + 200.0 * number, -_ROW * number)
            tree.links.new(surface, both.inputs[0])
            tree.links.new(background.outputs[0], both.inputs[1])
            surface = both.outputs[0]
    output = tree.nodes.new("ShaderNodeOutputWorld")
    output.location = (1200.0 + 200.0 * len(domes), 0.0)
    if surface is not None:
        tree.links.new(surface, output.inputs["Surface"])
    if sampled and domes:
        world.cycles.sampling_method = "MANUAL"
        world.cycles.sample_map_resolution = min(max(2 * dome.width for dome in domes), _MAX_MAP_WIDTH)
    else:
        world.cycles.sampling_method = "NONE"
    return world


def _add_dome(tree: bpy.types.ShaderNodeTree, dome: Dome, turn: float, height: float) -> bpy.types.ShaderNodeBackground:
    """Add the nodes of a dome; return its background node."""
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    # The node transforms the direction of the look-up, not the map: first the scale, then the rotation.
    mapping.vector_type = "POINT"
    axes = np.array(dome.axes)
    mirror = np.diag([np.sign(np.linalg.det(axes)), 1.0, 1.0])
    angle = math.radians(turn)
    # `axes` transforms a direction that is turned back; after the mirror the product is a rotation.
    back = np.array(Matrix.Rotation(-angle, 3, "Z"))
    rotation = Matrix((axes @ back @ mirror).tolist()).to_euler("XYZ")
    is_identity = np.array_equal(axes, np.eye(3))
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, -angle) if is_identity else tuple(rotation)
    mapping.inputs["Scale"].default_value = tuple(np.diag(mirror))
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = load_image(dome.radiance_file.path)
    texture.interpolation = "Linear"
    background = tree.nodes.new("ShaderNodeBackground")
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    color = texture.outputs["Color"]
    nodes = [coordinates, mapping, texture, background]
    if dome.emission.color != (1.0, 1.0, 1.0):
        tinted = tree.nodes.new("ShaderNodeVectorMath")
        tinted.operation = "MULTIPLY"
        tinted.inputs[1].default_value = dome.emission.color
        tree.links.new(color, tinted.inputs[0])
        color = tinted.outputs[0]
        nodes.insert(3, tinted)
    tree.links.new(color, background.inputs["Color"])
    for column, node in enumerate(nodes):
        node.location = (300.0 * column, height)
    return background


def _add_portal_strength(tree: bpy.types.ShaderNodeTree, strength: float) -> bpy.types.NodeSocket:
    """Add nodes of a strength that is 0 for rays that did not pass a portal; return their output."""
    path = tree.nodes.new("ShaderNodeLightPath")
    has_passed = tree.nodes.new("ShaderNodeMath")
    has_passed.operation = "GREATER_THAN"
    has_passed.inputs[1].default_value = 0.5
    product = tree.nodes.new("ShaderNodeMath")
    product.operation = "MULTIPLY"
    product.inputs[1].default_value = strength
    tree.links.new(path.outputs["Transparent Depth"], has_passed.inputs[0])
    tree.links.new(has_passed.outputs[0], product.inputs[0])
    for column, node in enumerate((path, has_passed, product)):
        node.location = (300.0 * column, 300.0)
    return product.outputs[0]
