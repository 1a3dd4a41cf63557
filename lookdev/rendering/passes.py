"""The passes of a frame: what an EXR can have besides the beauty, and the names of its channels."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from lookdev.codegen.source import LOBE_GROUPS
from lookdev.light import Light
from lookdev.rendering.cryptomatte import RANKS


@dataclass(frozen=True)
class Pass:
    """What a job asks for by a name: arrays (H, W, channels) by their names, with the EXR's names of the channels.

    If `light`, they are parts of the beauty, to which exposure applies.
    """

    name: str
    help: str
    arrays: Mapping[str, tuple[str, ...]]
    light: bool = False


def _layer(name: str, help: str, letters: str) -> Pass:
    return Pass(name, help, {name: tuple(f"{name}.{letter}" for letter in letters)})


def _parts(name: str, help: str, parts: Iterable[str]) -> Pass:
    return Pass(name, help, {part: tuple(f"{part}.{letter}" for letter in "RGB") for part in parts}, light=True)


def _matte_channels(name: str) -> tuple[str, ...]:
    return tuple(f"{name}{layer:02}.{letter}" for layer in range(RANKS // 2) for letter in "RGBA")


MATTES = {kind: f"Crypto{kind.capitalize()}" for kind in ("object", "material", "asset")}
"""The names of the mattes by what they tell apart: prims, looks, assets."""

PASSES: dict[str, Pass] = {
    each.name: each
    for each in (
        _layer("depth", "distance along the camera's axis, metres", "Z"),
        _layer("position", "place in the world, metres", "XYZ"),
        _layer("normal", "shading normal in the world", "XYZ"),
        _layer("uv", "texture coordinates of the first UV set", "UV"),
        _layer("albedo", "reflectance of the look seen from the camera, premultiplied", "RGB"),
        _layer("samples", "samples of each pixel", "Y"),
        _parts("lobes", "light by the lobes that reflect it to the camera", LOBE_GROUPS),
        _parts("direct", "light that reaches the surface from lights, and by way of the asset", ("direct", "indirect")),
        _parts("lights", "light by the light, or the group of lights, that sends it", ()),
        Pass(
            "cryptomatte",
            "coverage of each prim, look and asset",
            {name: _matte_channels(name) for name in MATTES.values()},
        ),
    )
}


CATCHER = _parts("catcher", "light of the ground with the asset and without", ("ground", "bare")).arrays
"""What a frame with a shadow catcher has besides, as `lookdev.rendering.catcher` defines it."""

IN_EACH_FRAME = ("beauty", "alpha", "error")
"""What a job may name among its passes, and every frame has."""

LIGHTS = "lights"
"""The pass whose arrays are those of a scene: one for each group of lights."""


def light_layer(group: str) -> str:
    """Return the name of the array, and of the layer in the EXR, of a group of lights."""
    return f"light_{group}"


def light_groups(lights: Sequence[Light]) -> tuple[str, ...]:
    """Return the group of each light: that of its emission, and the kind of light where it has none.

    What is no letter or digit becomes an underscore: dots would divide the names of layers.
    """
    return tuple(re.sub(r"\W", "_", each.emission.group or each.kind, flags=re.ASCII) for each in lights)


def arrays_of(passes: Collection[str], groups: Sequence[str] = ()) -> dict[str, tuple[str, ...]]:
    """Return the channels of each array of passes, by its name; `groups` are those of the lights."""
    found = {name: channels for each in passes for name, channels in PASSES[each].arrays.items()}
    if LIGHTS in passes:
        for name in map(light_layer, dict.fromkeys(groups)):
            found[name] = tuple(f"{name}.{letter}" for letter in "RGB")
    return found


def parts_of_light(passes: Iterable[str], groups: Sequence[str]) -> frozenset[str]:
    """Return the names of the arrays that are parts of the beauty, to which exposure applies."""
    return frozenset(arrays_of([each for each in passes if PASSES[each].light], groups))
