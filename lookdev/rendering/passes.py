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


def _data_pass(name: str, help: str, letters: str) -> Pass:
    return Pass(name, help, {name: tuple(f"{name}.{letter}" for letter in letters)})


def _light_pass(name: str, help: str, parts: Iterable[str]) -> Pass:
    return Pass(name, help, {part: tuple(f"{part}.{letter}" for letter in "RGB") for part in parts}, light=True)


def _matte_channels(name: str) -> tuple[str, ...]:
    return tuple(f"{name}{layer:02}.{letter}" for layer in range(RANKS // 2) for letter in "RGBA")


MATTES = {kind: f"Crypto{kind.capitalize()}" for kind in ("object", "material", "asset")}
"""The names of the mattes, whose ids are those of prims, looks, or assets."""

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
"""The additional arrays of a frame with a shadow catcher (`lookdev.rendering.catcher`)."""

ALWAYS_WRITTEN = ("beauty", "alpha", "error")
"""Names that a job may list among its passes though every frame has these arrays."""

LIGHTS_PASS = "lights"
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
    if LIGHTS_PASS in passes:
        for name in map(light_layer, dict.fromkeys(groups)):
            arrays[name] = tuple(f"{name}.{letter}" for letter in "RGB")
    return arrays


def light_parts(passes: Iterable[str], groups: Sequence[str]) -> frozenset[str]:
    """Return the names of the arrays of some passes that are parts of the beauty, to which exposure applies."""
    return frozenset(channels_of_passes([name for name in passes if PASSES[name].light], groups))
