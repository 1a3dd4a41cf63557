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
from lookdev.codegen import HANDEDNESS, AttributeBinding, NodeSource, PrincipledSource, ShaderSource, Source
from lookdev.cycles import engine
from lookdev.cycles.nodes import Groups, build_material
from lookdev.cycles.principled import configure_as_users_do, principled_material, shade_by_normals
from lookdev.cycles.shaders import surface_material
from lookdev.cycles.svm import check_stack
from lookdev.cycles.world import build_world
from lookdev.errors import RenderError
from lookdev.render.task import SceneTask
from lookdev.scene import Camera, Pose


class Scene:
    """What is rendered, kept between frames: only what a task changes is rebuilt.

    Attributes
    ----------
    scene, root, camera
        Blender's scene, the empty that all of the asset hangs on, and the camera.
    objects
        The asset's instances.
    """

    def __init__(self, task: SceneTask, into: Any = None, groups: Groups | None = None) -> None:
        """Build a task's scene.

        Parameters
        ----------
        task
            The scene.
        into
            An empty scene of Blender's to build it in; None: one beside which there is nothing else.
        groups
            Node groups to share with other scenes, as `build_material` does.

        Raises
        ------
        RenderError
            Blender cannot show one of the sources, or this machine has no such device.
        """
        self.task = task
        self.scene = engine.empty_scene() if into is None else into
        self._groups: Groups = {} if groups is None else groups
        self._configure()
        asset = read_asset(task.asset.path)
        # Cycles computes in float32: far from the origin it would lose the asset.
        self._origin = np.array(asset.center)
        asset = about_origin(asset)
        attributes = {binding for source in task.shaders for binding in source.attributes}
        self.root, self.objects = _add_asset(self.scene, asset, self._materials(), attributes)
        self.camera = _add_camera(self.scene)
        if self.by_user:
            shade_by_normals(self.objects, asset)
        else:
            for item in self.objects:
                # Shadows of facets are as they are, not smoothed.
                item.shadow_terminator_geometry_offset = item.shadow_terminator_shading_offset = 0.0
        if isinstance(task.shaders[0], NodeSource):
            check_stack(self.scene)

    @property
    def by_shaders(self) -> bool:
        """Whether our own shaders integrate the light; otherwise it is a world's."""
        return isinstance(self.task.shaders[0], ShaderSource)

    @property
    def by_portals(self) -> bool:
        """Whether all light comes through ray portals, so that alpha does not tell what is covered."""
        source = self.task.shaders[0]
        return isinstance(source, NodeSource) and source.exact

    @property
    def by_user(self) -> bool:
        """Whether it is as a user of Cycles would have it: one render, no halves."""
        return isinstance(self.task.shaders[0], PrincipledSource)

    def _configure(self) -> None:
        task = self.task
        bounces = task.sampling.bounces
        if self.by_shaders:
            engine.configure(self.scene, task.resolution, bounces)
        elif self.by_portals:
            engine.configure_portals(self.scene, task.resolution, bounces, task.device)
            self.scene.world = build_world("light", task.light, sampled=False, after_portals=True)
        else:
            engine.configure_closures(self.scene, task.resolution, bounces, task.device)
            # Directions of a light that is the same everywhere are as well drawn from the surface.
            self.scene.world = build_world("light", task.light, sampled=self.by_user or not task.light.constant)
        if self.by_user:
            configure_as_users_do(self.scene)

    def _materials(self) -> list[Any]:
        """Return the material of each slot; slots that share a look share it."""
        made: list[tuple[Source, Any]] = []
        materials = []
        for source in self.task.shaders:
            material = next((known for other, known in made if other == source), None)
            if material is None:
                material = self._material(source)
                made.append((source, material))
            materials.append(material)
        return materials

    def _material(self, source: Source) -> Any:
        match source:
            case ShaderSource():
                return surface_material(source, self.task.light)
            case NodeSource():
                return build_material(source, self._groups)
            case PrincipledSource():
                return principled_material(source)
            case other:
                raise RenderError(f"look '{other.name}': Cycles has no material for a {type(other).__name__}")

    def fits(self, task: SceneTask) -> bool:
        """Tell whether frames of another task need nothing here to be rebuilt; camera and samples may differ."""
        return _built_from(task) == _built_from(self.task)

    def pose(self, camera: Camera, pose: Pose) -> None:
        """Stand asset and camera where they show a pose, by location and Euler angles.

        For shaders of our own, which turn the light, the asset never moves. A world never turns: that would make Cycles
        sample it anew. The asset turns by ``element - lighting`` then, about the axis through the camera's target, and
        the camera orbits by ``-lighting``.
        """
        x, y, z = (float(value) for value in np.array(camera.target) - self._origin)
        orbit, turn = (pose.element, 0.0) if self.by_shaders else (pose.lighting, pose.element - pose.lighting)
        _place_camera(self.camera, replace(camera, target=(x, y, z)), orbit)
        angle = math.radians(turn)
        sine, cosine = math.sin(angle), math.cos(angle)
        self.root.rotation_euler = (0.0, 0.0, angle)
        self.root.location = (x - cosine * x + sine * y, y - sine * x - cosine * y, 0.0)

    def control(self, pose: Pose, seed: int, samples: int) -> None:
        """Tell our own shaders what changes from render to render, through the colour of the objects.

        A shader parameter would recompile the shader; an object's colour does not. Blender keeps its channels at 0 or
        above, hence the angle in [0, 2 pi).
        """
        if self.by_shaders:
            turn = math.radians((pose.lighting - pose.element) % 360.0)
            for item in self.objects:
                item.color = (turn, float(seed), float(samples), 1.0)


def _built_from(task: SceneTask) -> tuple[object, ...]:
    return task.asset, task.shaders, task.lights, task.resolution, task.sampling.bounces, task.device


def _add_asset(
    scene: Any, asset: Asset, materials: list[Any], attributes: set[AttributeBinding]
) -> tuple[Any, list[Any]]:
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
    return root, objects


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


def _place_camera(item: Any, camera: Camera, orbit: float) -> None:
    """Orbit by ``-orbit`` degrees; oriented by angles, not by looking at the target, so that poles are no exception."""
    lens = item.data
    lens.type = "PERSP"
    lens.sensor_fit = "HORIZONTAL"
    lens.lens_unit = "FOV"
    lens.angle = math.radians(camera.fov)
    lens.shift_x = lens.shift_y = 0.0
    lens.dof.use_dof = False
    lens.clip_start = camera.distance * 1e-3
    lens.clip_end = camera.distance * 1e3
    azimuth = math.radians(-90.0 - orbit)
    elevation = math.radians(camera.elevation)
    direction = (
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    )
    item.location = [t + camera.distance * d for t, d in zip(camera.target, direction, strict=True)]
    item.rotation_mode = "XYZ"
    item.rotation_euler = (math.pi / 2 - elevation, 0.0, azimuth + math.pi / 2)
