"""Lights that have a place, or a direction, as lights of Blender: a builder a kind.

Radiometry, measured on 4.5 and 5.2: with `normalize` a light of P watts and an area A sends the radiance P / (pi A), as
a Lambertian emitter; the strength of a sun is the irradiance at right angles to it. Lights of Cycles occlude nothing,
and a ray that passes one counts it among its transparent bounces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from lookdev.cycles import version
from lookdev.cycles.nodes import load_image
from lookdev.errors import RenderError
from lookdev.light import CylinderLight, DiskLight, DistantLight, Light, RectLight, Shaping, SphereLight, called
from lookdev.light.placement import Axes

Floats = NDArray[np.float64]

_SIDES = 256  # of a cylinder


@dataclass(frozen=True)
class Placed:
    """An object of Blender that shows a light, and where it is at pose 0: location and XYZ Euler angles.

    Whether it turns with the rig; `offset` are degrees that a rig is turned beyond its poses.
    """

    item: Any
    turns: bool
    location: Floats
    angles: tuple[float, float, float]
    offset: float = 0.0

    def stand(self, lighting: float, frame: float, axis: tuple[float, float]) -> None:
        """Place the object as it stands in a `frame` that is turned, while the rig is turned by `lighting`."""
        self.turn(self.turns * (lighting + self.offset) - frame, axis)

    def turn(self, degrees: float, axis: tuple[float, float]) -> None:
        """Place the object, turned about a vertical axis."""
        angle = math.radians(degrees)
        sine, cosine = math.sin(angle), math.cos(angle)
        x, y = self.location[0] - axis[0], self.location[1] - axis[1]
        self.item.location = (axis[0] + cosine * x - sine * y, axis[1] + sine * x + cosine * y, self.location[2])
        # The matrix is Rz Ry Rx: a further turn about z adds to the last angle.
        self.item.rotation_euler = (self.angles[0], self.angles[1], self.angles[2] + angle)


def add_lights(into: Any, lights: Sequence[Light], origin: Floats, strength: float = 1.0) -> list[Placed]:
    """Add the lights that are not domes to a collection of Blender, in which `origin` is at 0.

    Parameters
    ----------
    strength
        Factor of the radiance.

    Raises
    ------
    RenderError
        A texture cannot be read.
    """
    placed = []
    for number, light in enumerate(lights, start=1):
        if light.far and light.map_dome:
            continue  # the world shows it
        if light.kind not in BUILDERS:
            raise RenderError(f"{called(light, number)}: Blender has no light of its kind")
        name = light.emission.group or f"{light.kind} {number}"
        data = BUILDERS[light.kind](name, light, strength)
        item = bpy.data.objects.new(name, data)
        item.rotation_mode = "XYZ"
        _configure(item)
        into.objects.link(item)
        location = np.array(light.position or origin) - origin
        made = Placed(item, light.emission.turns, location, _angles(light.axes))
        made.turn(0.0, (0.0, 0.0))
        placed.append(made)
    return placed


def _configure(item: Any) -> None:
    """Set what rays meet: the camera sees no light, mirrors do, and none casts a shadow."""
    item.visible_camera = False
    item.visible_diffuse = item.visible_glossy = item.visible_transmission = True
    item.visible_volume_scatter = False
    item.visible_shadow = item.type == "LIGHT"  # of a lamp it has no effect
    item.cycles.use_motion_blur = False


def _angles(axes: Axes) -> tuple[float, float, float]:
    """Return the XYZ Euler angles of axes; where they are left-handed, of those with -x for x.

    All shapes are alike from both sides of x; a texture is mirrored instead.
    """
    matrix = np.array(axes).T
    matrix[:, 0] *= np.sign(np.linalg.det(matrix))
    across = math.hypot(matrix[0, 0], matrix[1, 0])
    if across < 1e-9:
        return math.atan2(-matrix[1, 2], matrix[1, 1]), math.atan2(-matrix[2, 0], across), 0.0
    return (
        math.atan2(matrix[2, 1], matrix[2, 2]),
        math.atan2(-matrix[2, 0], across),
        math.atan2(matrix[1, 0], matrix[0, 0]),
    )


def _data(name: str, kind: str, color: Sequence[float], power: float) -> Any:
    """Make a light; its colour has a largest channel of 1, its power the rest."""
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


def _area(name: str, light: RectLight | DiskLight, shape: str, size: tuple[float, float], strength: float) -> Any:
    data = _data(name, "AREA", light.emission.color, math.pi * light.size_factor * strength)
    data.shape = shape
    data.size, data.size_y = size
    data.spread = math.pi
    return data


def _rect(name: str, light: RectLight, strength: float) -> Any:
    data = _area(name, light, "RECTANGLE", (light.width, light.height), strength)
    if light.texture or light.emission.shaping:
        nodes = _Nodes(data)
        nodes.emit(nodes.texture(light) if light.texture else None, light.emission.shaping)
    return data


def _disk(name: str, light: DiskLight, strength: float) -> Any:
    data = _area(name, light, "ELLIPSE", (2.0 * light.radii[0], 2.0 * light.radii[1]), strength)
    if light.emission.shaping:
        _Nodes(data).emit(None, light.emission.shaping)
    return data


def _sphere(name: str, light: SphereLight, strength: float) -> Any:
    data = _data(name, "POINT", light.emission.color, math.pi * light.size_factor * strength)
    data.shadow_soft_size = light.radius
    data.use_soft_falloff = False
    # Cycles' own lights places inside it, too.
    nodes = _Nodes(data)
    nodes.emit(nodes.scaled((1.0, 1.0, 1.0), nodes.outwards()), light.emission.shaping)
    return data


def _distant(name: str, light: DistantLight, strength: float) -> Any:
    versine = light.shape.versine
    data = _data(name, "SUN", light.sent, math.pi * versine * (2.0 - versine) * strength)
    data.angle = 2.0 * math.acos(1.0 - versine) if versine > 1e-3 else 2.0 * math.sqrt(2.0 * versine)
    return data


def _cylinder(name: str, light: CylinderLight, strength: float) -> Any:
    """Make the side as a mesh that emits outwards, and that rays pass."""
    angle = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    # As wide as the circle is on average over directions: the perimeters are equal.
    radius = light.radius * (math.pi / _SIDES) / math.sin(math.pi / _SIDES)
    ring = np.stack([np.zeros(_SIDES), radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    half = np.array((light.length / 2.0, 0.0, 0.0))
    near, following = np.arange(_SIDES), (np.arange(_SIDES) + 1) % _SIDES
    faces = np.stack([near, near + _SIDES, following + _SIDES, following], axis=-1)
    data = bpy.data.meshes.new(name)
    data.from_pydata(np.concatenate([ring - half, ring + half]).tolist(), [], faces[:, ::-1].tolist())
    material = bpy.data.materials.new(name)
    material.cycles.emission_sampling = "FRONT"
    material.use_transparent_shadow = True
    data.materials.append(material)
    nodes = _Nodes(material)
    front = nodes.math("SUBTRACT", 1.0, nodes.add("NewGeometry").outputs["Backfacing"])
    largest = max(light.emission.color) or 1.0
    color = nodes.scaled([channel / largest for channel in light.emission.color], front)
    emission = nodes.emission(color, light.emission.shaping, largest * strength)
    both = nodes.add("AddShader")
    nodes.link(emission, both.inputs[0])
    nodes.link(nodes.add("BsdfTransparent").outputs["BSDF"], both.inputs[1])
    nodes.link(both.outputs[0], nodes.add("OutputMaterial").inputs["Surface"])
    return data


BUILDERS: dict[str, Callable[[str, Any, float], Any]] = {
    "rect": _rect,
    "disk": _disk,
    "sphere": _sphere,
    "distant": _distant,
    "cylinder": _cylinder,
}
"""Make the data of a light's object, by its name, the light, and a factor of its radiance."""


class _Nodes:
    """The nodes of a light, or of the material of a mesh that is one."""

    def __init__(self, owner: Any) -> None:
        self.tree = version.empty_node_tree(owner)

    def add(self, kind: str) -> Any:
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        node.location = (200.0 * len(self.tree.nodes), 0.0)
        return node

    def link(self, start: Any, end: Any) -> None:
        """Set an input, to an output of another node or to a value."""
        if isinstance(start, bpy.types.NodeSocket):
            self.tree.links.new(start, end)
        else:
            end.default_value = start

    def math(self, operation: str, *inputs: Any) -> Any:
        node = self.add("Math")
        node.operation, node.use_clamp = operation, False
        for socket, value in zip(node.inputs, inputs, strict=False):
            self.link(value, socket)
        return node.outputs[0]

    def vector(self, operation: str, *inputs: Any) -> Any:
        node = self.add("VectorMath")
        node.operation = operation
        for socket, value in zip(node.inputs, inputs, strict=False):
            self.link(value, socket)
        return node.outputs[0]

    def scaled(self, color: Any, factor: Any) -> Any:
        """Return a colour times a number."""
        node = self.add("VectorMath")
        node.operation = "SCALE"
        self.link(color, node.inputs[0])
        self.link(factor, node.inputs["Scale"])
        return node.outputs[0]

    def apart(self, vector: Any) -> Sequence[Any]:
        node = self.add("SeparateXYZ")
        self.link(vector, node.inputs[0])
        return list(node.outputs)

    def incoming(self) -> Any:
        """Return the direction, in the light's own space, from what emits to what is lit."""
        turned = self.add("VectorTransform")
        turned.vector_type, turned.convert_from, turned.convert_to = "VECTOR", "WORLD", "OBJECT"
        self.link(self.add("NewGeometry").outputs["Incoming"], turned.inputs[0])
        return turned.outputs[0]

    def outwards(self) -> Any:
        """Return 1 where a sphere emits away from its middle, else 0."""
        node = self.add("VectorMath")
        node.operation = "DOT_PRODUCT"
        self.link(self.add("TexCoord").outputs["Object"], node.inputs[0])
        self.link(self.incoming(), node.inputs[1])
        return self.math("GREATER_THAN", node.outputs["Value"], 0.0)

    def texture(self, light: RectLight) -> Any:
        """Return the texel of a rectangle that emits: its first column is at +x, its top row at +y."""
        assert light.texture
        place = self.apart(self.add("TexCoord").outputs["Object"])
        mirrored = np.linalg.det(np.array(light.axes)) < 0.0
        u = self.math("MULTIPLY_ADD", place[0], (1.0 if mirrored else -1.0) / light.width, 0.5)
        v = self.math("MULTIPLY_ADD", place[1], 1.0 / light.height, 0.5)
        at = self.add("CombineXYZ")
        self.link(u, at.inputs[0])
        self.link(v, at.inputs[1])
        image = self.add("TexImage")
        image.image = load_image(light.texture.path)
        image.interpolation, image.extension, image.projection = "Linear", "EXTEND", "FLAT"
        self.link(at.outputs[0], image.inputs["Vector"])
        return image.outputs["Color"]

    def emission(self, color: Any, shaping: Shaping | None, strength: float = 1.0) -> Any:
        """Add the emission of a colour (None: white) in the beam of a light."""
        node = self.add("Emission")
        node.inputs["Strength"].default_value = strength
        if shaping:
            beam = self.beam(shaping)
            color = beam if color is None else self.vector("MULTIPLY", color, beam)
        if color is None:
            color = (1.0, 1.0, 1.0, 1.0)
        self.link(color, node.inputs["Color"])
        return node.outputs[0]

    def emit(self, color: Any, shaping: Shaping | None) -> None:
        self.link(self.emission(color, shaping), self.add("OutputLight").inputs["Surface"])

    def beam(self, shaping: Shaping) -> Any:
        """Return the factors of `Shaping.factor` without its profile."""
        x, y, z = self.apart(self.vector("NORMALIZE", self.incoming()))
        down = self.math("MULTIPLY", z, -1.0)
        across = self.math("SQRT", self.math("ADD", self.math("MULTIPLY", x, x), self.math("MULTIPLY", y, y)))
        angle = self.math("ARCTAN2", across, down)
        cone, start, rise = shaping.cone
        inside = self.math("SUBTRACT", 1.0, self.math("GREATER_THAN", angle, cone))
        t = self.math("MULTIPLY", self.math("SUBTRACT", angle, start), rise)
        t = self.math("MINIMUM", self.math("MAXIMUM", t, 0.0), 1.0)
        smooth = self.math("MULTIPLY", self.math("MULTIPLY", t, t), self.math("MULTIPLY_ADD", t, -2.0, 3.0))
        cone_factor = self.math("MULTIPLY", inside, self.math("SUBTRACT", 1.0, smooth))
        if shaping.focus <= 0.0:
            return self.scaled((1.0, 1.0, 1.0), cone_factor)
        focused = self.math("POWER", self.math("ABSOLUTE", z), shaping.focus)
        tinted = self.scaled(shaping.focus_tint, self.math("SUBTRACT", 1.0, focused))
        return self.scaled(self.vector("ADD", self.scaled((1.0, 1.0, 1.0), focused), tinted), cone_factor)
