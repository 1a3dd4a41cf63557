"""What Cycles' own lights and worlds cannot show of the emission of a light, and the domes that a world shows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING

from lookdev.light.emission import WHITE, Emission

if TYPE_CHECKING:
    from lookdev.light.base import Light
    from lookdev.light.dome import Dome

_CALLED = {
    "diffuse": "a diffuse multiplier",
    "specular": "a specular multiplier",
    "shaping": "a cone, a focus or a profile",
    "shadow": "a shadow control",
    "falloff": "a falloff of its own",
    "camera": "a light that the camera sees",
    "light_link": "light links",
    "shadow_link": "shadow links",
    "spared": "shadow links",
}
_ANYWHERE = ("color", "turns", "group", "path")


def gap(emission: Emission, *known: str, besides: Iterable[str] = ()) -> str | None:
    """Return what of an emission is neither default nor one of the `known` fields, after `besides`; None: nothing."""
    fields_beyond = (each.name for each in fields(emission) if each.name not in (*_ANYWHERE, *known))
    differing = [name for name in fields_beyond if getattr(emission, name) != getattr(WHITE, name)]
    gaps = [*besides, *(_CALLED.get(name, name.replace("_", " ")) for name in differing)]
    *before, last = dict.fromkeys(gaps) or (None,)
    return f"{', '.join(map(str, before))} and {last}" if before else last


def shadow_gap(emission: Emission) -> Iterator[str]:
    """Yield what of a shadow Blender lacks; without one, directions of a BSDF would still be blocked."""
    if emission.shadow != WHITE.shadow:
        yield _CALLED["shadow"]


def world_domes(lights: Sequence[Light]) -> list[Dome]:
    """Return the domes that are infinitely far: a world of Blender shows their sum."""
    return [light.map_dome for light in lights if light.far and light.map_dome]


def still_domes(lights: Sequence[Light]) -> bool | None:
    """Return whether the domes of a rig stand still while it turns; None where some do and some do not.

    Domes that are the same all around count as either.
    """
    still = {not dome.emission.turns for dome in world_domes(lights) if not dome.constant}
    return None if len(still) > 1 else still == {True}


def varied_domes(lights: Sequence[Light]) -> bool:
    """Return whether lights have a dome from which Cycles should draw directions."""
    return any(not dome.constant for dome in world_domes(lights))
