"""Which lights can send light to a place at all."""

from __future__ import annotations

import math

import numpy as np

from lookdev.light.disk import DiskLight
from lookdev.light.placed import PlacedLight
from lookdev.light.placement import Vector, to_local
from lookdev.light.protocol import Light
from lookdev.light.rect import RectLight


def may_reach(light: Light, center: Vector, radius: float) -> bool:
    """Return whether light may arrive in a sphere, whatever occludes it; False is certain.

    A light of no colour, a rectangle or disk whose front is turned away, a cone that passes by, and a falloff that ends
    before it send none.
    """
    if not any(light.emission.color):
        return False
    if not isinstance(light, PlacedLight):
        return True
    local = to_local(light.axes, np.array(center) - np.array(light.position))
    if isinstance(light, RectLight | DiskLight) and local[2] >= radius:
        return False
    distance, wide = float(np.linalg.norm(local)), radius + light.reach
    falloff, shaping = light.emission.falloff, light.emission.shaping
    if falloff and falloff.end is not None and distance - radius >= falloff.end:
        return False
    if shaping is None or distance <= wide:
        return True
    # Seen from any point of the light, the sphere is in a cone of half angle asin(wide / distance) about its center.
    off_axis = math.acos(np.clip(-local[2] / distance, -1.0, 1.0))
    return off_axis - math.asin(wide / distance) <= shaping.cone[0]
