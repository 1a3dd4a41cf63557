"""Lights: a protocol, and a record a kind. The only kind is the dome light, an environment map at infinity."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from operator import attrgetter
from typing import Annotated, Any

from pydantic import PlainSerializer, PlainValidator, TypeAdapter

from lookdev.cache import Content
from lookdev.errors import EnvironmentMapError
from lookdev.light.dome import Dome, example_dome, prepare_light
from lookdev.light.dome.environment import BUILTIN_LIGHTS, EnvironmentMap, load_environment, make_environment
from lookdev.light.protocol import Emitter, Light, LightCode, LightKind, Turned

LIGHT_KINDS: dict[str, LightKind] = {
    "dome": LightKind(
        Dome, files("lookdev") / "shaders" / "dome.osl.h", example_dome, world=attrgetter("radiance_file")
    )
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
    "Dome",
    "Emitter",
    "EnvironmentMap",
    "Light",
    "LightCode",
    "LightKind",
    "Turned",
    "load_environment",
    "make_environment",
    "prepare_light",
    "world_image",
]
