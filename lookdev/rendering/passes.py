"""The passes of a frame: the arrays that an EXR can have besides the beauty, and the names of their channels."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from lookdev.codegen.source import LOBE_GROUPS
from lookdev.light import Light
from lookdev.rendering.cryptomatte import RANKS


@dataclass(frozen=True)
class Pass:
    """A pass that a job can name: arrays (H, W, channels), each with the EXR's names of its channels.

    With `light`, the arrays are parts of the beauty, and exposure applies to them.
    """

    name: str
    help: str
    arrays: Mapping[str, tuple[str, ...]]
    light: bool = False


def _one_layer(name: str, help: str, letters: str) -> Pass:
    return Pass(name, help, {name: tuple(f"{name}.{letter}" for letter in letters)})


def _parts_of_light(name: str, help: str, parts: Iterable[str]) -> Pass:
    return Pass(name, help, {part: tuple(f"{part}.{letter}" for letter in "RGB") for part in parts}, light=True)


def _matte_channels(name: str) -> tuple[str, ...]:
    return tuple(f"{name}{layer:02}.{letter}" for layer in range(RANKS // 2) for letter in "RGBA")


MATTES = {kind: f"Crypto{kind.capitalize()}" for kind in ("object", "material", "asset")}
"""The names of the mattes, whose ids are those of prims, looks, or assets."""

PASSES: dict[str, Pass] = {
    record.name: record
    for record in (
        _one_layer("depth", "distance along the camera's axis, metres", "Z"),
        _one_layer("position", "place in the world, metres", "XYZ"),
        _one_layer("normal", "shading normal in the world", "XYZ"),
        _one_layer("uv", "texture coordinates of the first UV set", "UV"),
        _one_layer("albedo", "reflectance of the look seen from the camera, premultiplied", "RGB"),
        _one_layer("samples", "samples of each pixel", "Y"),
        _parts_of_light("lobes", "light by the lobes that reflect it to the camera", LOBE_GROUPS),
        _parts_of_light(
            "direct", "light that reaches the surface from lights, and by way of the asset", ("direct", "indirect")
        ),
        _parts_of_light("lights", "light by the light, or the group of lights, that sends it", ()),
        Pass(
            "cryptomatte",
            "coverage of each prim, look and asset",
            {name: _matte_channels(name) for name in MATTES.values()},
        ),
    )
}


CATCHER = _parts_of_light("catcher", "light of the ground with the asset and without", ("ground", "bare")).arrays
"""The further arrays of a frame with a shadow catcher, as defined by `lookdev.rendering.catcher`."""

IN_EACH_FRAME = ("beauty", "alpha", "error")
"""Names that a job may list among its passes though every frame has these arrays."""

LIGHTS = "lights"
"""The pass whose arrays depend on the scene: one for each group of lights."""


def light_layer(group: str) -> str:
    """Return the name of the array, and of the layer in the EXR, of a group of lights."""
    return f"light_{group}"


def light_groups(lights: Sequence[Light]) -> tuple[str, ...]:
    """Return the group of each light: that of its emission or, without one, its kind.

    Characters other than letters and digits become underscores: dots would divide the names of layers.
    """
    return tuple(re.sub(r"\W", "_", light.emission.group or light.kind, flags=re.ASCII) for light in lights)


def channels_of_passes(passes: Collection[str], groups: Sequence[str] = ()) -> dict[str, tuple[str, ...]]:
    """Return the channels of each array of some passes, by its name; `groups` are the groups of lights."""
    arrays = {name: channels for key in passes for name, channels in PASSES[key].arrays.items()}
    if LIGHTS in passes:
        for name in map(light_layer, dict.fromkeys(groups)):
            arrays[name] = tuple(f"{name}.{letter}" for letter in "RGB")
    return arrays


def light_parts(passes: Iterable[str], groups: Sequence[str]) -> frozenset[str]:
    """Return the names of the arrays of some passes that are parts of the beauty, to which exposure applies."""
    return frozenset(channels_of_passes([name for name in passes if PASSES[name].light], groups))
