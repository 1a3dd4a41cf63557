"""A scene as the page draws it: plain data, and the buffers that it names."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.cache import Content
from lookdev.codegen.glsl.functions import TABLE_WIDTH
from lookdev.codegen.glsl.look import LookFunctions, look_functions
from lookdev.codegen.glsl.rig import RIG_WIDTH, RigFunctions, rig_functions
from lookdev.codegen.program.look import Live, stated
from lookdev.light import Dome, Stand
from lookdev.light.dome.files import read_exr
from lookdev.light.lamps import CodedRig
from lookdev.material import Bump, Look, Texture
from lookdev.material.textures import image_file
from lookdev.output.color import DisplayView
from lookdev.output.review.view import view_shader
from lookdev.scene import Camera, Scene
from lookdev.studio.viewport.buffers import Buffers
from lookdev.studio.viewport.geometry import WIDTH, corners_of
from lookdev.studio.viewport.shaders import (
    LookShaders,
    Shadows,
    behind_shader,
    develop_shader,
    look_shaders,
    vertex_shader,
)

INTERREFLECTION = "interreflection: light that other places of the asset reflect or transmit"
"""What no picture of the viewport shows."""

_HOLES = "light through holes: a surface that is present in part casts a whole shadow"

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
    stand = Stand(scene.asset.center, scene.camera.pivot)
    rig = rig_functions(scene.lights, scene.lit_by, stand, scene.grouped)
    functions = [look_functions(look, resolve, live(look), split=rig.split) for look in looks]
    order = tuple(sorted(range(len(worn)), key=lambda slot: (worn[slot], slot)))
    bindings = tuple(binding for each in functions for binding in each.attributes)
    shadows = [Shadows.of(scene.asset, each, rig) for each in functions]
    corners = corners_of(scene.asset, order, bindings, occluding=Shadows.TRACED in shadows)
    holes = [_HOLES] * any(each.see_through for each in functions)
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
            _look(
                look,
                each,
                look_shaders(each, rig, corners, shadows[number], scene.asset.convex),
                buffers,
                [part for part in parts if part["look"] == number],
            )
            for number, (look, each) in enumerate(zip(looks, functions, strict=True))
        ],
        "parts": parts,
        "rig": _rig(rig, buffers),
        "behind": behind_shader(rig),
        "develop": develop_shader(shown_as["glsl"]),
        "view": {"name": shown_as["name"], "textures": shown_as["textures"]},
        "left_out": [INTERREFLECTION, *holes],
        "shadows": any(shadows),
    }
    return SceneView(data, buffers.content)


def light_rows(scene: Scene) -> NDArray[np.float32]:
    """Return the numbers of a scene's lights, with which ``rig_numbers`` begins.

    Lights of other radiance have other numbers, and the same shaders.
    """
    return CodedRig.of(scene.lights).rows(Stand(scene.asset.center, scene.camera.pivot))


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


def _look(
    look: Look, functions: LookFunctions, shaders: LookShaders, buffers: Buffers, parts: Sequence[Any]
) -> Mapping[str, Any]:
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
        if dome is not None:
            textures |= {f"dome{k}_{name}": buffers.texture(each) for name, each in _dome(dome).items()}
    for k, light in enumerate(rig.pictures):
        assert light.texture, "it is a picture"
        textures[f"picture{k}"] = buffers.texture(_colors(light.texture))
    return {"textures": textures}


def _dome(dome: Dome) -> Mapping[str, NDArray[Any]]:
    assert dome.points_file and dome.slots_file  # noqa: PT018
    return {
        "map": _colors(dome.radiance_file),
        "points": read_exr(dome.points_file.path, "RGBA"),
        "slots": np.load(dome.slots_file.path),
    }


def _colors(file: Content) -> NDArray[np.float32]:
    """Return an image of R, G, B as texels of four channels."""
    colors = read_exr(file.path, "RGB")
    return np.concatenate([colors, np.zeros_like(colors[..., :1])], axis=-1)
