"""A scene task as Blender data: geometry, materials, camera."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from lookdev.asset.bounds import about_origin
from lookdev.asset.mesh import Asset, Mesh
from lookdev.asset.store import read_asset
from lookdev.asset.tangents import handedness
from lookdev.codegen import HANDEDNESS, AttributeBinding
from lookdev.cycles import engine
from lookdev.cycles.principled import light_by_world, principled_material, shade_by_normals
from lookdev.cycles.shaders import surface_material
from lookdev.plan.task import Camera, FrameTask, Pose, SceneTask


class Scene:
    """What is rendered, kept between frames: only what a task changes is rebuilt."""

    def __init__(self, task: SceneTask) -> None:
        self.task = task
        self.scene = engine.empty_scene()
        engine.configure(self.scene, task.resolution, task.sampling.bounces)
        asset = read_asset(task.asset_file)
        attributes = {binding for shader in task.shaders for binding in shader.attributes}
        if task.principled:
            materials = [principled_material(source) for source in task.principled]
        else:
            materials = [surface_material(shader, task.light) for shader in task.shaders]
        # The world's rotation, where it is the world that lights the scene.
        self._rotation: Any = None
        if self.lit_by_world:
            self._rotation = light_by_world(self.scene, task.light, task.sampling.bounces)
        # Cycles computes in float32: far from the origin it would lose the asset.
        self._origin = np.array(asset.center)
        asset = about_origin(asset)
        self._objects = _add_asset(self.scene, asset, materials, attributes)
        if task.principled:
            shade_by_normals(self._objects, asset)
        self._camera = _add_camera(self.scene)

    @property
    def lit_by_world(self) -> bool:
        """Whether Cycles itself samples the light, not our shaders."""
        return bool(self.task.principled)

    def fits(self, task: SceneTask) -> bool:
        """Tell whether frames of another task need nothing here to be rebuilt; camera and samples may differ."""
        return _built_from(task) == _built_from(self.task)

    def pose(self, task: FrameTask) -> None:
        """Stand the camera where it shows this pose. The asset never moves: its acceleration structure stays."""
        camera = task.scene.camera
        x, y, z = np.array(camera.target) - self._origin
        _place_camera(self._camera, replace(camera, target=(float(x), float(y), float(z))), task.pose)

    def control(self, pose: Pose, seed: int, samples: int) -> None:
        """Tell the shaders what changes from render to render, through the colour of the objects.

        A shader parameter would recompile the shader and a turned world rebuild its importance map; an object's
        colour costs neither. Blender keeps its channels at 0 or above, hence the angle in [0, 2 pi).
        """
        turn = math.radians((pose.lighting - pose.element) % 360.0)
        if self._rotation is not None and self._rotation.default_value[2] != np.float32(-turn):
            # The node turns the direction that is looked up, not the map. Whatever it is set to, Cycles begins anew.
            self._rotation.default_value = (0.0, 0.0, -turn)
        for item in self._objects:
            item.color = (turn, float(seed), float(samples), 1.0)


def _built_from(task: SceneTask) -> tuple[object, ...]:
    return task.asset_file, task.shaders, task.principled, task.light, task.resolution, task.sampling.bounces


def _add_asset(scene: Any, asset: Asset, materials: list[Any], attributes: set[AttributeBinding]) -> list[Any]:
    meshes = [_build_mesh(mesh, materials, attributes) for mesh in asset.meshes]
    # An object's own transform is location, rotation and scale: shear would be lost. What it inherits is a matrix.
    root = bpy.data.objects.new("root", None)
    scene.collection.objects.link(root)
    objects = []
    for instance in asset.instances:
        item = bpy.data.objects.new(asset.name, meshes[instance.mesh])
        item.parent = root
        item.matrix_parent_inverse = Matrix(instance.matrix.tolist())
        scene.collection.objects.link(item)
        objects.append(item)
    for data in meshes:
        if data.users == 1:
            _share(scene, data, asset)
    return objects


def _share(scene: Any, data: Any, asset: Asset) -> None:
    """Give a mesh a second user, so that Cycles keeps it as an instance with an acceleration structure of its own.

    The mesh of a single object is merged into the scene's, which any change of an object then builds anew: 40 ms for
    260,000 triangles, twice a frame. The second user is a speck far below, hidden from every kind of ray that ends
    in a picture; Cycles leaves out what no ray at all can see.
    """
    speck = bpy.data.objects.new("speck", data)
    speck.location = (0.0, 0.0, -1e3 * asset.radius)
    speck.scale = (1e-6, 1e-6, 1e-6)
    speck.visible_camera = speck.visible_diffuse = speck.visible_glossy = False
    speck.visible_transmission = speck.visible_shadow = False
    speck.visible_volume_scatter = True
    scene.collection.objects.link(speck)


def _build_mesh(mesh: Mesh, materials: list[Any], attributes: set[AttributeBinding]) -> Any:
    data = bpy.data.meshes.new(mesh.name)
    data.vertices.add(len(mesh.points))
    data.vertices.foreach_set("co", mesh.points.ravel())
    data.loops.add(len(mesh.corner_points))
    data.loops.foreach_set("vertex_index", mesh.corner_points)
    data.polygons.add(len(mesh.face_sizes))
    starts = np.concatenate([[0], np.cumsum(mesh.face_sizes)[:-1]]).astype(np.int32)
    data.polygons.foreach_set("loop_start", starts)
    for material in materials:
        data.materials.append(material)
    data.polygons.foreach_set("material_index", mesh.face_slots)
    data.update(calc_edges=True)
    for name, uv in mesh.uvs.items():
        data.uv_layers.new(name=name, do_init=False).data.foreach_set("uv", uv.ravel())
    # Normals and tangents go in as attributes: Blender's own custom normals are stored in 16 bits.
    _add_attribute(data, "lookdev_normal", mesh.normals)
    _add_attribute(data, "lookdev_tangent", mesh.tangents)
    corners = len(mesh.corner_points)
    for binding in attributes:
        if binding.kind != "uv":
            values = mesh.primvars.get(binding.attribute)
            if binding.attribute == HANDEDNESS:
                values = handedness(mesh)
            if values is None:
                fallback = np.asarray(binding.fallback, dtype=np.float32)
                values = np.tile(fallback, (corners, 1)) if len(fallback) > 1 else np.full(corners, fallback[0])
            _add_attribute(data, binding.attribute, values)
    return data


def _add_attribute(data: Any, name: str, values: Any) -> None:
    # FLOAT_VECTOR for colours too: no colour space is ever applied to a vector.
    kind, field = ("FLOAT", "value") if values.ndim == 1 else ("FLOAT_VECTOR", "vector")
    attribute = data.attributes.new(name, kind, "CORNER")
    attribute.data.foreach_set(field, np.ascontiguousarray(values, dtype=np.float32).ravel())


def _add_camera(scene: Any) -> Any:
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    return camera


def _place_camera(item: Any, camera: Camera, pose: Pose) -> None:
    """Orbit by ``-element``; oriented by angles, not by looking at the target, so that poles are no exception."""
    lens = item.data
    lens.type = "PERSP"
    lens.sensor_fit = "HORIZONTAL"
    lens.lens_unit = "FOV"
    lens.angle = math.radians(camera.fov)
    lens.shift_x = lens.shift_y = 0.0
    lens.dof.use_dof = False
    lens.clip_start = camera.distance * 1e-3
    lens.clip_end = camera.distance * 1e3
    azimuth = math.radians(-90.0 - pose.element)
    elevation = math.radians(camera.elevation)
    direction = (
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    )
    item.location = [t + camera.distance * d for t, d in zip(camera.target, direction, strict=True)]
    item.rotation_mode = "XYZ"
    item.rotation_euler = (math.pi / 2 - elevation, 0.0, azimuth + math.pi / 2)
