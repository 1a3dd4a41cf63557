"""Finds colour spaces by their names in USD and MaterialX, and converts colours to linear Rec.709."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from pxr import Gf, Usd

from lookdev.arrays import Floats
from lookdev.stage import prim_and_ancestors

_LINEAR = "lin_rec709_scene"
# The keys are names in MaterialX and USD, and names for data without a colour space. The values are "raw", "sRGB" or a
# name in USD (Gf.ColorSpaceNames). Linear Rec.709 needs no conversion, and therefore has the value "raw".
_NAMES = {
    **dict.fromkeys(("", "none", "raw", "data", "identity", "unknown", "lin_rec709", "lin_srgb", _LINEAR), "raw"),
    **dict.fromkeys(("sRGB", "srgb_texture", "srgb_rec709_scene"), "sRGB"),
    **dict.fromkeys(("acescg", "lin_ap1"), "lin_ap1_scene"),
    "g18_rec709": "g18_rec709_scene",
    "g22_rec709": "g22_rec709_scene",
    "rec709_display": "g24_rec709_scene",
    "g22_ap1": "g22_ap1_scene",
    "lin_adobergb": "lin_adobergb_scene",
    "adobergb": "g22_adobergb_scene",
    "lin_displayp3": "lin_p3d65_scene",
    "srgb_displayp3": "srgb_p3d65_scene",
}


def colorspace_named(name: str) -> str | None:
    """Return the name that `Texture.colorspace` has for a colour space: ``"raw"``, ``"sRGB"`` or one of USD's names.

    Return None for an unknown name.
    """
    colorspace = _NAMES.get(name, name)
    return colorspace if colorspace in ("raw", "sRGB") or Gf.ColorSpace.IsValid(colorspace) else None


def colorspace_of(attribute: Usd.Attribute) -> str:
    """Return the name of an attribute's colour space, or "".

    The colour space is authored on the attribute itself, or else on its prim or the prim's nearest ancestor that has
    one.
    """
    if attribute.HasColorSpace():
        return str(attribute.GetColorSpace())
    for prim in prim_and_ancestors(attribute.GetPrim()):
        if prim.HasAPI(Usd.ColorSpaceAPI) and (name := Usd.ColorSpaceAPI(prim).GetColorSpaceNameAttr().Get()):
            return str(name)
    return ""


def to_linear_rec709(color: ArrayLike, space: str) -> Floats:
    """Convert colours (..., 3) to linear Rec.709 from a space with a name of `colorspace_named`; white stays white."""
    value = np.asarray(color, np.float64)
    if space == "raw":
        return value
    if space == "sRGB":
        return srgb_to_linear(value)
    gamma, has_toe, matrix = _definition(space)
    if has_toe:
        value = srgb_to_linear(value)
    elif gamma != 1.0:
        value = np.maximum(value, 0.0) ** gamma
    return value @ matrix


def srgb_to_linear(encoded: ArrayLike) -> Floats:
    """Decode sRGB to linear values, by the piecewise curve of IEC 61966-2-1."""
    value = np.asarray(encoded, np.float64)
    # The power is computed only for values above the knee, since the values of a float image can be negative.
    return np.where(value <= 0.04045, value / 12.92, ((np.maximum(value, 0.04045) + 0.055) / 1.055) ** 2.4)


@cache
def _definition(space: str) -> tuple[float, bool, Floats]:
    """Return three values that define a colour space of USD.

    They are the exponent of the transfer curve, whether the curve is the sRGB curve instead, and the matrix (3, 3), for
    row vectors, to linear Rec.709.
    """
    source, target = Gf.ColorSpace(space), Gf.ColorSpace(_LINEAR)
    # The primaries can be converted without decoding, since every transfer curve maps 0 to 0 and 1 to 1.
    rows = [target.Convert(source, Gf.Vec3f(*axis)).GetRGB() for axis in np.eye(3).tolist()]
    return float(source.GetGamma()), source.GetLinearBias() > 0.0, np.array(rows, np.float64)
