"""Worlds by which Cycles lights a scene, for kinds of light that have a lat-long image."""

from __future__ import annotations

import math
from typing import Any

import bpy

from lookdev.cycles import version
from lookdev.cycles.nodes import load_image
from lookdev.light import Light, world_image


def build_world(
    name: str, light: Light, *, sampled: bool, after_portals: bool = False, strength: float = 1.0, turn: float = 0.0
) -> Any:
    """Build a world that shows a light by its lat-long image.

    Parameters
    ----------
    sampled
        Whether Cycles draws directions from it. Its importance map takes more than a second to build, after any change
        of the world.
    after_portals
        Whether only rays that passed a ray portal see it; rays straight from the camera see black.
    strength, turn
        Factor of the radiance, and degrees about z, counter-clockwise seen from above.

    Raises
    ------
    EnvironmentMapError
        Cycles' world cannot show lights of its kind.
    RenderError
        The map cannot be read.
    """
    world = bpy.data.worlds.new(name)
    tree = version.empty_node_tree(world)
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    # The node rotates the direction that is looked up, not the map.
    mapping.vector_type = "POINT"
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, -math.radians(turn))
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = load_image(world_image(light).path)
    texture.interpolation = "Linear"
    background = tree.nodes.new("ShaderNodeBackground")
    background.inputs["Strength"].default_value = strength
    output = tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    tree.links.new(background.outputs["Background"], output.inputs["Surface"])
    for place, node in enumerate((coordinates, mapping, texture, background, output)):
        node.location = (300.0 * place, 0.0)
    if after_portals:
        path = tree.nodes.new("ShaderNodeLightPath")
        passed = tree.nodes.new("ShaderNodeMath")
        passed.operation = "GREATER_THAN"
        passed.inputs[1].default_value = 0.5
        shown = tree.nodes.new("ShaderNodeMath")
        shown.operation = "MULTIPLY"
        shown.inputs[1].default_value = strength
        tree.links.new(path.outputs["Transparent Depth"], passed.inputs[0])
        tree.links.new(passed.outputs[0], shown.inputs[0])
        tree.links.new(shown.outputs[0], background.inputs["Strength"])
        for place, node in enumerate((path, passed, shown)):
            node.location = (300.0 * place, -300.0)
    # The automatic map has 4096 x 2048 texels: less noise in the same time than a map of the light's size.
    world.cycles.sampling_method = "AUTOMATIC" if sampled else "NONE"
    return world
