"""The colour space in which light is computed: ACEScg, or linear Rec.709, the space of looks and lights.

Both are linear, so a matrix converts one to the other. OpenColorIO's built-in config defines this matrix. White stays
white, by Bradford's adaptation of D65 to the ACES white.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats

Color = tuple[float, float, float]
"""A linear colour: red, green and blue of a `Space`."""

Space = Literal["rec709", "acescg"]

REC709: Space = "rec709"
"""The space of all inputs, and of frames unless the job selects another space."""

OCIO_NAMES: dict[Space, str] = {"rec709": "Linear Rec.709 (sRGB)", "acescg": "ACEScg"}
"""The names of the spaces in OpenColorIO's built-in configs."""

INTEROP_IDS: dict[Space, str] = {"rec709": "lin_rec709_scene", "acescg": "lin_ap1_scene"}
"""The names of the spaces by the Color Interop Forum, for OpenEXR's ``colorInteropID``."""

OCIO_CONFIG = "cg-config-v2.2.0_aces-v1.3_ocio-v2.4"
"""The built-in config of OpenColorIO that defines both spaces."""

CHROMATICITIES: dict[Space, tuple[float, ...]] = {
    "rec709": (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290),
    # SMPTE ST 2065-1 and ACES S-2014-004: AP1, and the ACES white.
    "acescg": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
}
"""For each space, CIE x and y of red, of green, of blue and of white: eight numbers."""


# Lam, K. M. 1985. Metamerism and Colour Constancy. University of Bradford; as in ICC.1:2022, annex E.
# It maps X, Y, Z to the responses of the three cones, which an adaptation scales.
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def chromaticity_xyz(chromaticity: Sequence[float]) -> Floats:
    """Return X, Y, Z of a chromaticity x, y at Y = 1."""
    x, y = chromaticity
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def rgb_to_xyz_matrix(chromaticities: Sequence[float]) -> Floats:
    """Return the matrix (3, 3) from RGB to X, Y, Z, for primaries and white in the form of `CHROMATICITIES`."""
    columns = np.stack([chromaticity_xyz(chromaticities[i : i + 2]) for i in (0, 2, 4)], axis=-1)
    return np.asarray(columns * np.linalg.solve(columns, chromaticity_xyz(chromaticities[6:8])))


def white_adaptation(white: Sequence[float], to: Sequence[float]) -> Floats:
    """Return Bradford's matrix (3, 3) that adapts X, Y, Z from one white to another, both chromaticities x, y."""
    before, after = (_BRADFORD @ chromaticity_xyz(chromaticity) for chromaticity in (white, to))
    return np.asarray(np.linalg.inv(_BRADFORD) @ np.diag(after / before) @ _BRADFORD)


@cache
def matrix_from_rec709(space: Space) -> Floats:
    """Return the matrix (3, 3) that converts columns of linear Rec.709 to `space`; each of its rows sums to 1."""
    if space == REC709:
        return np.eye(3)
    import PyOpenColorIO as ocio  # not at the top: it takes 0.1 s, and few jobs need it

    config = ocio.Config.CreateFromBuiltinConfig(OCIO_CONFIG)
    processor = config.getProcessor(OCIO_NAMES[REC709], OCIO_NAMES[space]).getDefaultCPUProcessor()
    rows = np.array([processor.applyRGB(axis) for axis in np.eye(3).tolist()], np.float64)
    # OpenColorIO rounds to float32; the division makes white stay exactly white.
    matrix: Floats = (rows / rows.sum(axis=0)).T
    matrix.setflags(write=False)  # it is cached
    return matrix


def to_space(color: ArrayLike, space: Space) -> Floats:
    """Convert colours (..., 3) of linear Rec.709 to `space`."""
    return np.asarray(np.asarray(color, np.float64) @ matrix_from_rec709(space).T)


def to_rec709(color: ArrayLike, space: Space) -> Floats:
    """Convert colours (..., 3) of `space` to linear Rec.709, without clipping."""
    if space == REC709:
        return np.asarray(color, np.float64)
    return np.asarray(np.asarray(color, np.float64) @ np.linalg.inv(matrix_from_rec709(space)).T)


def error_in_rec709(error: ArrayLike, space: Space) -> Floats:
    """Convert standard errors (..., 3) of colours from `space` to linear Rec.709.

    The errors of the channels are taken as independent, so that their variances add.
    """
    variance = np.square(np.asarray(error, np.float64)) @ np.square(np.linalg.inv(matrix_from_rec709(space))).T
    return np.asarray(np.sqrt(variance))
