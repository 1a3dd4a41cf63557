"""The OpenColorIO config that ships, in ``data/lookdev.ocio``: ``python -m lookdev.output.config`` writes it.

It is OpenColorIO's built-in ACES CG config with one more view, ``lookdev``, on every display of standard range, and as
the default. The view does what Burley 2012, section 6.2, demands of a tone curve: it preserves colours over most of the
range of the display, and rolls off the top end while it preserves colour and contrast. Each colour is scaled in linear
Rec.709, so that its hue and saturation stay exactly the same. The scale is f(V) / V, where V is the value of HSV, the
largest of R, G and B. V is also the colour's luminance, divided by the largest luminance that Rec.709 shows with the
same hue and saturation.

    f(V) = V                                   for V <= KNEE
    f(V) = KNEE + a ln(1 + (V - KNEE) / a)     above, with a such that f(WHITE) = 1

f is continuous with its first derivative. Above WHITE all colours have V = 1.
"""

from __future__ import annotations

import math
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING

from lookdev.cache import write_file
from lookdev.space import OCIO_CONFIG, OCIO_NAMES, REC709

if TYPE_CHECKING:
    import PyOpenColorIO as ocio

KNEE = 0.6
"""V up to which the view leaves a colour unchanged: code value 203 of 255 on an sRGB display."""

WHITE = 64.0
"""V from which a colour becomes the brightest of its hue and saturation: 6 stops above 1."""

FILE = Path(__file__).with_name("data") / "lookdev.ocio"
NAME = "lookdev"
"""The name of the config, and of the view that is added to it."""

_SOURCE = OCIO_NAMES[REC709]
_STANDARD_RANGE_DISPLAYS = ("sRGB - Display", "Display P3 - Display", "Rec.1886 Rec.709 - Display", "P3-D65 - Display")
_UNREACHED_KNEE = 2.0  # hue and saturation are smaller, so that the curve leaves these two channels unchanged


def shoulder_scale(knee: float = KNEE, white: float = WHITE) -> float:
    """Return a, the scale of the logarithm in f, for a knee and a white; ``0 < knee < 1 < white``."""
    from scipy.optimize import brentq  # not at the top: a render does not need it

    scale: float = brentq(lambda a: knee + a * math.log1p((white - knee) / a) - 1.0, 1e-6, 1e6, xtol=1e-15)
    return round(scale, 12)  # so that every machine writes the same text


def make_config() -> ocio.Config:
    """Return the config that ships: OpenColorIO's built-in config with the view ``lookdev`` added."""
    import PyOpenColorIO as ocio

    config = ocio.Config.CreateFromBuiltinConfig(OCIO_CONFIG)
    config.setName(NAME)
    config.setDescription(f"{OCIO_CONFIG}, with the view '{NAME}': hue and saturation stay while highlights roll off")
    transform = ocio.ViewTransform(ocio.REFERENCE_SPACE_SCENE, name=NAME)
    transform.setDescription(f"V of HSV in linear Rec.709 is kept up to {KNEE:g}, and rolls off to 1 at {WHITE:g}")
    to_rec709 = config.getColorSpace(_SOURCE).getTransform(ocio.COLORSPACE_DIR_FROM_REFERENCE)
    from_rec709 = deepcopy(to_rec709)
    from_rec709.setDirection(ocio.TRANSFORM_DIR_INVERSE)
    plain = config.getViewTransform("Un-tone-mapped").getTransform(ocio.VIEWTRANSFORM_DIR_FROM_REFERENCE)
    hsv = ocio.FixedFunctionTransform(ocio.FIXED_FUNCTION_RGB_TO_HSV)
    rgb = ocio.FixedFunctionTransform(ocio.FIXED_FUNCTION_RGB_TO_HSV, direction=ocio.TRANSFORM_DIR_INVERSE)
    # A negative channel, which Rec.709 does not show, would change the hue in HSV.
    non_negative = ocio.RangeTransform(minInValue=0.0, minOutValue=0.0)
    at_most_one = ocio.RangeTransform(maxInValue=1.0, maxOutValue=1.0)
    steps = [to_rec709, non_negative, hsv, _curve_transform(), at_most_one, rgb, from_rec709, plain]
    transform.setTransform(ocio.GroupTransform(steps), ocio.VIEWTRANSFORM_DIR_FROM_REFERENCE)
    config.addViewTransform(transform)
    config.addSharedView(NAME, NAME, "<USE_DISPLAY_NAME>")
    for display in config.getDisplays():
        if display in _STANDARD_RANGE_DISPLAYS:
            config.addDisplaySharedView(display, NAME)
    config.setActiveViews(", ".join([NAME, *(f'"{view}"' for view in config.getActiveViews())]))
    config.validate()
    return config


def _curve_transform() -> ocio.LogCameraTransform:
    """Return the transform of hue, saturation and V that applies f to V, and leaves hue and saturation unchanged."""
    import PyOpenColorIO as ocio

    a = shoulder_scale()
    knees = (_UNREACHED_KNEE, _UNREACHED_KNEE, KNEE)
    return ocio.LogCameraTransform(
        base=math.e,
        linSideBreak=knees,
        logSideSlope=[a] * 3,
        logSideOffset=knees,
        linSideSlope=[1.0 / a] * 3,
        linSideOffset=[1.0 - knee / a for knee in knees],
        linearSlope=[1.0] * 3,
    )


if __name__ == "__main__":
    write_file(FILE, make_config().serialize())
