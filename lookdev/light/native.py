"""Lights as Cycles' own lights and world render them: the features of an emission that these lack, and the domes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING

from lookdev.light.emission import WHITE, Emission

if TYPE_CHECKING:
    from lookdev.light.base import Light
    from lookdev.light.dome import Dome

_FIELD_PHRASES = {
    "diffuse": "a diffuse multiplier",
    "specular": "a specular multiplier",
    "shaping": "a cone, a focus or a profile",
    "shadow": "a shadow control",
    "falloff": "a falloff of its own",
    "camera": "a light that the camera sees",
    "light_link": "light links",
    "shadow_link": "shadow links",
    "shadow_excluded": "shadow links",
}
_ALWAYS_SUPPORTED = ("color", "turns", "group", "path")


def missing_features(emission: Emission, *supported: str, first: Iterable[str] = ()) -> str | None:
    """Return the features of an emission that are neither default nor `supported`, as a phrase; None without any.

    `supported` are names of fields; `first` are phrases that come first in the result.
    """
    names = (field.name for field in fields(emission) if field.name not in (*_ALWAYS_SUPPORTED, *supported))
    differing = [name for name in names if getattr(emission, name) != getattr(WHITE, name)]
    gaps = [*first, *(_FIELD_PHRASES.get(name, name.replace("_", " ")) for name in differing)]
    *before, last = dict.fromkeys(gaps) or (None,)
    return f"{', '.join(map(str, before))} and {last}" if before else last


def missing_shadow_features(emission: Emission) -> Iterator[str]:
    """Yield a phrase if an emission has a shadow control, which Blender's lights lack.

    Blender can disable a light's shadow, but occluders still block the light in directions that the BSDF samples.
    """
    if emission.shadow != WHITE.shadow:
        yield _FIELD_PHRASES["shadow"]


def world_domes(lights: Sequence[Light]) -> list[Dome]:
    """Return the domes that are infinitely far; Blender's world renders their sum."""
    return [light.world_dome for light in lights if light.world_dome]


def are_domes_still(lights: Sequence[Light]) -> bool | None:
    """Return whether the domes of a rig stand still while it turns; None if some do and some do not.

    A constant dome looks the same in both cases, and is not counted.
    """
    still = {not dome.emission.turns for dome in world_domes(lights) if not dome.constant}
    return None if len(still) > 1 else still == {True}


def has_varied_dome(lights: Sequence[Light]) -> bool:
    """Return whether the lights have a dome whose radiance varies, which Cycles should importance sample."""
    return any(not dome.constant for dome in world_domes(lights))
