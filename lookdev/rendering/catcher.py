"""A frame with a shadow catcher: the asset, and what it does to the light of the ground, in colour and alpha.

In a pixel, A is the light of the asset, and a its coverage. G is the light of the ground beside it, B that of the same
ground in a scene without the asset, and g the ground's coverage. With s the least G / B of the channels, at most 1,

    colour = A + G - s B        alpha = a + (1 - s) g

So s is the share of the ground's light that remains in all channels. The colour adds the rest of G: light that the
asset reflects onto the ground, its mirror image, and the colours of the shadow.

The frame over a picture of the bare ground is A + G, the picture of the asset on that ground, for any s: where a pixel
shows only ground or asset, ``1 - alpha`` is ``s g``, and B is a share g of the picture below. The frame over another
picture darkens that by s, too.

Both halves and the frame have the same s. The difference of the halves therefore measures the noise of B and of A + G,
the frame over the ground.
"""

from __future__ import annotations

import numpy as np

from lookdev.arrays import Floats
from lookdev.rendering.adaptive import Half
from lookdev.rendering.passes import CATCHER_ARRAYS


def combine_catcher_halves(first: Half, second: Half) -> tuple[Floats, Floats, Floats]:
    """Return the colours of both halves, A + G - s B, and the alpha of the frame."""
    ground, bare, ground_coverage = (
        0.5 * (_mean_part(first, name) + _mean_part(second, name)) for name in (*CATCHER_ARRAYS, "covered")
    )
    share = remaining_share(ground, bare)
    a, b = (half.color - share[..., None] * _mean_part(half, "bare") for half in (first, second))
    return a, b, 0.5 * (first.alpha + second.alpha) - share * ground_coverage[..., 0]


def remaining_share(ground: Floats, bare: Floats) -> Floats:
    """Return the share s (...) of light `bare` (..., 3) that remains in all channels of `ground`; 1 where it is 0."""
    ratio = np.divide(ground, bare, out=np.ones_like(bare), where=bare > 0.0)
    return np.asarray(np.clip(ratio.min(axis=-1), 0.0, 1.0))


def _mean_part(half: Half, name: str) -> Floats:
    return np.asarray(half.parts[name] / half.samples[..., None])
