"""A lobe in its own frame, where it is a reflection and symmetric about one view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookdev.brdf import Lobe
from lookdev.brdf.lobes import Directions

Floats = NDArray[np.float64]


def half_vector_view(lobe: Lobe, wo: Floats) -> Floats:
    """Return the view (3,) in the lobe's frame whose half vectors the lobe depends on."""
    if lobe.name in ("specularTransmission", "refraction") or lobe.model == "lafortune":
        # The middle of the highlight, where the half vector is the normal, mirrors the refracted view; a lobe of
        # Lafortune's has a direction of its own, which may be below the horizon.
        middle = np.ravel(lobe.sample(np.zeros(1), np.zeros(1)))
        if middle[2] > 0.0:
            return middle * [-1.0, -1.0, 1.0]
    return np.ravel(lobe.frame.to_local(wo))


def sent(lobe: Lobe, wo: Floats, wi: Floats) -> Floats:
    """Return f times the lobe's own cosine, (..., 3), at directions of the lobe's frame.

    Of a lobe that does not cross it, the surface's horizon cuts a part off.
    """
    local = np.broadcast_to(lobe.frame.to_local(wo), wi.shape)
    there = (wi[..., 2] > 0.0) & (lobe.crosses | (lobe.frame.from_local(wi)[..., 2] > 0.0))
    return lobe.evaluate(Directions.of(local, wi)) * np.where(there, wi[..., 2], 0.0)[..., None]
