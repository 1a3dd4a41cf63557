"""Lights in another colour space: what arrives of them is the same light, by its coordinates there."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lookdev.light.dome import Dome, prepare_light
from lookdev.light.dome.environment import EnvironmentMap, Repairs
from lookdev.light.dome.local import LocalDome
from lookdev.light.emission import Color, Emission
from lookdev.light.fit import with_emission
from lookdev.light.picture import prepare_texture
from lookdev.light.protocol import Light
from lookdev.light.rect import RectLight
from lookdev.space import REC709, Space, to_space

_WHITE: Color = (1.0, 1.0, 1.0)


def in_space(light: Light, space: Space) -> Light:
    """Return a light of linear Rec.709 as it is in a space.

    What filters its light, as the colour of its shadow does, leaves there what it leaves of this light in Rec.709.
    """
    if space == REC709:
        return light
    emission = light.emission
    if isinstance(light, Dome):
        # The map times the colour is what arrives.
        dome = prepare_light(_converted(light.table, emission.color, light.map_digest, space), sampled=True)
        return replace(dome, axes=light.axes, emission=replace(in_emission(emission, space), color=_WHITE))
    if isinstance(light, LocalDome):
        environment = _converted(light.dome.table, emission.color, light.dome.map_digest, space)
        dome = prepare_light(environment, local=True)
        own = replace(in_emission(emission, space), color=_WHITE)
        return replace(light, dome=replace(dome, axes=light.dome.axes, emission=own))
    if isinstance(light, RectLight) and light.texture is not None and light.picture is not None:
        texture = prepare_texture(_converted(light.picture, emission.color, light.texture.digest, space))
        return replace(light, texture=texture, emission=replace(in_emission(emission, space), color=_WHITE))
    return with_emission(light, in_emission(emission, space))


def in_emission(emission: Emission, space: Space) -> Emission:
    """Return an emission in a space."""
    color = _color(to_space(emission.color, space))
    shaping, shadow = emission.shaping, emission.shadow
    if shaping is not None:
        shaping = replace(shaping, focus_tint=_filter(emission.color, shaping.focus_tint, space))
    shadow = replace(shadow, color=_filter(emission.color, shadow.color, space))
    return replace(emission, color=color, shaping=shaping, shadow=shadow)


def _filter(light: Color, given: Color, space: Space) -> Color:
    """Return by what a light is multiplied in a space so that of it is left what `given` leaves in Rec.709."""
    if len({*given}) == 1:
        return given
    before = to_space(light, space)
    after = to_space(np.array(light) * np.array(given), space)
    return _color(np.divide(after, before, out=np.zeros(3), where=before > 0.0))


def _converted(radiance: NDArray[np.float64], color: Color, digest: str, space: Space) -> EnvironmentMap:
    """Return a map times a colour in a space; its digest is of what it is made of."""
    name = hashlib.sha256(f"{digest} {color!r} {space}".encode()).hexdigest()
    pixels = to_space(radiance * np.array(color), space).astype(np.float32)
    return EnvironmentMap(space, pixels, Repairs(), name, space)


def _color(values: NDArray[np.float64]) -> Color:
    r, g, b = values.tolist()
    return r, g, b
