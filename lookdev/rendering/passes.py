"""The passes of a frame: the arrays that an EXR can have besides the beauty, and the names of their channels.

A job lists passes by their names in `PASSES`. A pass has one array or several, each a layer of the EXR.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from lookdev.codegen.source import LOBE_GROUPS
from lookdev.light import Light
from lookdev.rendering.cryptomatte import RANKS


@dataclass(frozen=True)
class Pass:
    """A pass that a job can name."""

    name: str
    help: str
    arrays: Mapping[str, tuple[str, ...]]  # the names of the channels in the EXR, by the name of an array
    light: bool = False  # whether the arrays are parts of the beauty's light, so that exposure applies to them


def _data_pass(name: str, help: str, letters: str) -> Pass:
    """Return a pass of one array, with a channel for each letter."""
    return Pass(name, help, {name: tuple(f"{name}.{letter}" for letter in letters)})


def _light_pass(name: str, help: str, parts: Iterable[str]) -> Pass:
    """Return a pass with an RGB array for each part of the light; the arrays have the names of the parts."""
    return Pass(name, help, {part: tuple(f"{part}.{letter}" for letter in "RGB") for part in parts}, light=True)


def _matte_channels(name: str) -> tuple[str, ...]:
    """Return the channels of a cryptomatte: layers of four channels, each with two pairs of id and coverage."""
    return tuple(f"{name}{layer:02}.{letter}" for layer in range(RANKS // 2) for letter in "RGBA")


MATTES = {kind: f"Crypto{kind.capitalize()}" for kind in ("object", "material", "asset")}
"""The name of each cryptomatte, by what it covers: the prims of the asset, its looks, or the assets of the scene."""

PASSES: dict[str, Pass] = {
    record.name: record
    for record in (
        _data_pass("depth", "distance along the camera's axis, metres", "Z"),
        _data_pass("position", "position in the world, metres", "XYZ"),
        _data_pass("normal", "shading normal in the world", "XYZ"),
        _data_pass("uv", "texture coordinates of the first UV set", "UV"),
        _data_pass("albedo", "reflectance of the look seen from the camera, premultiplied", "RGB"),
        _data_pass("samples", "samples of each pixel", "Y"),
        _light_pass("lobes", "light by the lobes that reflect it to the camera", LOBE_GROUPS),
        _light_pass(
            "direct",
            "light that reaches the surface directly from lights, and after the asset has reflected it",
            ("direct", "indirect"),
        ),
        _light_pass("lights", "reflected light of each light, or of each group of lights", ()),
        Pass(
            "cryptomatte",
            "coverage of each prim, look and asset",
            {name: _matte_channels(name) for name in MATTES.values()},
        ),
    )
}


CATCHER_ARRAYS = _light_pass("catcher", "light of the ground with the asset and without", ("ground", "bare")).arrays
"""The additional arrays of a frame with a shadow catcher: G and B of `lookdev.rendering.catcher`."""

ALWAYS_WRITTEN = ("beauty", "alpha", "error")
"""Names that a job may list among its passes although every frame has these arrays anyway."""

LIGHTS_PASS = "lights"
"""The name of the pass whose arrays depend on the scene: one array for each group of lights."""


def light_layer(group: str) -> str:
    """Return the name of the array that has the light of a group; the layer in the EXR has the same name."""
    return f"light_{group}"


def light_groups(lights: Sequence[Light]) -> tuple[str, ...]:
    """Return the name of each light's group: `Emission.group` or, if that is empty, the light's kind.

    Characters other than letters and digits become underscores, because a dot would divide the name of a layer.
    """
    return tuple(re.sub(r"\W", "_", light.emission.group or light.kind, flags=re.ASCII) for light in lights)


def channels_of_passes(passes: Collection[str], groups: Sequence[str] = ()) -> dict[str, tuple[str, ...]]:
    """Return the channels of each array of some passes, by the array's name.

    passes : the names of the passes; groups : the name of each light's group, for the pass `LIGHTS_PASS`.
    """
    arrays = {name: channels for key in passes for name, channels in PASSES[key].arrays.items()}
    if LIGHTS_PASS in passes:
        for name in map(light_layer, dict.fromkeys(groups)):
            arrays[name] = tuple(f"{name}.{letter}" for letter in "RGB")
    return arrays


def light_parts(passes: Iterable[str], groups: Sequence[str]) -> frozenset[str]:
    """Return the names of the arrays in some passes that are parts of the beauty, so that exposure applies to them."""
    return frozenset(channels_of_passes([name for name in passes if PASSES[name].light], groups))
