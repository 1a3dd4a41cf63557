"""The space in which light is computed: linear Rec.709, in which looks and lights are given, or ACEScg.

Both are linear, so that one matrix leads from one to the other, as OpenColorIO's built-in config has it: white stays
white (Bradford's adaptation of D65 to the ACES white).
"""

from __future__ import annotations

from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats

Space = Literal["rec709", "acescg"]

REC709: Space = "rec709"
"""The space of everything that is given, and of frames unless a job asks for another."""

OCIO_NAMES: dict[Space, str] = {"rec709": "Linear Rec.709 (sRGB)", "acescg": "ACEScg"}
"""The spaces by their names in OpenColorIO's built-in configs."""

INTEROP_IDS: dict[Space, str] = {"rec709": "lin_rec709_scene", "acescg": "lin_ap1_scene"}
"""The spaces by their names of the Color Interop Forum, which OpenEXR's ``colorInteropID`` has."""

BASE = "cg-config-v2.2.0_aces-v1.3_ocio-v2.4"
"""The built-in config of OpenColorIO that knows them."""

CHROMATICITIES: dict[Space, tuple[float, ...]] = {
    "rec709": (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290),
    # SMPTE ST 2065-1 and ACES S-2014-004: AP1, and the ACES white.
    "acescg": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
}
"""CIE x and y of red, green, blue and white."""


@cache
def from_rec709(space: Space) -> Floats:
    """Return the matrix (3, 3) from columns of linear Rec.709 to those of a space; its rows sum up to 1."""
    if space == REC709:
        return np.eye(3)
    import PyOpenColorIO as ocio  # takes 0.1 s, which few jobs need

    config = ocio.Config.CreateFromBuiltinConfig(BASE)
    processor = config.getProcessor(OCIO_NAMES[REC709], OCIO_NAMES[space]).getDefaultCPUProcessor()
    rows = np.array([processor.applyRGB(axis) for axis in np.eye(3).tolist()], np.float64)
    # Rounded to float32 there: white stays exactly white.
    matrix: Floats = (rows / rows.sum(axis=0)).T
    matrix.setflags(write=False)  # it is cached
    return matrix


def to_space(color: ArrayLike, space: Space) -> Floats:
    """Return colours (..., 3) of linear Rec.709 in a space."""
    return np.asarray(np.asarray(color, np.float64) @ from_rec709(space).T)


def to_rec709(color: ArrayLike, space: Space) -> Floats:
    """Return colours (..., 3) of a space in linear Rec.709, not clipped."""
    if space == REC709:
        return np.asarray(color, np.float64)
    return np.asarray(np.asarray(color, np.float64) @ np.linalg.inv(from_rec709(space)).T)


def error_in_rec709(error: ArrayLike, space: Space) -> Floats:
    """Return the standard errors (..., 3) in linear Rec.709 of colours of a space whose channels err independently."""
    return np.asarray(
        np.sqrt(np.square(np.asarray(error, np.float64)) @ np.square(np.linalg.inv(from_rec709(space))).T)
    )
