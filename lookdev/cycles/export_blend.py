"""Writes a job as a .blend file, for `lookdev export blend`.

A look becomes a scene. A rig becomes a world and a collection of lamps. A turntable becomes a range of the timeline.
Scenes are built as for rendering. Then they get the names, keyframes and settings that an artist expects.

Scenes do not share meshes. With shared meshes, materials would belong to objects, and Cycles would not keep meshes as
instances, which changes the rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import bpy

from lookdev.cycles import version
from lookdev.cycles.lights import add_lights
from lookdev.cycles.nodes import Groups
from lookdev.cycles.scene import BlenderScene
from lookdev.cycles.timeline import animate, mark_turntables, share_animation
from lookdev.cycles.world import build_world
from lookdev.errors import LookdevError, RenderError
from lookdev.light.native import has_varied_dome
from lookdev.rendering.blend import BLEND_TASK, BlendTask
from lookdev.rendering.task import SceneTask

_VIEWS = {"ACES 1.0 - SDR Video": ("ACES 1.3", "AgX"), "Un-tone-mapped": ("Standard",), "Raw": ("Raw",)}
"""Blender's views for each view of a job, in order of preference. The first view that this Blender has is used."""

_DEFAULT_VIEW = "Standard"
"""Blender's view for any other view of a job. It has no tone curve, like view 'lookdev' below its highlights."""


def export_file(request: Path) -> dict[str, object]:
    """Write the .blend of a `BlendTask`, which is in a JSON file; return ``notes`` for the user, or an ``error``."""
    try:
        return {"notes": write_blend(BLEND_TASK.validate_json(request.read_bytes()))}
    except LookdevError as error:
        return {"error": str(error)}
    except (RuntimeError, OSError, MemoryError) as error:
        return {"error": f"{type(error).__name__}: {error}"}


def write_blend(task: BlendTask) -> list[str]:
    """Write a .blend; return notes for the user.

    Raises
    ------
    RenderError
        Blender cannot show one of the looks, or a scene reads an image that is not in the task.
    """
    groups: Groups = {}
    scenes: dict[str, BlenderScene] = {}
    for look, scene_task in task.scenes.items():
        into = bpy.data.scenes.new(look) if scenes else None
        # The scene is built for the CPU, because this machine may lack the job's device. At the end,
        # `_set_render_settings` sets the job's device.
        scenes[look] = BlenderScene(replace(scene_task, device="cpu"), into, groups, separate=True)
    # Scenes with equal cameras share the camera, the lamps and the keyframes of the first of them, their leader.
    animated: list[BlenderScene] = []
    rigs: dict[int, list[bpy.types.Collection]] = {}  # the collections of lamps of each rig, by the id of a leader
    for scene in scenes.values():
        leader = next((other for other in animated if other.task.camera == scene.task.camera), None)
        _remove_lamps(scene)
        if leader is None:
            rigs[id(scene)] = _add_rigs(task, scene)
            moving = {"asset": scene.root, "camera": scene.camera}
            moving |= {_curves_name(lamp.item): lamp.item for lamp in scene.lamps}
            animate(moving, task.turntables, partial(scene.pose, scene.task.camera))
            animated.append(scene)
        else:
            _share_camera(leader, scene)
            # Channels that are constant in the animation have no keys, so they are set here.
            scene.pose(scene.task.camera, task.turntables[-1].poses[-1])
            share_animation(scene.root, leader.root)
        _link_rigs(rigs[id(leader or scene)], scene.scene)
    world = _add_worlds(task)
    views = set()
    for look, scene in scenes.items():
        scene.scene.name = scene.root.name = look
        bpy.data.worlds.remove(scene.scene.world)
        scene.scene.world = world
        _set_render_settings(scene.scene, task.scenes[look], task)
        views.add(_set_view(scene.scene, task.view))
        mark_turntables(scene.scene, task.turntables)
        scene.scene.view_layers[0].objects.active = scene.objects[0]
    _set_image_paths(task)
    _set_startup_scene(animated[0].scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(task.file), compress=True, relative_remap=False)
    others = sorted(views - {_view_candidates(task.view)[0]})
    return [f"Blender {version.VERSION} has no view '{task.view}': the file is shown by '{view}'" for view in others]


def _share_camera(first: BlenderScene, other: BlenderScene) -> None:
    """Replace the camera of the scene `other` by the animated camera of the scene `first`."""
    lens = other.camera.data
    bpy.data.objects.remove(other.camera)
    bpy.data.cameras.remove(lens)
    other.camera = other.scene.camera = first.camera
    other.scene.collection.objects.link(first.camera)


def _curves_name(item: bpy.types.Object) -> str:
    """Return the name for a lamp's animation curves, which is as unique as the name of its object."""
    return f"light {item.name}"


def _remove_lamps(scene: BlenderScene) -> None:
    """Remove the lamps of a scene and their data."""
    for lamp in scene.lamps:
        data = lamp.item.data
        bpy.data.objects.remove(lamp.item)
        bpy.data.batch_remove([data])
    scene.lamps = []


def _add_rigs(task: BlendTask, scene: BlenderScene) -> list[bpy.types.Collection]:
    """Add a collection with the lamps of each rig, even for a rig without lamps, and return the collections."""
    collections = []
    for rig in task.rigs:
        collections.append(bpy.data.collections.new(f"rig {rig.name}"))
        lamps = add_lights(collections[-1], rig.lights, scene.origin, rig.strength)
        scene.lamps += [replace(lamp, offset=rig.turn) for lamp in lamps]
    return collections


def _link_rigs(rigs: Sequence[bpy.types.Collection], scene: bpy.types.Scene) -> None:
    """Link the collections of rigs that are not empty into a scene; its view layer excludes all but the first rig."""
    for number, rig in enumerate(rigs):
        if rig.objects:
            scene.collection.children.link(rig)
            scene.view_layers[0].layer_collection.children[rig.name].exclude = number > 0


def _add_worlds(task: BlendTask) -> bpy.types.World:
    """Add a world for every rig, with its domes; return the first."""
    worlds = []
    for rig in task.rigs:
        sampled = has_varied_dome(rig.lights)
        worlds.append(build_world(rig.name, rig.lights, sampled=sampled, strength=rig.strength, turn=rig.turn))
        worlds[-1].use_fake_user = True
    return worlds[0]


def _set_render_settings(scene: bpy.types.Scene, scene_task: SceneTask, task: BlendTask) -> None:
    """Set what a render by a user also needs: Cycles as the engine, samples, device and frame rate."""
    render, settings = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.use_compositing = render.use_sequencer = True
    render.film_transparent = not task.show_light
    render.filepath = f"//{scene.name}/"
    render.fps, render.fps_base = 24, 1.0
    settings.samples, settings.use_sample_subset = scene_task.sampling.samples, False
    settings.seed = scene_task.sampling.seed
    settings.device = "CPU" if scene_task.device == "cpu" else "GPU"


def _set_view(scene: bpy.types.Scene, view: str) -> str:
    """Set the view of Blender that is nearest to a view of a job, without other adjustments; return its name."""
    scene.display_settings.display_device = "sRGB"
    settings = scene.view_settings
    settings.look = "None"
    settings.exposure, settings.gamma = 0.0, 1.0
    for name in _view_candidates(view):
        with suppress(TypeError):  # Blender has no such view
            settings.view_transform = name
            return name
    raise RenderError(f"Blender {version.VERSION} has none of the views {', '.join(_view_candidates(view))}")


def _view_candidates(view: str) -> tuple[str, ...]:
    """Return Blender's views for a view of a job, in order of preference."""
    return _VIEWS.get(view, (view, _DEFAULT_VIEW))


def _set_image_paths(task: BlendTask) -> None:
    """Pack the images into the .blend if the task asks for it; in any case, set their paths relative to the .blend."""
    paths = {task_image.content.path: task_image.path for task_image in task.images}
    for image in list(bpy.data.images):  # renaming reorders Blender's list
        if image.source != "FILE":
            continue
        path = paths.get(Path(image.filepath))
        if path is None:
            raise RenderError(f"{image.filepath}: the scene reads an image that the task lacks")
        if task.pack:
            image.pack()
        image.name = Path(path).name
        image.filepath = f"//{path}"
        for packed in image.packed_files:
            packed.filepath = image.filepath


def _set_startup_scene(scene: bpy.types.Scene) -> None:
    """Make the file open with a scene, seen through its camera, in the workspace of the shader editor."""
    window = bpy.context.window_manager.windows[0]
    window.scene = scene
    window.workspace = bpy.data.workspaces["Shading"]
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D":
                area.spaces.active.region_3d.view_perspective = "CAMERA"
