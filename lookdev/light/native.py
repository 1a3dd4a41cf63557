"""What Cycles' own lights and Mitsuba cannot show: why, for a light, and which images it reads."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from typing import Any

from lookdev.cache import Content
from lookdev.light.distant import DistantLight
from lookdev.light.dome import Dome
from lookdev.light.emission import WHITE, Emission
from lookdev.light.placed import PlacedLight

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


def gap_of_dome(light: Dome) -> str | None:
    """Return what of a dome light a world of Blender does not have; None: it shows the light."""
    return _all(_beyond(light.emission, (*_ANYWHERE, "camera")))


def gap_of_local_dome(light: object) -> str | None:
    """Return what keeps Blender from showing a local dome."""
    return "a place and a radius of its image"


def gap_of_distant(light: DistantLight) -> str | None:
    """Return what of a distant light a sun of Blender does not have; None: it shows the light."""
    wide = [f"an angle of {light.angle:g} degrees, more than 180"] if light.angle > 180.0 else []
    return _all((*wide, *_shadow(light.emission), *_beyond(light.emission, (*_ANYWHERE, "shadow"))))


def gap_of_placed(light: PlacedLight) -> str | None:
    """Return what of a light that has a place a light of Blender does not have; None: it shows the light."""
    emission, shaping = light.emission, light.emission.shaping
    profile = ["an IES profile"] if shaping and shaping.profile else []
    known = (*_ANYWHERE, "shadow", "shaping")
    return _all((*profile, *_shadow(emission), *_beyond(emission, known)))


def dome_images(light: Any) -> tuple[Content, ...]:
    """Return the lat-long EXR file of a dome light."""
    return (light.radiance_file,)


def texture_images(light: Any) -> tuple[Content, ...]:
    """Return the texture of a rectangle light."""
    return (light.texture,) if light.texture else ()


def still_domes(lights: Sequence[Any]) -> bool | None:
    """Return whether the domes of a rig stand still while it turns; None where some do and some do not.

    Domes that are the same all around count as either.
    """
    still = {not light.emission.turns for light in lights if isinstance(light, Dome) and not light.constant}
    return None if len(still) > 1 else still == {True}


def varied_domes(lights: Sequence[Any]) -> bool:
    """Return whether lights have a dome from which Cycles should draw directions."""
    return any(isinstance(light, Dome) and not light.constant for light in lights)


def _shadow(emission: Emission) -> Iterator[str]:
    """Yield what of a shadow Blender lacks; without one, directions of a BSDF would still be blocked."""
    if emission.shadow != WHITE.shadow:
        yield _CALLED["shadow"]


def _beyond(emission: Emission, known: Sequence[str]) -> Iterator[str]:
    for field in fields(emission):
        if field.name not in known and getattr(emission, field.name) != getattr(WHITE, field.name):
            yield _CALLED.get(field.name, field.name.replace("_", " "))


def _all(found: Iterable[str]) -> str | None:
    *before, last = dict.fromkeys(found) or (None,)
    return f"{', '.join(before)} and {last}" if before else last
