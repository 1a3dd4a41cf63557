"""A scene task as Blender data: materials, camera, and what changes from frame to frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from lookdev.asset.bounds import about_origin
from lookdev.asset.store import read_asset
from lookdev.codegen import NodeSource, PrincipledSource, ShaderSource, Source
from lookdev.cycles import engine
from lookdev.cycles.geometry import add_asset
from lookdev.cycles.lights import add_lights
from lookdev.cycles.nodes import Groups, build_material
from lookdev.cycles.principled import configure_as_users_do, principled_material, shade_by_normals
from lookdev.cycles.shaders import CAUGHT, RECORD, surface_material, varying_values
from lookdev.cycles.svm import check_stack
from lookdev.cycles.world import build_world
from lookdev.errors import RenderError
from lookdev.light import Stand, coded
from lookdev.light.native import still_domes, varied_domes, world_domes
from lookdev.rendering.task import SceneTask
from lookdev.scene import Camera, Pose

MATTE, ALBEDOS, NORMALS = 0.0625, 0.25, 0.5

_APART = {"uv", "cryptomatte"}
"""Passes for which every prim is an object, with all of its UV sets."""


class Scene:
    """The Blender data of a scene task, kept between its frames.

    Attributes
    ----------
    scene, root, camera
        Blender's scene, the empty that is the parent of the whole asset, and the camera.
    objects
        The objects that show the asset.
    names_of_objects
        Where the task has the paths of prims, these by the names of objects, one for each.
    lamps
        The lights that are objects: none where OSL shaders integrate the light.
    origin
        The place of the asset's world that is at 0.
    """

    def __init__(self, task: SceneTask, into: Any = None, groups: Groups | None = None, *, apart: bool = False) -> None:
        """Build a task's scene.

        Parameters
        ----------
        into
            The empty scene of Blender to build it in; None: a new one, after all data are deleted.
        groups
            Node groups to share with other scenes, as of `build_material`.
        apart
            As of `add_asset`.

        Raises
        ------
        RenderError
            Blender cannot show one of the sources, or this machine has no such device.
        """
        self.task = task
        self.scene = engine.empty_scene() if into is None else into
        self._groups: Groups = {} if groups is None else groups
        self._configure()
        self._asset = read_asset(task.asset.path)
        self._add_materials()
        # Blender's own BSDF reads no attribute by name, but the first UV set.
        self._apart = apart or self.by_user or not _APART.isdisjoint(task.sampling.passes)
        self.camera = self.scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        self.camera.cycles.use_motion_blur = False
        self.scene.collection.objects.link(self.camera)
        self._add_asset()
        # Those that have no dome's image stand about the asset: a task with another asset is another scene.
        self.lamps = [] if self.by_shaders else add_lights(self.scene.collection, task.lights, self.origin)
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

    @property
    def name_of_asset(self) -> str:
        """The name of the asset."""
        return self._asset.name

    @property
    def names_of_materials(self) -> dict[str, str]:
        """The names of looks by those of materials."""
        return {each.name: source.name for each, source in zip(self._materials, self.task.shaders, strict=True)}

    def _configure(self) -> None:
        task = self.task
        bounces = task.sampling.bounces
        if self.by_shaders:
            engine.configure(self.scene, task.resolution, bounces)
        elif self.by_portals:
            engine.configure_portals(self.scene, task.resolution, bounces, task.device)
            self.scene.world = build_world("light", task.lights, sampled=False, after_portals=True)
        else:
            see_through = any(each.see_through for each in task.shaders)
            engine.configure_closures(self.scene, task.resolution, bounces, task.device, see_through=see_through)
            # Sampling a constant light reduces no variance.
            sampled = self.by_user or varied_domes(task.lights)
            self.scene.world = build_world("light", task.lights, sampled=sampled)
        if self.by_user:
            configure_as_users_do(self.scene)
        if "uv" in task.sampling.passes:
            # From the first render on: meshes keep the attributes that they had then.
            self.scene.view_layers[0].use_pass_uv = True
        if not self.by_shaders:
            # A lamp that a ray passes counts as one of them, seen from either side where it is a mesh.
            self.scene.cycles.transparent_max_bounces += 2 * (len(task.lights) - len(world_domes(task.lights)))

    def _add_materials(self) -> None:
        self._materials = [self._material(number, source) for number, source in enumerate(self.task.shaders)]

    def _material(self, number: int, source: Source) -> Any:
        match source:
            case ShaderSource():
                x, y, z = self._asset.center
                stand = Stand((x, y, z), self.task.camera.pivot)
                return surface_material(source, number, self.task.lights_of(number), stand)
            case NodeSource():
                return build_material(source, self._groups)
            case PrincipledSource():
                return principled_material(source)
            case other:
                raise RenderError(f"look '{other.name}': Cycles has no material for a {type(other).__name__}")

    def _add_asset(self) -> None:
        task = self.task
        asset = self._asset
        # Cycles computes in float32, which is too coarse far from the origin.
        self.origin = np.array(asset.center)
        dressed = self.scene, about_origin(asset), task.shaders, task.worn, self._materials
        shown = add_asset(*dressed, groups=task.groups, apart=self._apart, covered=self.by_portals)
        self.root, self.objects = shown.root, shown.objects
        if task.sampling.recorded:
            # Closures that record reflect no ray of Cycles' own to another place of the asset.
            for item in bpy.data.objects:
                item.visible_diffuse = item.visible_glossy = item.visible_transmission = False
        if task.prims:
            paths = (path or asset.name for path in task.prims)
            self.names_of_objects = {item.name: path for item, path in zip(self.objects, paths, strict=True)}
        if self.by_user:
            shade_by_normals(shown)
        self._pass_constants()

    def _pass_constants(self) -> None:
        """Pass the constants of the looks that are not compiled into their shaders."""
        for number, source in enumerate(self.task.shaders):
            if isinstance(source, ShaderSource) and (values := varying_values(source, number)):
                for item in self.objects:
                    for name, value in values.items():
                        item[name] = value
                    item.update_tag()

    def fits(self, task: SceneTask) -> bool:
        """Return whether another task can be shown in this scene.

        Asset, camera and samples may differ, and where OSL shaders integrate the light, which are replaced, shaders and
        lights.
        """
        return _built_from(task) == _built_from(self.task)

    def show(self, task: SceneTask) -> None:
        """Show another task that fits, and delete the asset shown before where it is another one, in all scenes."""
        before, self.task = self.task, task
        made, wanted = _materials(before), _materials(task)
        if (_shown(task), wanted) != (_shown(before), made):
            data = bpy.data
            trees = [tree for tree in data.node_groups if tree.type == "GEOMETRY"]
            objects = [item for item in data.objects if item != self.camera]
            data.batch_remove([*objects, *data.meshes, *data.collections, *trees])
            self._asset = read_asset(task.asset.path)
            if wanted != made:
                data.batch_remove(data.materials)
                self._add_materials()
            self._add_asset()
        elif task.shaders != before.shaders:
            self._pass_constants()

    def compile_shaders(self) -> None:
        """Compile what frames of the task need, and read its images, as the first frame would."""
        pose = Pose(0.0, 0.0)
        self.pose(self.task.camera, pose)
        self.control(pose, seed=0, samples=1)
        engine.compile_shaders(self.scene)

    def pose(self, camera: Camera, pose: Pose) -> None:
        """Place asset and camera to show a pose, by location and Euler angles.

        OSL shaders rotate the light, and the asset never moves. A world is never rotated, as Cycles would build its
        importance map again: what is shown is rotated instead, by ``-lighting`` about the camera's axis. The asset is
        rotated by ``element - lighting``, the camera orbits by ``-lighting``, lamps that do not turn with the rig are
        rotated by ``-lighting``. Where the domes stand still, nothing is, and lamps that turn are rotated by
        ``lighting``.
        """
        camera = camera.moved(tuple(-self.origin))
        frame = self._frame(pose)
        orbit, turn = (pose.element, 0.0) if self.by_shaders else (frame, pose.element - frame)
        _place_camera(self.camera, camera.orbited(-orbit))
        (x, y), angle = camera.pivot, math.radians(turn)
        sine, cosine = math.sin(angle), math.cos(angle)
        self.root.rotation_euler = (0.0, 0.0, angle)
        self.root.location = (x - cosine * x + sine * y, y - sine * x - cosine * y, 0.0)
        for lamp in self.lamps:
            lamp.stand(pose.lighting, frame, camera.pivot)

    def turn_of_world(self, pose: Pose) -> float:
        """Return the degrees about the pivot from Blender's world to the one in which the asset turns."""
        return pose.element if self.by_shaders else self._frame(pose)

    def _frame(self, pose: Pose) -> float:
        return 0.0 if still_domes(self.task.lights) else pose.lighting

    def catch(self, part: int) -> None:
        """Let OSL shaders show a part of a frame with a shadow catcher (`lookdev.codegen.osl.catching`)."""
        for item in self.objects:
            item[CAUGHT] = (float(part), 0.0, 0.0)
            item.update_tag()

    def record(self, parts: Sequence[int]) -> None:
        """Let OSL shaders record at most three parts of their light, by their numbers in the template."""
        numbers = tuple(float(each) for each in (*parts, 0, 0, 0)[:3])
        for item in self.objects:
            if tuple(item.get(RECORD, ())) != numbers:
                item[RECORD] = numbers
                item.update_tag()

    def control(self, pose: Pose, seed: int, samples: float) -> None:
        """Pass the values that change from render to render to OSL shaders, by the colour of the objects.

        For `MATTE`, `ALBEDOS` or `NORMALS` in place of samples, shaders generated with features show these.

        Unlike a shader parameter, that does not recompile the shader. Channels are not negative: the angle is in
        [0, 2 pi). The fourth is the depth of the near clip, at which the camera's rays start.
        """
        if self.by_shaders:
            turn = math.radians((pose.lighting - pose.element) % 360.0)
            # A power of two leaves room for the turn of the lights that stand still while the asset turns.
            still = any(not light.emission.turns for light in self.task.lights)
            turned = samples * (1.0 + still * pose.element / 720.0)
            for item in self.objects:
                item.color = (turn, float(seed), turned, self.camera.data.clip_start)


def _built_from(task: SceneTask) -> tuple[object, ...]:
    by_shaders = isinstance(task.shaders[0], ShaderSource)
    fixed = "OSL" if by_shaders else (task.shaders, task.lights, task.lit, *_stand(task))
    return fixed, task.resolution, task.sampling.bounces, task.sampling.passes, task.device


def _shown(task: SceneTask) -> tuple[object, ...]:
    return task.asset, task.worn, task.groups, task.prims


def _materials(task: SceneTask) -> tuple[object, ...]:
    """Return what materials are made of, where they can be replaced."""
    ours = [(number, each) for number, each in enumerate(task.shaders) if isinstance(each, ShaderSource)]
    return *((each.program, task.lights_of(number)) for number, each in ours), *(_stand(task) if ours else ())


def _stand(task: SceneTask) -> tuple[object, ...]:
    # The shaders of a rig contain where its lights stand about the asset; lamps are objects.
    return () if coded(task.lights) else (task.asset, task.camera)


def _place_camera(item: Any, camera: Camera) -> None:
    """Place the camera as it stands at pose 0; oriented by angles, not by a target, so that poles are no exception."""
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
    # The matrix is Rz(90 + azimuth - 90) Rx(90 - elevation) Rz(roll); its first factor adds to the last Euler angle.
    tilt, roll = math.pi / 2 - math.radians(camera.elevation), math.radians(camera.roll)
    across, along = math.cos(tilt) * math.sin(roll), math.cos(roll)
    item.rotation_euler = (
        math.atan2(math.sin(tilt) * math.cos(roll), math.cos(tilt)),
        math.atan2(-math.sin(tilt) * math.sin(roll), math.hypot(across, along)),
        math.radians(camera.azimuth) + math.atan2(across, along),
    )
