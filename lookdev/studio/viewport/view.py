"""Conversion of a scene for the viewport in the browser: data for JSON, and the buffers that the data names."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import numpy as np

from lookdev.arrays import Elements, Floats32
from lookdev.cache import Content
from lookdev.codegen.glsl.functions import TABLE_WIDTH
from lookdev.codegen.glsl.look import LookFunctions, look_functions
from lookdev.codegen.glsl.rig import RIG_WIDTH, RigFunctions, rig_functions
from lookdev.codegen.program.look import LivePredicate, stated_constants
from lookdev.light import Dome, RigOrigin
from lookdev.light.dome.environment import read_exr
from lookdev.light.lamps import CodedRig
from lookdev.material import Bump, Look, Texture
from lookdev.material.textures import image_file
from lookdev.output.color import DisplayView
from lookdev.output.review.view import view_shader
from lookdev.scene import Camera, Scene
from lookdev.studio.viewport.buffers import Buffers
from lookdev.studio.viewport.geometry import WIDTH, CornerTexels, pack_corners
from lookdev.studio.viewport.shaders import (
    LookShaders,
    Shadows,
    background_shader,
    display_shader,
    look_shaders,
    vertex_shader,
)

INTERREFLECTION = "interreflection: light that other parts of the asset reflect or transmit"
"""The line of `SceneView.left_out` about the light that no picture of the viewport has."""

_HOLES = "light through holes: a surface with a presence below 1 casts a full shadow"

_HALF_MAX = 65504.0  # largest half float


@dataclass(frozen=True, eq=False)
class SceneView:
    """A scene for the scripts in ``static/``: `data` for JSON, and `buffers`, the bytes that `data` names by digest.

    The data have the shaders, uniforms and textures of each look, and the range of its triangles. ``behind`` is the
    shader of the background, and ``develop`` is the shader that converts light to code values.
    """

    data: Mapping[str, object]
    buffers: Mapping[str, bytes]
    left_out: tuple[str, ...]
    """The effects that the picture lacks, a line for each."""


class _Part(TypedDict):
    """What the page calls a part: a slot of the asset.

    It has a path, the number of its look, and the triangles from number `first` to `last` - 1.
    """

    path: str
    look: int
    first: int
    last: int


def slider_constants(look: Look) -> LivePredicate:
    """Return a predicate of the number of a layer and the name of a constant: whether the constant is a uniform.

    Uniforms are the constants that the look states, and the masks of the layers over the base.

    A uniform changes without compilation. Other constants are folded: the shader of a look without sheen has no code
    for sheen.
    """
    is_stated = stated_constants(look)
    return lambda number, name: is_stated(number, name) or (name == "mask" and number > 0)


def view_scene(
    scene: Scene,
    *,
    view: DisplayView = DisplayView(),  # noqa: B008
    live: Callable[[Look], LivePredicate] = slider_constants,
    resolve: Callable[[Texture | Bump], Path] = image_file,
) -> SceneView:
    """Return a scene for the page, as `view`, a view of a display, shows it.

    `live` returns, for a look, the predicate of the constants that are uniforms. `resolve` returns the file of an
    image. Both are arguments of `look_functions`.

    Raises
    ------
    AssetError
        The asset is too large, or lacks an attribute that a look reads.
    TextureError
        An image is missing or unreadable.
    OutputError
        OpenColorIO has no such view.
    """
    buffers, display = Buffers(), view_shader(view)
    looks = list({id(look): look for look in scene.looks}.values())
    numbers = {id(look): number for number, look in enumerate(looks)}
    look_numbers = [numbers[id(look)] for look in scene.looks]
    rig_origin = RigOrigin(scene.asset.center, scene.camera.pivot)
    rig = rig_functions(scene.lights, scene.slot_lights, rig_origin, scene.slot_groups)
    functions = [look_functions(look, resolve, live(look), split=rig.split) for look in looks]
    # Slots with the same look follow each other, so that the triangles of a look are one range.
    order = tuple(sorted(range(len(look_numbers)), key=lambda slot: (look_numbers[slot], slot)))
    bindings = tuple(binding for look in functions for binding in look.program.attributes)
    shadows = [Shadows.of(scene.asset, look, rig) for look in functions]
    corners = pack_corners(scene.asset, order, bindings, occluding=Shadows.TRACED in shadows)
    left_out = [INTERREFLECTION, *[_HOLES] * any(look.program.see_through for look in functions)]
    shaders = [
        look_shaders(glsl, rig, corners, shadow, scene.asset.convex)
        for glsl, shadow in zip(functions, shadows, strict=True)
    ]
    parts = _parts(scene, look_numbers, corners)
    data = {
        "resolution": list(scene.film.resolution),
        "camera": _camera(scene.camera),
        "center": list(scene.asset.center),
        "radius": scene.asset.radius,
        "vertex": vertex_shader(),
        **_geometry(corners, buffers),
        "looks": [
            _look(look, glsl, shader, buffers, [part for part in parts if part["look"] == number])
            for number, (look, glsl, shader) in enumerate(zip(looks, functions, shaders, strict=True))
        ],
        "parts": parts,
        "rig": _rig(rig, buffers),
        "behind": background_shader(rig),
        "develop": display_shader(display["glsl"]),
        "view": {"name": display["name"], "textures": display["textures"]},
        "left_out": left_out,
        "shadows": any(shadows),
    }
    return SceneView(data, buffers.content, tuple(left_out))


def light_rows(scene: Scene) -> Floats32:
    """Return the numbers that describe a scene's lights in the shaders: the beginning of the texture ``rig_numbers``.

    A change of a light's radiance changes these numbers, and no shader.
    """
    return CodedRig.from_lights(scene.lights).rows(RigOrigin(scene.asset.center, scene.camera.pivot))


def _parts(scene: Scene, look_numbers: Sequence[int], corners: CornerTexels) -> list[_Part]:
    """Return the slots of the asset, each with the number of its look and its range of triangles."""
    ranges = {triangles.slot: triangles for triangles in corners.ranges}
    return [
        {"path": slot.path, "look": look_numbers[number], "first": ranges[number].first, "last": ranges[number].last}
        for number, slot in enumerate(scene.asset.slots)
    ]


def _geometry(corners: CornerTexels, buffers: Buffers) -> Mapping[str, object]:
    """Add the arrays of `corners` to the buffers, and return the record of each."""
    return {
        "corners": buffers.rows(corners.texels, WIDTH),
        "vertices": buffers.array(corners.vertices),
        "indices": buffers.array(corners.indices),
    }


def _camera(camera: Camera) -> Mapping[str, object]:
    """Return a camera for the page, in the units of `Camera`."""
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
    look: Look, functions: LookFunctions, shaders: LookShaders, buffers: Buffers, parts: Sequence[_Part]
) -> Mapping[str, object]:
    """Return a look for the page; its triangles are the triangles of its `parts`, which follow each other."""
    textures = dict(_textures(functions, buffers))
    for k, table in enumerate(functions.program.tables):
        values = np.load(table.path).astype(np.float32).ravel()
        textures[f"look_table{k}"] = buffers.rows(values, TABLE_WIDTH)
    return {
        "name": look.name,
        "visible": shaders.visible,
        "relight": shaders.relight,
        "see_through": functions.program.see_through,
        "numbers": {name: list(values) for name, values in functions.numbers.items()},
        "textures": textures,
        "first": min(part["first"] for part in parts),
        "last": max(part["last"] for part in parts),
    }


def _textures(functions: LookFunctions, buffers: Buffers) -> Iterator[tuple[str, Mapping[str, str | int]]]:
    """Yield the name of the sampler and the texture of each image of a look.

    Texels are half floats if their range suffices; the slopes of a height map stay float32.
    """
    for look_up in functions.program.look_ups:
        for tile, file in look_up.files.items():
            texels = read_exr(file.path, "RGBA")
            if not look_up.slopes and np.abs(texels).max() <= _HALF_MAX:
                texels = texels.astype(np.float16)
            yield (f"look_{look_up.name}_{tile}" if tile else f"look_{look_up.name}"), buffers.texture(texels)


def _rig(rig: RigFunctions, buffers: Buffers) -> Mapping[str, object]:
    """Return the textures of a rig, by the names of their samplers (see `RigFunctions`)."""
    textures = {"rig_numbers": buffers.rows(rig.numbers, RIG_WIDTH)}
    if rig.tables is not None:
        textures["rig_tables"] = buffers.rows(rig.tables, TABLE_WIDTH)
    for k, dome in enumerate(rig.domes):
        if dome is not None:
            textures |= {f"dome{k}_{name}": buffers.texture(texels) for name, texels in _dome(dome).items()}
    for k, light in enumerate(rig.pictures):
        assert light.texture, "it is a picture"
        textures[f"picture{k}"] = buffers.texture(_colors(light.texture))
    return {"textures": textures}


def _dome(dome: Dome) -> Mapping[str, Elements]:
    """Return the texels of a dome that is an image: its radiance, and the tables for drawing directions."""
    assert dome.points_file and dome.slots_file  # noqa: PT018
    return {
        "map": _colors(dome.radiance_file),
        "points": read_exr(dome.points_file.path, "RGBA"),
        "slots": np.load(dome.slots_file.path),
    }


def _colors(file: Content) -> Floats32:
    """Return the RGB of an image as texels of four channels, since WebGL's texture formats here have one or four."""
    colors = read_exr(file.path, "RGB")
    return np.concatenate([colors, np.zeros_like(colors[..., :1])], axis=-1)
