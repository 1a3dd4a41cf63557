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
    """The Blender data of a scene task, kept between its frames.

    Attributes
    ----------
    scene, root, camera
        Blender's scene, the empty that is the parent of the whole asset, and the camera.
    objects
        The asset's instances.
    """

    def __init__(self, task: SceneTask, into: Any = None, groups: Groups | None = None) -> None:
        """Build a task's scene.

        Parameters
        ----------
        into
            The empty scene of Blender to build it in; None: a new one, after all data are deleted.
        groups
            Node groups to share with other scenes, as of `build_material`.

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
        # Cycles computes in float32, which is too coarse far from the origin.
        self._origin = np.array(asset.center)
        asset = about_origin(asset)
        attributes = {binding for source in task.shaders for binding in source.attributes}
        self.root, self.objects = _add_asset(self.scene, asset, self._materials(), attributes)
        self.camera = self.scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        self.scene.collection.objects.link(self.camera)
        if self.by_user:
            shade_by_normals(self.objects, asset)
        else:
            for item in self.objects:
                # Facets shadow themselves without smoothing.
                item.shadow_terminator_geometry_offset = item.shadow_terminator_shading_offset = 0.0
        if isinstance(task.shaders[0], NodeSource):
            check_stack(self.scene)

    @property
    def by_shaders(self) -> bool:
        """Whether OSL shaders integrate the light; otherwise a world lights the scene."""
        return isinstance(self.task.shaders[0], ShaderSource)

    @property
    def by_portals(self) -> bool:
        """Whether all light comes through ray portals, so that alpha is not the coverage."""
        source = self.task.shaders[0]
        return isinstance(source, NodeSource) and source.exact

    @property
    def by_user(self) -> bool:
        """Whether the settings are those of a user of Cycles: one render, no halves."""
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
            # Sampling a constant light reduces no variance.
            self.scene.world = build_world("light", task.light, sampled=self.by_user or not task.light.constant)
        if self.by_user:
            configure_as_users_do(self.scene)

    def _materials(self) -> list[Any]:
        """Return the material of each slot; slots that share a look share it."""
        made: list[tuple[Source, Any]] = []  # sources need not be hashable
        for source in self.task.shaders:
            if not any(other == source for other, _ in made):
                made.append((source, self._material(source)))
        return [next(material for other, material in made if other == source) for source in self.task.shaders]

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
        """Return whether frames of another task need no rebuild; camera and samples may differ."""
        return _built_from(task) == _built_from(self.task)

    def pose(self, camera: Camera, pose: Pose) -> None:
        """Place asset and camera to show a pose, by location and Euler angles.

        OSL shaders rotate the light, and the asset never moves. A world is never rotated, as Cycles would build its
        importance map again: the asset is rotated by ``element - lighting`` about the axis through the camera's target,
        and the camera orbits by ``-lighting``.
        """
        x, y, z = (float(value) for value in np.array(camera.target) - self._origin)
        orbit, turn = (pose.element, 0.0) if self.by_shaders else (pose.lighting, pose.element - pose.lighting)
        _place_camera(self.camera, replace(camera, target=(x, y, z)), orbit)
        angle = math.radians(turn)
        sine, cosine = math.sin(angle), math.cos(angle)
        self.root.rotation_euler = (0.0, 0.0, angle)
        self.root.location = (x - cosine * x + sine * y, y - sine * x - cosine * y, 0.0)

    def control(self, pose: Pose, seed: int, samples: int) -> None:
        """Pass the values that change from render to render to OSL shaders, by the colour of the objects.

        Unlike a shader parameter, that does not recompile the shader. Channels are not negative: the angle is in
        [0, 2 pi).
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
    # An object's own transform has no shear; the transform that it inherits is a matrix.
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

    The mesh of a single object is merged into the scene's, which any change of an object rebuilds: 40 ms for 260,000
    triangles, twice a frame. The second user is a speck far below, hidden from every kind of ray that contributes to a
    picture, but not from all rays: Cycles would leave it out.
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
    # Blender's own custom normals have 16 bits; attributes have 32.
    _add_attribute(data, "lookdev_normal", mesh.normals)
    _add_attribute(data, "lookdev_tangent", mesh.tangents)
    corners = len(mesh.corner_points)
    for binding in attributes:
        if binding.kind != "uv":
            values = handedness(mesh) if binding.attribute == HANDEDNESS else mesh.primvars.get(binding.attribute)
            if values is None:
                fallback = np.asarray(binding.fallback, dtype=np.float32)
                values = np.tile(fallback, (corners, 1)) if len(fallback) > 1 else np.full(corners, fallback[0])
            _add_attribute(data, binding.attribute, values)
    return data


def _add_attribute(data: Any, name: str, values: Any) -> None:
    # FLOAT_VECTOR for colours, too: no colour space applies to vectors.
    kind, field = ("FLOAT", "value") if values.ndim == 1 else ("FLOAT_VECTOR", "vector")
    attribute = data.attributes.new(name, kind, "CORNER")
    attribute.data.foreach_set(field, np.ascontiguousarray(values, dtype=np.float32).ravel())


def _place_camera(item: Any, camera: Camera, orbit: float) -> None:
    """Orbit by ``-orbit`` degrees; oriented by angles, not by a target, so that poles are no exception."""
    lens = item.data
    lens.type = "PERSP"
    lens.sensor_fit = "HORIZONTAL"
    lens.lens_unit = "FOV"
    lens.angle = math.radians(camera.fov)
    lens.shift_x = lens.shift_y = 0.0
    lens.dof.use_dof = False
    lens.clip_start, lens.clip_end = camera.distance * 1e-3, camera.distance * 1e3
    azimuth, elevation = math.radians(-90.0 - orbit), math.radians(camera.elevation)
    cosine = math.cos(elevation)
    direction = (cosine * math.cos(azimuth), cosine * math.sin(azimuth), math.sin(elevation))
    item.location = [t + camera.distance * d for t, d in zip(camera.target, direction, strict=True)]
    item.rotation_mode = "XYZ"
    item.rotation_euler = (math.pi / 2 - elevation, 0.0, azimuth + math.pi / 2)
