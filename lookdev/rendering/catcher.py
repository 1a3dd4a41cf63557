"""A frame with a shadow catcher: the asset, and what it does to the light of the ground, in colour and alpha.

Of a pixel, A is the light of the asset, and a its coverage. Of the ground that the camera sees beside it, G is the
light, B that without the asset, and g the coverage. With s the least of G / B over the channels, at most 1,

    colour = A + G - s B        alpha = a + (1 - s) g

So s is what of the ground's light remains in all channels, and the colour adds what more there is: light that the asset
reflects onto the ground, its mirror image, and colours of the shadow. Laid over a picture of the ground without the
asset, the result is A + G, the picture of the asset on that ground, whatever s is: where all is ground or asset,
``1 - alpha`` is ``s g``, and of the picture ``g`` shows B. Over another picture, s darkens it as it does the ground.

One s serves both halves, as it serves the frame. So their difference measures the noise of A + G, which is that of the
frame over the ground, and of B.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookdev.rendering.adaptive import Half
from lookdev.rendering.passes import CATCHER

Floats = NDArray[np.float64]


def caught_pictures(first: Half, second: Half) -> tuple[Floats, Floats, Floats]:
    """Return the colours of both halves over what they leave of the ground's light, and the alpha of the frame."""
    ground, bare, covered = (0.5 * (_part(first, name) + _part(second, name)) for name in (*CATCHER, "covered"))
    kept = remaining(ground, bare)
    a, b = (half.color - kept[..., None] * _part(half, "bare") for half in (first, second))
    return a, b, 0.5 * (first.alpha + second.alpha) - kept * covered[..., 0]


def remaining(ground: Floats, bare: Floats) -> Floats:
    """Return the share s (...) of light `bare` (..., 3) that remains in all channels of `ground`; 1 without light."""
    ratio = np.divide(ground, bare, out=np.ones_like(bare), where=bare > 0.0)
    return np.asarray(np.clip(ratio.min(axis=-1), 0.0, 1.0))


def _part(half: Half, name: str) -> Floats:
    return np.asarray(half.parts[name] / half.samples[..., None])
