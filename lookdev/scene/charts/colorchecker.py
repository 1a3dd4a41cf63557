"""The 24 patches of the ColorChecker Classic: published colours, and reflectances in linear Rec.709.

The published numbers are CIE 1976 L*a*b* under illuminant D50, of charts made after November 2014. They are converted
to X, Y, Z, adapted from the white D50 to D65 (Bradford), and converted to Rec.709. The results are the pixel values of
a chart under white light of radiance 1. Cyan lies outside Rec.709: its red is -0.0439, and is set to 0 here, because a
reflectance is not negative.

References
----------
- X-Rite. 2016. New color specifications for ColorChecker SG and Classic charts. The L*a*b* of the Classic chart.
- CIE 015:2018. Colorimetry. CIE 1976 L*a*b*; the white points of D50 and D65, as in ICC.1:2022 and ITU-R BT.709.
- Lam, K. M. 1985. Metamerism and Colour Constancy. University of Bradford. The adaptation, as in ICC.1:2022, annex E.
"""

from __future__ import annotations

import numpy as np

from lookdev.arrays import Floats
from lookdev.space import CHROMATICITIES, chromaticity_xyz, rgb_to_xyz_matrix, white_adaptation

PATCHES: dict[str, tuple[float, float, float]] = {
    "dark skin": (37.54, 14.37, 14.92),
    "light skin": (64.66, 19.27, 17.50),
    "blue sky": (49.32, -3.82, -22.54),
    "foliage": (43.46, -12.74, 22.72),
    "blue flower": (54.94, 9.61, -24.79),
    "bluish green": (70.48, -32.26, -0.37),
    "orange": (62.73, 35.83, 56.50),
    "purplish blue": (39.43, 10.75, -45.17),
    "moderate red": (50.57, 48.64, 16.67),
    "purple": (30.10, 22.54, -20.87),
    "yellow green": (71.77, -24.13, 58.19),
    "orange yellow": (71.51, 18.24, 67.37),
    "blue": (28.37, 15.42, -49.80),
    "green": (54.38, -39.72, 32.27),
    "red": (42.43, 51.05, 28.62),
    "yellow": (81.80, 2.67, 80.41),
    "magenta": (50.63, 51.28, -14.12),
    "cyan": (49.57, -29.71, -28.32),
    "white 9.5": (95.19, -1.03, 2.93),
    "neutral 8": (81.29, -0.57, 0.44),
    "neutral 6.5": (66.89, -0.75, -0.06),
    "neutral 5": (50.76, -0.13, 0.14),
    "neutral 3.5": (35.63, -0.46, -0.48),
    "black 2": (20.64, 0.07, -0.46),
}
"""L*, a* and b* of each patch under D50. The order is the chart's, four rows of six from the upper left."""

GREY_REFLECTANCE = 0.18
"""The reflectance of the grey ball."""

_D50 = 0.34567, 0.35850  # the chromaticity x, y


def patch_colors() -> Floats:
    """Return the reflectances of the patches, (24, 3), linear Rec.709 in [0, 1]."""
    return np.clip(patch_xyz() @ _to_rec709().T, 0.0, 1.0)


def patch_xyz() -> Floats:
    """Return X, Y, Z of the patches under D50, (24, 3), relative to Y = 1 of the white."""
    lightness, a, b = np.array(list(PATCHES.values())).T
    # f is the function in the CIE's definition of L*a*b*; its arguments are X, Y and Z relative to the white.
    y = (lightness + 16.0) / 116.0
    f = np.stack([y + a / 500.0, y, y - b / 200.0], axis=-1)
    linear = 3.0 * (6.0 / 29.0) ** 2 * (f - 4.0 / 29.0)
    return np.asarray(np.where(f > 6.0 / 29.0, f**3, linear) * chromaticity_xyz(_D50))


def _to_rec709() -> Floats:
    """Return the matrix (3, 3) from X, Y, Z under D50 to linear Rec.709."""
    rec709 = CHROMATICITIES["rec709"]
    return np.asarray(np.linalg.inv(rgb_to_xyz_matrix(rec709)) @ white_adaptation(_D50, rec709[6:8]))
