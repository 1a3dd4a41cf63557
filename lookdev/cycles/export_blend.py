"""A job as a .blend: each look a scene, each rig a world and a collection, each turntable a range of the timeline.

Scenes are built as for rendering; then names, keys and settings become those that an artist expects. Each scene has
meshes of its own: with materials of objects, Cycles would keep no mesh as an instance, and round differently.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from lookdev.cycles import version
from lookdev.cycles.lights import add_lights
from lookdev.cycles.nodes import Groups
from lookdev.cycles.scene import Scene
from lookdev.cycles.timeline import animate, follow, mark
from lookdev.cycles.world import build_world
from lookdev.errors import LookdevError, RenderError
from lookdev.light.native import varied_domes
from lookdev.rendering.blend import BLEND_TASK, BlendTask
from lookdev.rendering.task import SceneTask

_VIEWS = {"ACES 1.0 - SDR Video": ("ACES 1.3", "AgX"), "Un-tone-mapped": ("Standard",), "Raw": ("Raw",)}
"""Blender's names of views of a job; the first one that Blender has is used."""

_PLAIN = "Standard"
"""What shows any other view: without a tone curve, as 'lookdev' shows all that is not bright."""


def export_file(request: Path) -> dict[str, Any]:
    """Write the .blend of a file with a `BlendTask`; return `notes` for the user, or the `error`."""
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
        Blender cannot show one of the looks, or reads an image that the task lacks.
    """
    groups: Groups = {}
    scenes: dict[str, Scene] = {}
    for look, scene in task.scenes.items():
        into = bpy.data.scenes.new(look) if scenes else None
        # The file may be rendered on another machine, with the job's device.
        scenes[look] = Scene(replace(scene, device="cpu"), into, groups, apart=True)
    animated: list[Scene] = []
    rigs: dict[int, list[Any]] = {}
    for each in scenes.values():
        like = next((other for other in animated if other.task.camera == each.task.camera), None)
        _remove_lamps(each)
        if like is None:
            rigs[id(each)] = _add_rigs(task, each)
            moved = {"asset": each.root, "camera": each.camera} | {_key(lamp.item): lamp.item for lamp in each.lamps}
            animate(moved, task.turntables, partial(each.pose, each.task.camera))
            animated.append(each)
        else:
            _share_camera(like, each)
            each.pose(each.task.camera, task.turntables[-1].poses[-1])  # channels that do not move have no keys
            follow(each.root, like.root)
        _show_first(rigs[id(like or each)], each.scene)
    world = _add_worlds(task)
    views = set()
    for look, each in scenes.items():
        each.scene.name = each.root.name = look
        bpy.data.worlds.remove(each.scene.world)
        each.scene.world = world
        _set_up(each.scene, task.scenes[look], task)
        views.add(_set_view(each.scene, task.view))
        mark(each.scene, task.turntables)
        each.scene.view_layers[0].objects.active = each.objects[0]
    _place_images(task)
    _open_with(animated[0].scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(task.file), compress=True, relative_remap=False)
    unlike = sorted(views - {_names_of(task.view)[0]})
    return [f"Blender {version.VERSION} has no view '{task.view}': the file is shown by '{view}'" for view in unlike]


def _share_camera(first: Scene, other: Scene) -> None:
    lens = other.camera.data
    bpy.data.objects.remove(other.camera)
    bpy.data.cameras.remove(lens)
    other.camera = other.scene.camera = first.camera
    other.scene.collection.objects.link(first.camera)


def _key(item: Any) -> str:
    """Return the name of an object's curves: names of objects are unique."""
    return f"light {item.name}"


def _remove_lamps(shown: Scene) -> None:
    """Remove the lamps of a scene, with their data."""
    for lamp in shown.lamps:
        data = lamp.item.data
        bpy.data.objects.remove(lamp.item)
        bpy.data.batch_remove([data])
    shown.lamps = []


def _add_rigs(task: BlendTask, shown: Scene) -> list[Any]:
    """Make a collection of the lamps of each rig; those of a rig without lamps are empty."""
    collections = []
    for rig in task.rigs:
        collections.append(bpy.data.collections.new(f"rig {rig.name}"))
        lamps = add_lights(collections[-1], rig.lights, shown.origin, rig.strength)
        shown.lamps += [replace(lamp, offset=rig.turn) for lamp in lamps]
    return collections


def _show_first(rigs: Sequence[Any], scene: Any) -> None:
    """Put rigs that have lamps into a scene, of which the view layer has the first rig's alone."""
    for number, rig in enumerate(rigs):
        if rig.objects:
            scene.collection.children.link(rig)
            scene.view_layers[0].layer_collection.children[rig.name].exclude = number > 0


def _add_worlds(task: BlendTask) -> Any:
    """Add the world of every rig; return the first."""
    worlds = []
    for each in task.rigs:
        sampled = varied_domes(each.lights)
        worlds.append(build_world(each.name, each.lights, sampled=sampled, strength=each.strength, turn=each.turn))
        worlds[-1].use_fake_user = True
    return worlds[0]


def _set_up(scene: Any, shown: SceneTask, task: BlendTask) -> None:
    """Set what only a render by hand needs: Cycles itself, samples, device, frame rate."""
    render, settings = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.use_compositing = render.use_sequencer = True
    render.film_transparent = not task.show_light
    render.filepath = f"//{scene.name}/"
    render.fps, render.fps_base = 24, 1.0
    settings.samples, settings.use_sample_subset = shown.sampling.samples, False
    settings.seed = shown.sampling.seed
    settings.device = "CPU" if shown.device == "cpu" else "GPU"


def _set_view(scene: Any, view: str) -> str:
    """Set the view that is nearest to a job's, without other adjustments; return its name."""
    scene.display_settings.display_device = "sRGB"
    settings = scene.view_settings
    settings.look = "None"
    settings.exposure, settings.gamma = 0.0, 1.0
    for name in _names_of(view):
        with suppress(TypeError):  # Blender has no such view
            settings.view_transform = name
            return name
    raise RenderError(f"Blender {version.VERSION} has none of the views {', '.join(_names_of(view))}")


def _names_of(view: str) -> tuple[str, ...]:
    return _VIEWS.get(view, (view, _PLAIN))


def _place_images(task: BlendTask) -> None:
    """Pack images, or address them beside the .blend."""
    paths = {each.content.path: each.path for each in task.images}
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


def _open_with(scene: Any) -> None:
    """Show a scene through its camera in the workspace of the shader editor."""
    window = bpy.context.window_manager.windows[0]
    window.scene = scene
    window.workspace = bpy.data.workspaces["Shading"]
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D":
                area.spaces.active.region_3d.view_perspective = "CAMERA"
