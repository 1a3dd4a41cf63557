"""Lights of a scene: the public names of the package, and how a list of lights is rendered.

A kind of light (a rectangle, a dome, ...) is a class with radiance, pdf and sampling; `LIGHT_KINDS` lists the kinds.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Annotated, cast

from pydantic import PlainSerializer, PlainValidator, TypeAdapter

from lookdev.cache import Content
from lookdev.light import native
from lookdev.light.base import CodedLight, Light, LightCode, PosedLight
from lookdev.light.cylinder import CylinderLight
from lookdev.light.disk import DiskLight
from lookdev.light.distant import DistantLight
from lookdev.light.dome import Dome, prepare_light
from lookdev.light.dome.environment import BUILTIN_LIGHTS, EnvironmentMap, load_environment, make_environment
from lookdev.light.emission import Emission, Shadow, Shaping
from lookdev.light.kinds import LIGHT_KINDS, light_label
from lookdev.light.lamps import CodedRig, RigOrigin, is_plain, rig_code
from lookdev.light.rect import RectLight
from lookdev.light.sphere import SphereLight


def coded_light(lights: Sequence[Light]) -> CodedLight | None:
    """Return a scene's only light if the OSL of its kind can render it; None if the scene needs a `CodedRig`."""
    if len(lights) == 1 and LIGHT_KINDS[lights[0].kind].osl is not None and is_plain(lights[0]):
        return cast(CodedLight, lights[0])
    return None


def lights_code(lights: Sequence[Light], *, sampled: bool, rig_origin: RigOrigin = RigOrigin()) -> LightCode:  # noqa: B008
    """Return the constants, parameters and arrays that the OSL of a scene's lights reads.

    Without `sampled`, tables with which the OSL draws directions are left out.

    Raises
    ------
    EnvironmentMapError
        There are several lights, and one of them is neither a lamp nor a dome.
    """
    if light := coded_light(lights):
        return light.code(sampled=sampled)
    return rig_code(CodedRig.from_lights(lights), sampled=sampled, rig_origin=rig_origin)


def native_gaps(lights: Sequence[Light]) -> tuple[str, ...]:
    """Return a sentence for each reason why Cycles' own lights cannot render the lights of a scene; () if they can."""
    gaps = []
    for number, light in enumerate(lights, start=1):
        if gap := light.native_gap():
            gaps.append(f"{light_label(light, number)}: it has {gap}, which Cycles' own lights lack")
    if native.are_domes_still(lights) is None:
        gaps.append("some domes stand still while others turn with the rig: Cycles has one world for all of them")
    return tuple(gaps)


def native_images(lights: Sequence[Light]) -> tuple[Content, ...]:
    """Return the image files with which Cycles' own lights render `lights`."""
    return tuple(image for light in lights for image in light.native_images)


@cache
def _adapter(kind: type[Light]) -> TypeAdapter[Light]:
    return TypeAdapter(kind)


def _encode(light: Light) -> dict[str, object]:
    return {"kind": light.kind, **_adapter(type(light)).dump_python(light, mode="json")}


def _decode(value: object) -> Light:
    match value:
        case {"kind": str(name), **fields} if name in LIGHT_KINDS:
            return _adapter(LIGHT_KINDS[name].type).validate_python(fields)
    raise ValueError(f"a light has a kind, one of: {', '.join(LIGHT_KINDS)}")


AnyLight = Annotated[Light, PlainValidator(_decode), PlainSerializer(_encode)]
"""The type of a pydantic field with a light of any kind: its JSON has the light's fields and the name of its kind."""

__all__ = ["LIGHT_KINDS", "AnyLight", "Emission", "Light", "PosedLight", "RigOrigin", "Shadow", "Shaping"]
__all__ += ["CylinderLight", "DiskLight", "DistantLight", "Dome", "RectLight", "SphereLight"]
__all__ += ["BUILTIN_LIGHTS", "EnvironmentMap", "load_environment", "make_environment", "prepare_light"]
__all__ += ["coded_light", "light_label", "lights_code", "native_gaps", "native_images"]
