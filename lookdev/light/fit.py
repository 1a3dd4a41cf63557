"""A light made larger or smaller with everything around it, and moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lookdev.light.cylinder import CylinderLight
from lookdev.light.disk import DiskLight
from lookdev.light.distant import DistantLight
from lookdev.light.dome import Dome
from lookdev.light.dome.local import LocalDome
from lookdev.light.emission import Emission
from lookdev.light.placed import PlacedLight
from lookdev.light.placement import Vector, vector
from lookdev.light.protocol import Light
from lookdev.light.rect import RectLight
from lookdev.light.sphere import SphereLight


def fitted(light: Light, scale: float, origin: Vector) -> Light:
    """Return a light whose lengths are `scale` times as long, moved from the world's origin to `origin`, in metres.

    What it lights is scaled and moved along: places at `scale` times their distance see the same radiance from it.
    """
    emission = scaled_emission(light.emission, scale)
    if isinstance(light, Dome | DistantLight):
        return replace(light, emission=emission)
    if isinstance(light, LocalDome):
        dome = replace(light.dome, emission=emission)
        return replace(light, dome=dome, radius=scale * light.radius, position=_placed(light.position, scale, origin))
    assert isinstance(light, PlacedLight), light.kind
    placed = replace(light, emission=emission, position=_placed(light.position, scale, origin))
    match placed:
        case RectLight(width=width, height=height):
            return replace(placed, width=scale * width, height=scale * height)
        case DiskLight(radii=(x, y)):
            return replace(placed, radii=(scale * x, scale * y))
        case SphereLight(radius=radius):
            return replace(placed, radius=scale * radius)
        case CylinderLight(radius=radius, length=length):
            return replace(placed, radius=scale * radius, length=scale * length)
    raise AssertionError(f"a light of kind '{light.kind}' has sizes that are not known here")


def _placed(position: Vector, scale: float, origin: Vector) -> Vector:
    return vector(scale * np.array(position) + np.array(origin))


def scaled_emission(emission: Emission, scale: float) -> Emission:
    """Return an emission whose distances are `scale` times as long."""
    shadow, falloff = emission.shadow, emission.falloff
    if shadow.distance >= 0.0:
        # A falloff below 0 is none, whatever its number.
        shadow = replace(shadow, distance=scale * shadow.distance, falloff=scale * shadow.falloff)
    if falloff is None:
        return replace(emission, shadow=shadow)
    # A factor of `Falloff` is a length to the power of 2 - exponent.
    by = scale ** (falloff.exponent - 2.0)
    r, g, b = (by * channel for channel in emission.color)
    end = None if falloff.end is None else scale * falloff.end
    longer = replace(falloff, virtual_distance=scale * falloff.virtual_distance, start=scale * falloff.start, end=end)
    return replace(emission, color=(r, g, b), shadow=shadow, falloff=longer)
