"""Rectangle light: `UsdLuxRectLight`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lookdev.cache import Content
from lookdev.light.emission import check_number
from lookdev.light.dome.files import read_exr
from lookdev.light.placed import PlacedLight

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RectLight(PlacedLight):
    """A rectangle of `width` along its x and `height` along its y, in metres, that emits along its -z.

    `texture` is an EXR of R, G, B, linear Rec.709, by which the emission is multiplied, as `prepare_texture` writes it:
    the first texel of its top row is at (+x, +y), so that it is upright and not mirrored for whom it shines on.
    """

    kind: ClassVar[str] = "rect"

    width: float
    height: float
    texture: Content | None = None
