"""Lights: a protocol, and a record a kind."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, cast

from pydantic import PlainSerializer, PlainValidator, TypeAdapter

from lookdev.cache import Content
from lookdev.errors import EnvironmentMapError
from lookdev.light import native
from lookdev.light.cylinder import CylinderLight
from lookdev.light.disk import DiskLight
from lookdev.light.distant import DistantLight
from lookdev.light.dome import Dome, example_dome, prepare_light
from lookdev.light.dome.environment import BUILTIN_LIGHTS, EnvironmentMap, load_environment, make_environment
from lookdev.light.dome.local import LocalDome, example_local_dome
from lookdev.light.emission import Emission, Falloff, Shadow, Shaping, emitted_color
from lookdev.light.ies import Profile, load_profile
from lookdev.light.lamps import CodedRig, Stand, is_plain, rig_code
from lookdev.light.picture import prepare_texture
from lookdev.light.placement import placement
from lookdev.light.protocol import CodedLight, Emitter, Light, LightCode, LightKind, Turned
from lookdev.light.rect import RectLight
from lookdev.light.sphere import SphereLight

LIGHT_KINDS: dict[str, LightKind] = {
    "dome": LightKind(
        Dome, files("lookdev") / "shaders" / "dome.osl.h", example_dome, native.gap_of_dome, native.dome_images
    ),
    "local_dome": LightKind(LocalDome, None, example_local_dome, native.gap_of_local_dome),
    "distant": LightKind(DistantLight, None, DistantLight.example, native.gap_of_distant),
    "rect": LightKind(RectLight, None, RectLight.example, native.gap_of_placed, native.texture_images),
    **{
        kind.kind: LightKind(kind, None, kind.example, native.gap_of_placed)
        for kind in (CylinderLight, DiskLight, SphereLight)
    },
}


def coded(lights: Sequence[Light]) -> CodedLight | None:
    """Return the only light of a scene, if the OSL of its kind alone shows it; None: the lights are a rig."""
    if len(lights) == 1 and LIGHT_KINDS[lights[0].kind].osl is not None and is_plain(lights[0]):
        return cast(CodedLight, lights[0])
    return None


def lights_code(lights: Sequence[Light], *, sampled: bool, stand: Stand = Stand()) -> LightCode:  # noqa: B008
    """Return the values for the OSL of the lights of a scene.

    Raises
    ------
    EnvironmentMapError
        A kind that has OSL of its own is beside other lights.
    """
    if light := coded(lights):
        return light.code(sampled=sampled)
    rig = CodedRig.of(lights)
    if alone := next((each.kind for each in lights if each not in (*rig.lamps, *rig.domes)), None):
        raise EnvironmentMapError(f"a light of kind '{alone}' cannot be one of several; it alone would be right")
    return rig_code(rig, sampled=sampled, stand=stand)


def called(light: Light, number: int) -> str:
    """Return what messages call a light: the path of its prim, else its number, with its kind."""
    return f"light {light.emission.path or number} ({light.kind})"


def native_gaps(lights: Sequence[Light]) -> tuple[str, ...]:
    """Return what of a scene's lights Cycles' own lights cannot show, a sentence for each light; none: they show it."""
    gaps = []
    for number, light in enumerate(lights, start=1):
        if gap := LIGHT_KINDS[light.kind].native_gap(light):
            gaps.append(f"{called(light, number)}: it has {gap}, which Cycles' own lights lack")
    if native.still_domes(lights) is None:
        gaps.append("some domes stand still while others turn with the rig: Cycles has one world for all of them")
    return tuple(gaps)


def native_images(lights: Sequence[Light]) -> tuple[Content, ...]:
    """Return the images that Cycles' own lights read to show lights."""
    return tuple(image for light in lights for image in LIGHT_KINDS[light.kind].native_images(light))


@cache
def _adapter(kind: type[Light]) -> TypeAdapter[Light]:
    return TypeAdapter(kind)


def _encode(light: Light) -> dict[str, Any]:
    return {"kind": light.kind, **_adapter(type(light)).dump_python(light, mode="json")}


def _decode(value: object) -> Light:
    match value:
        case {"kind": str(name), **fields} if name in LIGHT_KINDS:
            return _adapter(LIGHT_KINDS[name].type).validate_python(fields)
    raise ValueError(f"a light has a kind, one of: {', '.join(LIGHT_KINDS)}")


AnyLight = Annotated[Light, PlainValidator(_decode), PlainSerializer(_encode)]
"""A light of any kind as a field of plain data: its fields and its kind's name in JSON."""

__all__ = [
    "BUILTIN_LIGHTS",
    "LIGHT_KINDS",
    "AnyLight",
    "CylinderLight",
    "DiskLight",
    "DistantLight",
    "Dome",
    "Emission",
    "Emitter",
    "EnvironmentMap",
    "Falloff",
    "Light",
    "LightCode",
    "LightKind",
    "LocalDome",
    "Profile",
    "RectLight",
    "Shadow",
    "Shaping",
    "SphereLight",
    "Stand",
    "Turned",
    "called",
    "coded",
    "emitted_color",
    "lights_code",
    "load_environment",
    "load_profile",
    "make_environment",
    "native_gaps",
    "native_images",
    "placement",
    "prepare_light",
    "prepare_texture",
]
