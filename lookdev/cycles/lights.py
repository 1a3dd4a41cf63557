"""Builds the lights of a scene that are not domes as lights of Blender, by a function for each kind of light.

Radiometry, measured on Blender 4.5 and 5.2: with `normalize`, a light of P watts and area A emits the radiance
P / (pi A), like a Lambertian emitter. The strength of a sun is the irradiance at right angles to its direction. Lights
of Cycles occlude nothing. A ray that passes through a light counts this as a transparent bounce.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import bpy
import numpy as np

from lookdev.arrays import Floats
from lookdev.cycles import version
from lookdev.cycles.nodes import SocketInput, add_node, load_image
from lookdev.errors import RenderError
from lookdev.light import CylinderLight, DiskLight, DistantLight, Light, RectLight, Shaping, SphereLight, light_label
from lookdev.light.placement import Axes

_SIDES = 256  # the number of sides of the prism that approximates a cylinder


@dataclass(frozen=True)
class LightObject:
    """An object of Blender that is a light. At pose 0, nothing is turned."""

    item: bpy.types.Object
    turns: bool  # whether it turns with the rig
    location: Floats  # (3,), at pose 0
    angles: tuple[float, float, float]  # XYZ Euler angles in radians, at pose 0
    offset: float = 0.0  # a constant angle in degrees, added to the lighting angle of every pose

    def pose(self, lighting: float, frame: float, axis: tuple[float, float]) -> None:
        """Set the object's transform for a pose.

        lighting : the angle by which the rig is turned; frame : the angle by which the frame of reference, Blender's
        scene, is turned. Both are in degrees about the vertical `axis`.
        """
        self.rotate(self.turns * (lighting + self.offset) - frame, axis)

    def rotate(self, degrees: float, axis: tuple[float, float]) -> None:
        """Set the object's transform: the transform at pose 0, rotated about a vertical axis through (x, y)."""
        angle = math.radians(degrees)
        sine, cosine = math.sin(angle), math.cos(angle)
        x, y = self.location[0] - axis[0], self.location[1] - axis[1]
        self.item.location = (axis[0] + cosine * x - sine * y, axis[1] + sine * x + cosine * y, self.location[2])
        # The matrix of XYZ Euler angles is Rz Ry Rx, so a further rotation about z adds to the last angle.
        self.item.rotation_euler = (self.angles[0], self.angles[1], self.angles[2] + angle)


def add_lights(
    collection: bpy.types.Collection, lights: Sequence[Light], origin: Floats, strength: float = 1.0
) -> list[LightObject]:
    """Add the lights that are not domes to a collection of Blender, and return their objects.

    Parameters
    ----------
    origin : (3,)
        The point of the world that is at 0 in Blender's scene.
    strength
        A factor of the radiance of all lights.

    Raises
    ------
    RenderError
        A texture cannot be read, or Blender has no light of a kind.
    """
    objects = []
    for number, light in enumerate(lights, start=1):
        if light.world_dome:
            continue  # it is part of the world
        if light.kind not in BUILDERS:
            raise RenderError(f"{light_label(light, number)}: Blender has no light of its kind")
        name = light.emission.group or f"{light.kind} {number}"
        data = BUILDERS[light.kind](name, light, strength)
        item = bpy.data.objects.new(name, data)
        item.rotation_mode = "XYZ"
        _set_visibility(item)
        collection.objects.link(item)
        location = np.array(light.position or origin) - origin
        light_object = LightObject(item, light.emission.turns, location, _angles(light.axes))
        light_object.rotate(0.0, (0.0, 0.0))
        objects.append(light_object)
    return objects


def _set_visibility(item: bpy.types.Object) -> None:
    """Set which rays see a light: reflections do, the camera does not. The light casts no shadow."""
    item.visible_camera = False
    item.visible_diffuse = item.visible_glossy = item.visible_transmission = True
    item.visible_volume_scatter = False
    item.visible_shadow = item.type == "LIGHT"  # only a mesh could cast a shadow; a light of Blender never does
    item.cycles.use_motion_blur = False


def _angles(axes: Axes) -> tuple[float, float, float]:
    """Return the XYZ Euler angles, in radians, of a light's axes. If the axes are left-handed, -x replaces x.

    All shapes of lights are symmetric in x. A texture is not, and is mirrored instead (`_LightNodes.texel`).
    """
    matrix = np.array(axes).T
    matrix[:, 0] *= np.sign(np.linalg.det(matrix))
    across = math.hypot(matrix[0, 0], matrix[1, 0])
    if across < 1e-9:  # the x axis is vertical: the first and the last angle rotate about the same axis
        return math.atan2(-matrix[1, 2], matrix[1, 1]), math.atan2(-matrix[2, 0], across), 0.0
    return (
        math.atan2(matrix[2, 1], matrix[2, 2]),
        math.atan2(-matrix[2, 0], across),
        math.atan2(matrix[1, 0], matrix[0, 0]),
    )


def _add_data(name: str, kind: str, color: Sequence[float], power: float) -> bpy.types.Light:
    """Add Blender's data of a light. Its colour is scaled to a largest channel of 1, and its power by the inverse."""
    data = bpy.data.lights.new(name, kind)
    largest = max(color) or 1.0
    data.color = [channel / largest for channel in color]
    data.energy = power * largest
    data.exposure = 0.0
    data.normalize = True
    data.use_temperature = data.use_custom_distance = False
    data.diffuse_factor = data.specular_factor = data.transmission_factor = data.volume_factor = 1.0
    data.use_shadow = True
    data.cycles.max_bounces = 1024
    data.cycles.use_multiple_importance_sampling = True
    data.cycles.is_portal = data.cycles.is_caustics_light = False
    return data


def _build_area(name: str, light: RectLight | DiskLight, strength: float) -> bpy.types.AreaLight:
    """Build a rectangle or a disk, with its texture and its beam."""
    data = _add_data(name, "AREA", light.emission.color, math.pi * light.size_factor * strength)
    data.spread = math.pi
    textured = light if isinstance(light, RectLight) and light.texture else None
    if isinstance(light, RectLight):
        data.shape, data.size, data.size_y = "RECTANGLE", light.width, light.height
    else:
        data.shape, (data.size, data.size_y) = "ELLIPSE", (2.0 * radius for radius in light.radii)
    if textured or light.emission.shaping:
        nodes = _LightNodes(data)
        nodes.add_output(nodes.texel(textured) if textured else None, light.emission.shaping)
    return data


def _build_sphere(name: str, light: SphereLight, strength: float) -> bpy.types.PointLight:
    """Build a sphere, which emits outwards only."""
    data = _add_data(name, "POINT", light.emission.color, math.pi * light.size_factor * strength)
    data.shadow_soft_size = light.radius
    data.use_soft_falloff = False
    # Without the following factor, Cycles' sphere would also light points inside it.
    nodes = _LightNodes(data)
    nodes.add_output(nodes.scale((1.0, 1.0, 1.0), nodes.outward_factor()), light.emission.shaping)
    return data


def _build_distant(name: str, light: DistantLight, strength: float) -> bpy.types.SunLight:
    """Build a sun. Its size is given by the versine, 1 minus the cosine, of its angular radius."""
    versine = light.versine
    data = _add_data(name, "SUN", light.emitted_radiance, math.pi * versine * (2.0 - versine) * strength)
    # For small angles, the arc cosine is inaccurate.
    data.angle = 2.0 * math.acos(1.0 - versine) if versine > 1e-3 else 2.0 * math.sqrt(2.0 * versine)
    return data


def _build_cylinder(name: str, light: CylinderLight, strength: float) -> bpy.types.Mesh:
    """Build the lateral surface of a cylinder as a mesh that emits outwards and that rays pass through."""
    angle = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    # The polygon has the perimeter of the circle, and therefore the same mean width over all directions.
    radius = light.radius * (math.pi / _SIDES) / math.sin(math.pi / _SIDES)
    ring = np.stack([np.zeros(_SIDES), radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    half = np.array((light.length / 2.0, 0.0, 0.0))
    near, next_side = np.arange(_SIDES), (np.arange(_SIDES) + 1) % _SIDES
    faces = np.stack([near, near + _SIDES, next_side + _SIDES, next_side], axis=-1)
    data = bpy.data.meshes.new(name)
    data.from_pydata(np.concatenate([ring - half, ring + half]).tolist(), [], faces[:, ::-1].tolist())
    material = bpy.data.materials.new(name)
    material.cycles.emission_sampling = "FRONT"
    material.use_transparent_shadow = True
    data.materials.append(material)
    nodes = _LightNodes(material)
    front = nodes.add_math("SUBTRACT", 1.0, nodes.add("NewGeometry").outputs["Backfacing"])
    largest = max(light.emission.color) or 1.0
    color = nodes.scale([channel / largest for channel in light.emission.color], front)
    emission = nodes.add_emission(color, light.emission.shaping, largest * strength)
    both = nodes.add("AddShader", {0: emission, 1: nodes.add("BsdfTransparent").outputs["BSDF"]})
    nodes.add("OutputMaterial", {"Surface": both.outputs[0]})
    return data


BUILDERS: dict[str, Callable[..., bpy.types.Light | bpy.types.Mesh]] = {
    "rect": _build_area,
    "disk": _build_area,
    "sphere": _build_sphere,
    "distant": _build_distant,
    "cylinder": _build_cylinder,
}
"""The functions that add the data of a light's object, by the kind of the light.

The arguments are the name, the light, and a factor of the radiance."""


class _LightNodes:
    """Adds nodes to a light, or to the material of a mesh that is a light. Methods return the output of a node."""

    def __init__(self, owner: bpy.types.Light | bpy.types.Material) -> None:
        self.tree = version.clear_node_tree(owner)

    def add(
        self, kind: str, inputs: Mapping[Any, SocketInput] = MappingProxyType({}), **settings: object
    ) -> bpy.types.Node:
        """Add a node, and return the node itself; the arguments are as in `add_node`."""
        location = 200.0 * (1 + len(self.tree.nodes)), 0.0
        return add_node(self.tree, kind, inputs, location=location, **settings)

    def add_math(self, operation: str, *inputs: SocketInput, kind: str = "Math") -> bpy.types.NodeSocket:
        """Return the result of an operation on numbers."""
        return self.add(kind, dict(enumerate(inputs)), operation=operation).outputs[0]

    def add_vector_math(self, operation: str, *inputs: SocketInput) -> bpy.types.NodeSocket:
        """Return the result of an operation on vectors."""
        return self.add_math(operation, *inputs, kind="VectorMath")

    def scale(self, color: SocketInput, factor: SocketInput) -> bpy.types.NodeSocket:
        """Return a colour times a number."""
        return self.add("VectorMath", {0: color, "Scale": factor}, operation="SCALE").outputs[0]

    def object_position(self) -> bpy.types.NodeSocket:
        """Return the emitting point in the space of the light."""
        return self.add("TexCoord").outputs["Object"]

    def emitted_direction(self) -> bpy.types.NodeSocket:
        """Return the direction, in the space of the light, from the emitting point to the receiver."""
        incoming = self.add("NewGeometry").outputs["Incoming"]
        spaces = {"vector_type": "VECTOR", "convert_from": "WORLD", "convert_to": "OBJECT"}
        return self.add("VectorTransform", {0: incoming}, **spaces).outputs[0]

    def outward_factor(self) -> bpy.types.NodeSocket:
        """Return 1 where a sphere emits away from its centre, else 0."""
        both = {0: self.object_position(), 1: self.emitted_direction()}
        return self.add_math(
            "GREATER_THAN", self.add("VectorMath", both, operation="DOT_PRODUCT").outputs["Value"], 0.0
        )

    def texel(self, light: RectLight) -> bpy.types.NodeSocket:
        """Return the colour of a rectangle's texture. Its first column is at +x, and its top row is at +y."""
        assert light.texture
        x, y, _ = self.add("SeparateXYZ", {0: self.object_position()}).outputs
        is_mirrored = np.linalg.det(np.array(light.axes)) < 0.0
        u = self.add_math("MULTIPLY_ADD", x, (1.0 if is_mirrored else -1.0) / light.width, 0.5)
        v = self.add_math("MULTIPLY_ADD", y, 1.0 / light.height, 0.5)
        st = self.add("CombineXYZ", {0: u, 1: v}).outputs[0]
        settings = {"interpolation": "Linear", "extension": "EXTEND", "projection": "FLAT"}
        return self.add("TexImage", {"Vector": st}, image=load_image(light.texture.path), **settings).outputs["Color"]

    def add_emission(
        self, color: SocketInput | None, shaping: Shaping | None, strength: float = 1.0
    ) -> bpy.types.NodeSocket:
        """Return the emission of a colour, or of white, with the beam of a light."""
        if shaping:
            beam = self.beam_factor(shaping)
            color = beam if color is None else self.add_vector_math("MULTIPLY", color, beam)
        inputs = {"Strength": strength, "Color": (1.0, 1.0, 1.0, 1.0) if color is None else color}
        return self.add("Emission", inputs).outputs[0]

    def add_output(self, color: SocketInput | None, shaping: Shaping | None) -> None:
        """Add the output of a light, with the emission of a colour, or of white."""
        self.add("OutputLight", {"Surface": self.add_emission(color, shaping)})

    def beam_factor(self, shaping: Shaping) -> bpy.types.NodeSocket:
        """Return the factor of the radiance by a beam, as `Shaping.factor` without the IES profile."""
        x, y, z = self.add("SeparateXYZ", {0: self.add_vector_math("NORMALIZE", self.emitted_direction())}).outputs
        down = self.add_math("MULTIPLY", z, -1.0)
        across = self.add_math(
            "SQRT", self.add_math("ADD", self.add_math("MULTIPLY", x, x), self.add_math("MULTIPLY", y, y))
        )
        angle = self.add_math("ARCTAN2", across, down)
        cone, start, rise = shaping.cone
        inside = self.add_math("SUBTRACT", 1.0, self.add_math("GREATER_THAN", angle, cone))
        t = self.add_math("MULTIPLY", self.add_math("SUBTRACT", angle, start), rise)
        t = self.add_math("MINIMUM", self.add_math("MAXIMUM", t, 0.0), 1.0)
        smooth = self.add_math("MULTIPLY", self.add_math("MULTIPLY", t, t), self.add_math("MULTIPLY_ADD", t, -2.0, 3.0))
        cone_factor = self.add_math("MULTIPLY", inside, self.add_math("SUBTRACT", 1.0, smooth))
        if shaping.focus <= 0.0:
            return self.scale((1.0, 1.0, 1.0), cone_factor)
        focused = self.add_math("POWER", self.add_math("ABSOLUTE", z), shaping.focus)
        tinted = self.scale(shaping.focus_tint, self.add_math("SUBTRACT", 1.0, focused))
        return self.scale(self.add_vector_math("ADD", self.scale((1.0, 1.0, 1.0), focused), tinted), cone_factor)
