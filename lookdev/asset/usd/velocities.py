"""Points between time samples, extrapolated by velocities from the sample before.

This is UsdGeom's rule for motion whose number of points changes between samples, as in a simulation.
"""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from lookdev.arrays import Floats
from lookdev.asset.usd.attributes import checked_array, read_array


def points_from_velocities(prim: Usd.Prim, time: Usd.TimeCode) -> Floats | None:
    """Return the points (n, 3) of a point-based prim at a time; None if it has no velocities.

    Velocities that do not fit the points of the sample before have no effect; USD warns about them. Raises AssetError
    if the value of an attribute is not an array of vectors of three numbers.
    """
    if not prim.GetAttribute("velocities").HasAuthoredValue():
        return None
    for name in ("points", "velocities", "accelerations"):
        read_array(prim, name, time, np.float64, (3,))
    point_based = UsdGeom.PointBased(prim)
    time = sample_time(time, point_based.GetPointsAttr())
    return checked_array(point_based.ComputePointsAtTime(time, time), prim, "points", np.float64, (3,))


def sample_time(time: Usd.TimeCode, attribute: Usd.Attribute) -> Usd.TimeCode:
    """Return the time of an attribute's first sample for the earliest time, which USD cannot extrapolate from."""
    samples = attribute.GetTimeSamples() if time.IsEarliestTime() else ()
    return Usd.TimeCode(samples[0]) if samples else time
