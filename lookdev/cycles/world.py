"""Builds a world of Blender from the dome lights of a scene. The light of the world is the sum of the domes' light."""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Matrix

from lookdev.cycles import version
from lookdev.cycles.nodes import SocketInput, add_node, load_image
from lookdev.light import Dome, Light
from lookdev.light.native import world_domes

_ROW_HEIGHT = 400.0  # the distance between the nodes of two domes in the node editor

# The most texels across an importance map. Cycles itself chooses this width for any light. A map with twice the width
# of the light's image has the same noise (docs/notebook/cycles-importance-map.md).
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
    """Build a world from the lat-long images of a scene's domes; without domes, the world is black.

    Parameters
    ----------
    sampled
        Whether Cycles samples directions of the world, by an importance map. Cycles builds the map again after any
        change of the world.
    after_portals
        Whether only rays that have passed a ray portal see the world; other rays of the camera see black.
    strength
        A factor of the radiance.
    turn
        A rotation of the domes about z in degrees, counter-clockwise seen from above.

    Raises
    ------
    RenderError
        A map cannot be read.
    """
    world = bpy.data.worlds.new(name)
    tree = version.clear_node_tree(world)
    domes = world_domes(lights)
    dome_strength = _add_portal_strength(tree, strength) if after_portals and domes else strength
    surface: dict[str, SocketInput] = {}
    for number, dome in enumerate(domes):
        node = _add_dome(tree, dome, dome_strength, turn, -_ROW_HEIGHT * number)
        if surface:
            both = {0: surface["Surface"], 1: node.outputs[0]}
            node = add_node(tree, "AddShader", both, location=(1200.0 + 200.0 * number, -_ROW_HEIGHT * number))
        surface = {"Surface": node.outputs[0]}
    add_node(tree, "OutputWorld", surface, location=(1200.0 + 200.0 * len(domes), 0.0))
    if sampled and domes:
        world.cycles.sampling_method = "MANUAL"
        world.cycles.sample_map_resolution = min(max(2 * dome.width for dome in domes), _MAX_MAP_WIDTH)
    else:
        world.cycles.sampling_method = "NONE"
    return world


def _add_dome(
    tree: bpy.types.ShaderNodeTree, dome: Dome, strength: SocketInput, turn: float, height: float
) -> bpy.types.ShaderNodeBackground:
    """Add the nodes of a dome in a row of the node editor, at a height; return its background node."""
    axes = np.array(dome.axes)
    mirror = np.diag([np.sign(np.linalg.det(axes)), 1.0, 1.0])
    angle = math.radians(turn)
    # A direction is turned back, then expressed in the dome's `axes`. If these are left-handed, the direction is
    # mirrored first, so that the rest is a rotation: the node has only a scale and a rotation.
    back = np.array(Matrix.Rotation(-angle, 3, "Z"))
    rotation = Matrix((axes @ back @ mirror).tolist()).to_euler("XYZ")
    is_identity = np.array_equal(axes, np.eye(3))
    coordinates = add_node(tree, "TexCoord")
    # The Mapping node transforms the direction of the look-up, not the map: first the scale, then the rotation.
    transform: dict[str, SocketInput] = {
        "Vector": coordinates.outputs["Generated"],
        "Rotation": (0.0, 0.0, -angle) if is_identity else tuple(rotation),
        "Scale": tuple(np.diag(mirror)),
    }
    mapping = add_node(tree, "Mapping", transform, vector_type="POINT")
    map_image = {"image": load_image(dome.radiance_file.path), "interpolation": "Linear"}
    texture = add_node(tree, "TexEnvironment", {"Vector": mapping.outputs["Vector"]}, **map_image)
    nodes, color = [coordinates, mapping, texture], texture.outputs["Color"]
    if dome.emission.color != (1.0, 1.0, 1.0):
        nodes.append(add_node(tree, "VectorMath", {0: color, 1: dome.emission.color}, operation="MULTIPLY"))
        color = nodes[-1].outputs[0]
    nodes.append(add_node(tree, "Background", {"Color": color, "Strength": strength}))
    for column, node in enumerate(nodes):
        node.location = (300.0 * column, height)
    return nodes[-1]


def _add_portal_strength(tree: bpy.types.ShaderNodeTree, strength: float) -> bpy.types.NodeSocket:
    """Add nodes that compute a strength, which is 0 for rays that have not passed a portal; return their output."""
    path = add_node(tree, "LightPath")
    depth = {0: path.outputs["Transparent Depth"], 1: 0.5}
    has_passed = add_node(tree, "Math", depth, operation="GREATER_THAN")
    product = add_node(tree, "Math", {0: has_passed.outputs[0], 1: strength}, operation="MULTIPLY")
    for column, node in enumerate((path, has_passed, product)):
        node.location = (300.0 * column, 300.0)
    return product.outputs[0]
