"""Lights made of others: of another emission, or larger and moved with everything around them."""

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


def with_emission(light: Light, emission: Emission) -> Light:
    """Return a light that sends something else."""
    if isinstance(light, LocalDome):
        return replace(light, dome=replace(light.dome, emission=emission))
    return replace(light, emission=emission)  # type: ignore[type-var]


def fitted(light: Light, scale: float, origin: Vector) -> Light:
    """Return a light whose lengths are `scale` times as long, moved from the world's origin to `origin`, in metres.

    What it lights is scaled and moved along: places at `scale` times their distance see the same radiance from it.
    """
    light = with_emission(light, scaled_emission(light.emission, scale))
    if isinstance(light, PlacedLight | LocalDome):
        light = replace(light, position=vector(scale * np.array(light.position) + np.array(origin)))
    match light:
        case Dome() | DistantLight():
            return light
        case LocalDome(radius=radius):
            return replace(light, radius=scale * radius)
        case RectLight(width=width, height=height):
            return replace(light, width=scale * width, height=scale * height)
        case DiskLight(radii=(x, y)):
            return replace(light, radii=(scale * x, scale * y))
        case SphereLight(radius=radius):
            return replace(light, radius=scale * radius)
        case CylinderLight(radius=radius, length=length):
            return replace(light, radius=scale * radius, length=scale * length)
    raise AssertionError(f"a light of kind '{light.kind}' has sizes that are not known here")


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
