"""Worlds by which Cycles lights a scene: the sum of its dome lights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from lookdev.cycles import version
from lookdev.cycles.nodes import load_image
from lookdev.light import Dome, Light
from lookdev.light.native import world_domes

_ROW = 400.0  # between the nodes of two domes

# Texels across Cycles' automatic importance map, whatever its light. Twice as many as the light's give the same noise:
# of a light of 1024 texels, a first frame of 64 x 64 pixels takes 1.3 s in place of 2.8 s (two cores, both loaded);
# as many as the light's give up to 1.4 times its variance.
_AUTOMATIC = 4096


def build_world(
    name: str,
    lights: Sequence[Light],
    *,
    sampled: bool,
    after_portals: bool = False,
    strength: float = 1.0,
    turn: float = 0.0,
) -> Any:
    """Build a world that shows the domes of a scene by their lat-long images; without one it is black.

    Parameters
    ----------
    sampled
        Whether Cycles draws directions from it, by an importance map that it builds anew after any change of the world.
    after_portals
        Whether only rays that passed a ray portal see it; rays straight from the camera see black.
    strength, turn
        Factor of the radiance, and degrees about z, counter-clockwise seen from above.

    Raises
    ------
    RenderError
        A map cannot be read.
    """
    world = bpy.data.worlds.new(name)
    tree = version.empty_node_tree(world)
    domes = world_domes(lights)
    shown = _passed_portals(tree, strength) if after_portals and domes else None
    surface = None
    for number, dome in enumerate(domes):
        background = _add_dome(tree, dome, turn, -_ROW * number)
        background.inputs["Strength"].default_value = strength
        if shown is not None:
            tree.links.new(shown, background.inputs["Strength"])
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
        world.cycles.sample_map_resolution = min(max(2 * dome.width for dome in domes), _AUTOMATIC)
    else:
        world.cycles.sampling_method = "NONE"
    return world


def _add_dome(tree: Any, dome: Dome, turn: float, height: float) -> Any:
    """Add the nodes of one dome; return its background."""
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    # The node transforms the direction that is looked up, not the map: first the scale, then the rotation.
    mapping.vector_type = "POINT"
    axes = np.array(dome.axes)
    mirror = np.diag([np.sign(np.linalg.det(axes)), 1.0, 1.0])
    angle = math.radians(turn)
    # Rows of `axes` express a direction that is turned back; a mirror leaves a rotation.
    back = np.array(Matrix.Rotation(-angle, 3, "Z"))
    rotation = Matrix((axes @ back @ mirror).tolist()).to_euler("XYZ")
    plain = np.array_equal(axes, np.eye(3))
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, -angle) if plain else tuple(rotation)
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
    for place, node in enumerate(nodes):
        node.location = (300.0 * place, height)
    return background


def _passed_portals(tree: Any, strength: float) -> Any:
    """Return the strength for rays that passed a portal, 0 for others."""
    path = tree.nodes.new("ShaderNodeLightPath")
    passed = tree.nodes.new("ShaderNodeMath")
    passed.operation = "GREATER_THAN"
    passed.inputs[1].default_value = 0.5
    shown = tree.nodes.new("ShaderNodeMath")
    shown.operation = "MULTIPLY"
    shown.inputs[1].default_value = strength
    tree.links.new(path.outputs["Transparent Depth"], passed.inputs[0])
    tree.links.new(passed.outputs[0], shown.inputs[0])
    for place, node in enumerate((path, passed, shown)):
        node.location = (300.0 * place, 300.0)
    return shown.outputs[0]
