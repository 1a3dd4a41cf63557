"""Builds a scene task as Blender data: materials, asset, camera and lights, and sets values that vary between frames.

A source is the generated OSL, or the shader nodes, of a look. OSL shaders integrate the light themselves, so their
scenes have no lights of Blender. In scenes with nodes, domes become a world, and other lights, lamps, become objects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import bpy
import numpy as np

from lookdev.asset.bounds import center_asset
from lookdev.asset.store import read_asset
from lookdev.codegen.source import GeneratedSource, NodeSource, PrincipledSource, ShaderSource
from lookdev.cycles import engine
from lookdev.cycles.geometry import add_asset
from lookdev.cycles.lights import add_lights
from lookdev.cycles.nodes import Groups, build_material
from lookdev.cycles.principled import build_principled_material, configure_user_defaults, set_blender_normals
from lookdev.cycles.shaders import CAUGHT_PROPERTY, RECORD_PROPERTY, build_surface_material, varying_values
from lookdev.cycles.streams import check_svm_stack
from lookdev.cycles.world import build_world
from lookdev.errors import RenderError
from lookdev.light import RigOrigin, coded_light
from lookdev.light.native import are_domes_still, has_varied_dome, world_domes
from lookdev.rendering.task import SceneTask
from lookdev.scene import Camera, Pose

MATTE, ALBEDOS, NORMALS = 0.0625, 0.25, 0.5
"""Values below 1 of `samples` in `BlenderScene.set_controls`: OSL shaders then show a feature in place of the light.

`ALBEDOS` shows albedos, `NORMALS` shows normals, and `MATTE` shows white, which is enough for cryptomattes."""

_SEPARATE = {"uv", "cryptomatte"}
"""The passes for which every prim must be an object, with all of its UV sets."""


class BlenderScene:
    """The Blender data of a scene task, for all of its frames.

    Attributes
    ----------
    task
        The scene task that is shown.
    scene, root, camera
        Blender's scene, the empty that is the parent of the whole asset, and the camera.
    objects
        The objects that show the asset.
    prim_paths
        The USD path of each object's prim, by the name of the object. It is only set if the task has these paths.
    lamps
        The lights that are objects. If OSL shaders integrate the light, there are none.
    origin
        The point of the asset's world that is at 0 in Blender's scene: the centre of the asset.
    """

    def __init__(
        self,
        task: SceneTask,
        into: bpy.types.Scene | None = None,
        groups: Groups | None = None,
        *,
        separate: bool = False,
    ) -> None:
        """Build a task's scene.

        Parameters
        ----------
        into
            An empty scene of Blender, to which the data are added. If it is None, all data in Blender are deleted, and
            a scene is created.
        groups
            Node groups to share with other scenes: `shared_groups` of `build_material`.
        separate
            As in `add_asset`.

        Raises
        ------
        RenderError
            Blender cannot show one of the sources, or this machine lacks the device.
        """
        self.task = task
        self.scene = engine.empty_scene() if into is None else into
        self._groups: Groups = {} if groups is None else groups
        self._configure()
        self._asset = read_asset(task.asset.path)
        self._add_materials()
        # Blender's Principled BSDF reads the first UV set, not an attribute by its name. So meshes need their UV sets.
        self._separate = separate or self.is_principled or not _SEPARATE.isdisjoint(task.sampling.passes)
        self.camera = self.scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        self.camera.cycles.use_motion_blur = False
        self.scene.collection.objects.link(self.camera)
        self._add_asset()
        # Lamps are placed relative to the asset, so a task with another asset needs another scene (`_scene_key`).
        self.lamps = [] if self.is_osl else add_lights(self.scene.collection, task.lights, self.origin)
        if isinstance(task.shaders[0], NodeSource):
            check_svm_stack(self.scene)

    @property
    def is_osl(self) -> bool:
        """Whether OSL shaders integrate the light. Otherwise a world and lamps illuminate the scene."""
        return isinstance(self.task.shaders[0], ShaderSource)

    @property
    def has_portals(self) -> bool:
        """Whether all light comes through ray portals, so that alpha is not the coverage."""
        source = self.task.shaders[0]
        return isinstance(source, NodeSource) and source.exact

    @property
    def is_principled(self) -> bool:
        """Whether looks are Principled BSDFs, rendered as by a user of Cycles: in one render, without halves."""
        return isinstance(self.task.shaders[0], PrincipledSource)

    @property
    def asset_name(self) -> str:
        """The name of the asset."""
        return self._asset.name

    @property
    def look_names(self) -> dict[str, str]:
        """The names of looks, by the names of their materials in Blender."""
        return {material.name: source.name for material, source in zip(self._materials, self.task.shaders, strict=True)}

    def _configure(self) -> None:
        """Set the settings of Cycles, and build the world."""
        task = self.task
        bounces = task.sampling.bounces
        if self.is_osl:
            engine.configure_osl(self.scene, task.resolution, bounces)
        elif self.has_portals:
            engine.configure_portals(self.scene, task.resolution, bounces, task.device)
            self.scene.world = build_world("light", task.lights, sampled=False, after_portals=True)
        else:
            see_through = any(source.see_through for source in task.shaders)
            engine.configure_closures(self.scene, task.resolution, bounces, task.device, see_through=see_through)
            # To sample directions of a constant light would not reduce the variance.
            sampled = self.is_principled or has_varied_dome(task.lights)
            self.scene.world = build_world("light", task.lights, sampled=sampled)
        if self.is_principled:
            configure_user_defaults(self.scene)
        if "uv" in task.sampling.passes:
            # The pass is on before the first render, because meshes keep the attributes that they have in that render.
            self.scene.view_layers[0].use_pass_uv = True
        if not self.is_osl:
            # Each lamp that a ray passes counts as a transparent bounce. A lamp that is a mesh counts twice: a ray
            # passes both of its sides.
            self.scene.cycles.transparent_max_bounces += 2 * (len(task.lights) - len(world_domes(task.lights)))

    def _add_materials(self) -> None:
        """Build the material of each source."""
        self._materials = [self._build_material(number, source) for number, source in enumerate(self.task.shaders)]

    def _build_material(self, number: int, source: GeneratedSource) -> bpy.types.Material:
        """Build the material of a source; `number` is its index among the task's sources."""
        match source:
            case ShaderSource():
                x, y, z = self._asset.center
                rig_origin = RigOrigin((x, y, z), self.task.camera.pivot)
                return build_surface_material(source, number, self.task.lights_of_shader(number), rig_origin)
            case NodeSource():
                return build_material(source, self._groups)
            case PrincipledSource():
                return build_principled_material(source)
            case other:
                raise RenderError(f"look '{other.name}': Cycles has no material for a {type(other).__name__}")

    def _add_asset(self) -> None:
        """Add the asset, with its centre at 0, and set the constants of looks."""
        task = self.task
        asset = self._asset
        # Cycles computes in float32, which is too coarse far from the origin.
        self.origin = np.array(asset.center)
        assigned = self.scene, center_asset(asset), task.shaders, task.slot_shaders, self._materials
        added = add_asset(*assigned, groups=task.groups, separate=self._separate, add_uv=self.has_portals)
        self.root, self.objects = added.root, added.objects
        if task.sampling.records_parts:
            # Shaders record light by closures of Cycles, whose rays must not hit another point of the asset.
            for item in bpy.data.objects:
                item.visible_diffuse = item.visible_glossy = item.visible_transmission = False
        if task.prims:
            paths = (path or asset.name for path in task.prims)
            self.prim_paths = {item.name: path for item, path in zip(self.objects, paths, strict=True)}
        if self.is_principled:
            set_blender_normals(added)
        self._set_constants()

    def _set_constants(self) -> None:
        """Set the constants of looks that are not compiled into their shaders, as properties of the objects."""
        for number, source in enumerate(self.task.shaders):
            if isinstance(source, ShaderSource):
                self._set_properties(varying_values(source, number))

    def _set_properties(self, values: Mapping[str, tuple[float, ...]]) -> None:
        """Set custom properties of the objects where their values change. Cycles then reads them anew."""
        for item in self.objects:
            changed = {name: value for name, value in values.items() if tuple(item.get(name, ())) != value}
            for name, value in changed.items():
                item[name] = value
            if changed:
                item.update_tag()

    def can_show(self, task: SceneTask) -> bool:
        """Return whether `show` can change this scene to another task.

        Asset, camera and samples may differ. If OSL shaders integrate the light, shaders and lights may differ, too,
        because `show` replaces the materials.
        """
        return _scene_key(task) == _scene_key(self.task)

    def show(self, task: SceneTask) -> None:
        """Change the scene to another task that `can_show` accepts.

        If asset or materials differ, all objects in Blender's data except the camera are replaced.
        """
        before, self.task = self.task, task
        old_materials, new_materials = _material_key(before), _material_key(task)
        if (_asset_key(task), new_materials) != (_asset_key(before), old_materials):
            data = bpy.data
            trees = [tree for tree in data.node_groups if tree.type == "GEOMETRY"]
            objects = [item for item in data.objects if item != self.camera]
            data.batch_remove([*objects, *data.meshes, *data.collections, *trees])
            self._asset = read_asset(task.asset.path)
            if new_materials != old_materials:
                data.batch_remove(data.materials)
                self._add_materials()
            self._add_asset()
        elif task.shaders != before.shaders:
            self._set_constants()

    def compile_shaders(self) -> None:
        """Compile the shaders of the task and read its images, so that the first frame starts sooner."""
        pose = Pose(0.0, 0.0)
        self.pose(self.task.camera, pose)
        self.set_controls(pose, seed=0, samples=1)
        engine.compile_shaders(self.scene)

    def pose(self, camera: Camera, pose: Pose) -> None:
        """Set the transforms of asset, camera and lamps for a pose, as locations and Euler angles.

        With OSL shaders, the asset never moves. The shaders rotate the light, and the camera orbits by ``-element``.

        In other scenes, the world is never rotated, because Cycles would build its importance map again. If domes turn
        with the rig, everything else is rotated by ``-lighting`` about the camera's pivot instead. The asset is then
        rotated by ``element - lighting``. The camera, and lamps that do not turn with the rig, are rotated by
        ``-lighting``. If domes do not turn, the asset is rotated by ``element``, lamps that turn with the rig are
        rotated by ``lighting``, and nothing else is rotated.
        """
        camera = camera.move(tuple(-self.origin))
        frame = self._frame_turn(pose)
        orbit, turn = (pose.element, 0.0) if self.is_osl else (frame, pose.element - frame)
        _set_camera(self.camera, camera.orbit(-orbit))
        (x, y), angle = camera.pivot, math.radians(turn)
        sine, cosine = math.sin(angle), math.cos(angle)
        self.root.rotation_euler = (0.0, 0.0, angle)
        self.root.location = (x - cosine * x + sine * y, y - sine * x - cosine * y, 0.0)
        for lamp in self.lamps:
            lamp.pose(pose.lighting, frame, camera.pivot)

    def world_turn(self, pose: Pose) -> float:
        """Return the rotation about the pivot, in degrees, from Blender's scene to the world where the asset turns."""
        return pose.element if self.is_osl else self._frame_turn(pose)

    def _frame_turn(self, pose: Pose) -> float:
        """Return the angle in degrees: in a pose, everything except the world is turned backwards by this angle."""
        return 0.0 if are_domes_still(self.task.lights) else pose.lighting

    def select_catcher_part(self, part: int) -> None:
        """Make OSL shaders show one of the three renders of a shadow catcher (`lookdev.codegen.osl.catching`)."""
        self._set_properties({CAUGHT_PROPERTY: (float(part), 0.0, 0.0)})

    def select_recorded_parts(self, parts: Sequence[int]) -> None:
        """Make OSL shaders record at most three parts of their light, by the numbers that the shaders give to parts."""
        self._set_properties({RECORD_PROPERTY: tuple(float(part) for part in (*parts, 0, 0, 0)[:3])})

    def set_controls(self, pose: Pose, seed: int, samples: float) -> None:
        """Pass values that change from render to render to OSL shaders, as the colour of the objects.

        A new colour does not recompile a shader; a new value of a shader parameter would. If `samples` is `MATTE`,
        `ALBEDOS` or `NORMALS`, the shaders show this feature in place of light.

        The channels are the angle of the light, the seed, the samples, and the depth of the near clip, where rays of
        the camera start. A channel cannot be negative, so the angle is in [0, 2 pi).
        """
        if self.is_osl:
            turn = math.radians((pose.lighting - pose.element) % 360.0)
            # The number of samples is a power of two. The lower bits of its channel encode the angle of the asset. By
            # this angle, the shaders rotate the lights that do not turn with the rig.
            has_still = any(not light.emission.turns for light in self.task.lights)
            samples_and_turn = samples * (1.0 + has_still * pose.element / 720.0)
            for item in self.objects:
                item.color = (turn, float(seed), samples_and_turn, self.camera.data.clip_start)


def _scene_key(task: SceneTask) -> tuple[object, ...]:
    """Return the values of a task that a scene is built from and that `show` cannot replace."""
    is_osl = isinstance(task.shaders[0], ShaderSource)
    fixed = "OSL" if is_osl else (task.shaders, task.lights, task.shader_lights, *_placement_key(task))
    return fixed, task.resolution, task.sampling.bounces, task.sampling.passes, task.device


def _asset_key(task: SceneTask) -> tuple[object, ...]:
    """Return the values of a task from which the objects of the asset are built."""
    return task.asset, task.slot_shaders, task.groups, task.prims


def _material_key(task: SceneTask) -> tuple[object, ...]:
    """Return the values of a task from which materials of OSL shaders are built; `show` can replace these materials."""
    osl_sources = [(number, source) for number, source in enumerate(task.shaders) if isinstance(source, ShaderSource)]
    placement = _placement_key(task) if osl_sources else ()
    return *((source.program, task.lights_of_shader(number)) for number, source in osl_sources), *placement


def _placement_key(task: SceneTask) -> tuple[object, ...]:
    """Return the values of a task that determine the positions of lights relative to the asset.

    Shaders of a rig have these positions compiled in, and the objects of lamps have them. A single dome has none.
    """
    return () if coded_light(task.lights) else (task.asset, task.camera)


def _set_camera(item: bpy.types.Object, camera: Camera) -> None:
    """Set the lens, location and angles of a camera. Angles, unlike a target point, need no exception at the poles."""
    lens = item.data
    lens.type = "PERSP"
    lens.sensor_fit = "HORIZONTAL"
    lens.lens_unit = "FOV"
    lens.angle = math.radians(camera.fov)
    lens.shift_x, lens.shift_y = camera.shift
    lens.clip_start, lens.clip_end = camera.clip
    lens.dof.use_dof = camera.lens is not None
    if camera.lens is not None:
        lens.dof.focus_distance = camera.lens.focus
        lens.dof.aperture_blades, lens.dof.aperture_ratio = 0, 1.0
        lens.dof.aperture_fstop = 1e-3 * lens.lens / camera.lens.aperture
    item.location = camera.position.tolist()
    item.rotation_mode = "XYZ"
    # The rotation is Rz(azimuth) Rx(90° - elevation) Rz(roll). Its first factor adds to the last Euler angle.
    tilt, roll = math.pi / 2 - math.radians(camera.elevation), math.radians(camera.roll)
    across, along = math.cos(tilt) * math.sin(roll), math.cos(roll)
    item.rotation_euler = (
        math.atan2(math.sin(tilt) * math.cos(roll), math.cos(tilt)),
        math.atan2(-math.sin(tilt) * math.sin(roll), math.hypot(across, along)),
        math.radians(camera.azimuth) + math.atan2(across, along),
    )
