"""Lights: a protocol, and a record a kind."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from operator import methodcaller
from typing import Annotated, Any

from pydantic import PlainSerializer, PlainValidator, TypeAdapter

from lookdev.cache import Content
from lookdev.errors import EnvironmentMapError
from lookdev.light.cylinder import CylinderLight
from lookdev.light.disk import DiskLight
from lookdev.light.distant import DistantLight
from lookdev.light.dome import Dome, example_dome, prepare_light
from lookdev.light.dome.environment import BUILTIN_LIGHTS, EnvironmentMap, load_environment, make_environment
from lookdev.light.dome.local import LocalDome, example_local_dome
from lookdev.light.emission import Emission, Falloff, Shadow, Shaping, emitted_color
from lookdev.light.ies import Profile, load_profile
from lookdev.light.picture import prepare_texture
from lookdev.light.placement import placement
from lookdev.light.protocol import Emitter, Light, LightCode, LightKind, Turned
from lookdev.light.rect import RectLight
from lookdev.light.sphere import SphereLight

LIGHT_KINDS: dict[str, LightKind] = {
    "dome": LightKind(
        Dome, files("lookdev") / "shaders" / "dome.osl.h", example_dome, world=methodcaller("world_file")
    ),
    "local_dome": LightKind(LocalDome, None, example_local_dome),
    **{
        kind.kind: LightKind(kind, None, kind.example)
        for kind in (CylinderLight, DiskLight, DistantLight, RectLight, SphereLight)
    },
}


def world_image(light: Light) -> Content:
    """Return the lat-long EXR file by which Cycles' world shows a light; an EnvironmentMapError if it cannot."""
    world = LIGHT_KINDS[light.kind].world
    if world is None:
        raise EnvironmentMapError(f"Cycles' world cannot show a light of kind '{light.kind}'; use backend 'exact'")
    return world(light)


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
    "Turned",
    "emitted_color",
    "load_environment",
    "load_profile",
    "make_environment",
    "placement",
    "prepare_light",
    "prepare_texture",
    "world_image",
]
