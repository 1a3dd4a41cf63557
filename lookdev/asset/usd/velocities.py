"""Points between the samples of their animation, where velocities carry them on from the sample before.

UsdGeom's rule for motion whose number of points changes from sample to sample, as that of a simulation.
"""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from lookdev.asset.shape import Doubles
from lookdev.asset.usd.attributes import checked_array, read_array


def carried_points(prim: Usd.Prim, time: Usd.TimeCode) -> Doubles | None:
    """Return the points (n, 3) of a point-based prim at a time, None where it has no velocities.

    Velocities that do not fit the points of the sample before have no effect; USD says why. Raises AssetError where
    an attribute is not an array of three numbers a value.
    """
    if not prim.GetAttribute("velocities").HasAuthoredValue():
        return None
    for name in ("points", "velocities", "accelerations"):
        read_array(prim, name, time, np.float64, (3,))
    based = UsdGeom.PointBased(prim)
    time = numbered(time, based.GetPointsAttr())
    return checked_array(based.ComputePointsAtTime(time, time), prim, "points", np.float64, (3,))


def numbered(time: Usd.TimeCode, attribute: Usd.Attribute) -> Usd.TimeCode:
    """Return the time of an attribute's first sample for the earliest time, from which nothing can be carried on."""
    samples = attribute.GetTimeSamples() if time.IsEarliestTime() else ()
    return Usd.TimeCode(samples[0]) if samples else time
