"""A scene as the page draws it: plain data, and the buffers that it names."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.codegen.glsl.functions import TABLE_WIDTH
from lookdev.codegen.glsl.look import LookFunctions, look_functions
from lookdev.codegen.glsl.rig import RIG_WIDTH, RigFunctions, rig_functions
from lookdev.codegen.program.look import Live, stated
from lookdev.light import Dome, Light, Stand, called, native
from lookdev.light.dome.files import read_exr
from lookdev.light.lamps import CodedRig
from lookdev.material import Bump, Look, Texture
from lookdev.material.textures import image_file
from lookdev.output.color import DisplayView
from lookdev.output.review.view import view_shader
from lookdev.scene import Camera, Scene
from lookdev.studio.viewport.buffers import Buffers
from lookdev.studio.viewport.geometry import WIDTH, Corners, corners_of
from lookdev.studio.viewport.shaders import behind_shader, develop_shader, look_shaders, vertex_shader

ALWAYS_LEFT_OUT = (
    "interreflection: light that other places of the asset reflect or transmit",
    "cast shadow: the asset occludes no light",
)
"""What no picture of the viewport shows."""

_LARGEST_HALF = 65504.0


@dataclass(frozen=True, eq=False)
class SceneView:
    """What the modules in ``static/`` draw: `data` is JSON, and `buffers` are the bytes that it names by digest."""

    data: Mapping[str, Any]
    buffers: Mapping[str, bytes]

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the picture leaves out, a sentence each."""
        return tuple(self.data["left_out"])


def sliders(look: Look) -> Live:
    """Return which constants of a look are uniforms, which change while nothing compiles: those that it states.

    What a look does not state folds: the shader of a look without sheen has no sheen, and takes a tenth of the time.
    """
    of_layers = stated(look)
    return lambda number, name: of_layers(number, name) or (name == "mask" and number > 0)


def view_scene(
    scene: Scene,
    *,
    view: DisplayView = DisplayView(),  # noqa: B008
    live: Callable[[Look], Live] = sliders,
    resolve: Callable[[Texture | Bump], Path] = image_file,
) -> SceneView:
    """Return a scene for the page, in a view of a display; `live` of each look and `resolve` as of `look_functions`.

    Raises
    ------
    AssetError
        Its asset is too large, or lacks what a look reads.
    TextureError
        An image is missing or unreadable.
    OutputError
        OpenColorIO has no such view.
    """
    buffers, shown_as = Buffers(), view_shader(view)
    looks = list({id(look): look for look in scene.looks}.values())
    numbers = {id(look): number for number, look in enumerate(looks)}
    worn = [numbers[id(look)] for look in scene.looks]
    functions = [look_functions(look, resolve, live(look)) for look in looks]
    order = sorted(range(len(worn)), key=lambda slot: (worn[slot], slot))
    bindings = [binding for each in functions for binding in each.attributes]
    corners = corners_of(scene.asset, order, bindings)
    shown, notes = _shown(scene.lights)
    places = {number: k for k, number in enumerate(shown)}
    lit = [[places[number] for number in each if number in places] for each in scene.lit_by]
    stand = Stand(scene.asset.center, scene.camera.pivot)
    rig = rig_functions([scene.lights[number] for number in shown], lit, stand)
    ranges = {each.slot: each for each in corners.ranges}
    parts = [
        {"path": slot.path, "look": worn[number], "first": ranges[number].first, "last": ranges[number].last}
        for number, slot in enumerate(scene.asset.slots)
    ]
    data = {
        "resolution": list(scene.film.resolution),
        "camera": _camera(scene.camera),
        "center": list(scene.asset.center),
        "radius": scene.asset.radius,
        "vertex": vertex_shader(),
        "corners": buffers.rows(corners.texels, WIDTH),
        "vertices": buffers.array(corners.vertices),
        "indices": buffers.array(corners.indices),
        "looks": [
            _look(look, each, rig, corners, buffers, [part for part in parts if part["look"] == number])
            for number, (look, each) in enumerate(zip(looks, functions, strict=True))
        ],
        "parts": parts,
        "rig": _rig(rig, buffers),
        "behind": behind_shader(rig),
        "develop": develop_shader(shown_as["glsl"]),
        "view": {"name": shown_as["name"], "textures": shown_as["textures"]},
        "left_out": [*ALWAYS_LEFT_OUT, *notes],
    }
    return SceneView(data, buffers.content)


def light_rows(scene: Scene) -> tuple[NDArray[np.float32], dict[int, str]]:
    """Return the numbers of a scene's lights, with which ``rig_numbers`` begins, and why which lights are not shown.

    Lights of other radiance have other numbers, and the same shaders.
    """
    left_out = {number: gap for number, light in enumerate(scene.lights) if (gap := native.gap_of_viewport(light))}
    shown = [light for number, light in enumerate(scene.lights) if number not in left_out]
    return CodedRig.of(shown).rows(Stand(scene.asset.center, scene.camera.pivot)), left_out


def _camera(camera: Camera) -> Mapping[str, Any]:
    lens = camera.lens
    return {
        "fov": camera.fov,
        "elevation": camera.elevation,
        "azimuth": camera.azimuth,
        "roll": camera.roll,
        "target": list(camera.target),
        "distance": camera.distance,
        "pivot": list(camera.pivot),
        "shift": list(camera.shift),
        "lens": None if lens is None else {"aperture": lens.aperture, "focus": lens.focus},
    }


def _shown(lights: Sequence[Light]) -> tuple[list[int], list[str]]:
    """Return the numbers of the lights that are shown, and a note on what of them and which others are not."""
    shown, notes = [], []
    for number, light in enumerate(lights):
        # What is cast as shadow is left out of all lights.
        if gap := native.gap_of_viewport(light):
            notes.append(f"{called(light, number + 1)}: it has {gap}")
        else:
            shown.append(number)
    return shown, notes


def _look(
    look: Look, functions: LookFunctions, rig: RigFunctions, corners: Corners, buffers: Buffers, parts: Sequence[Any]
) -> Mapping[str, Any]:
    shaders = look_shaders(functions, rig, corners)
    textures = dict(_textures(functions, buffers))
    for k, table in enumerate(functions.tables):
        values = np.load(table.path).astype(np.float32).ravel()
        textures[f"look_table{k}"] = buffers.rows(values, TABLE_WIDTH)
    return {
        "name": look.name,
        "visible": shaders.visible,
        "relight": shaders.relight,
        "see_through": functions.see_through,
        "numbers": {name: list(values) for name, values in functions.numbers.items()},
        "textures": textures,
        "first": min(part["first"] for part in parts),
        "last": max(part["last"] for part in parts),
    }


def _textures(functions: LookFunctions, buffers: Buffers) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the images of a look by their samplers: half floats where these suffice, but for slopes."""
    for each in functions.look_ups:
        for tile, file in each.files.items():
            texels = read_exr(file.path, "RGBA")
            if not each.slopes and np.abs(texels).max() <= _LARGEST_HALF:
                texels = texels.astype(np.float16)
            yield (f"look_{each.name}_{tile}" if tile else f"look_{each.name}"), buffers.texture(texels)


def _rig(rig: RigFunctions, buffers: Buffers) -> Mapping[str, Any]:
    textures = {"rig_numbers": buffers.rows(rig.numbers, RIG_WIDTH)}
    if rig.tables is not None:
        textures["rig_tables"] = buffers.rows(rig.tables, TABLE_WIDTH)
    for k, dome in enumerate(rig.domes):
        if not dome.constant:
            textures |= {f"dome{k}_{name}": buffers.texture(each) for name, each in _dome(dome).items()}
    return {"textures": textures}


def _dome(dome: Dome) -> Mapping[str, NDArray[Any]]:
    assert dome.points_file and dome.slots_file  # noqa: PT018
    radiance = np.zeros((dome.height, dome.width, 4), np.float32)
    radiance[..., :3] = read_exr(dome.radiance_file.path, "RGB")
    return {
        "map": radiance,
        "points": read_exr(dome.points_file.path, "RGBA"),
        "slots": np.load(dome.slots_file.path),
    }
