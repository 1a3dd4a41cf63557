"""The colour and alpha of a frame with a shadow catcher: the asset, its shadow, and its reflection on the ground.

`lookdev.cycles` renders each half of the frame three times, and combines the pictures by this module. In a pixel, A is
the light of the asset, and a its coverage. G is the light of the ground in the scene with the asset, B is the light of
the same ground in the scene without the asset, and g is the ground's coverage. The share s is the smallest G / B of the
three channels, at most 1. Then

    colour = A + G - s B        alpha = a + (1 - s) g

So s is the share of the ground's light that remains in every channel, and ``1 - s`` is the opacity of the shadow. The
colour contains the rest of G: light that the asset reflects onto the ground, its mirror image, and the colours of the
shadow.

Composited over a picture of the bare ground, the frame gives A + G for any s: the picture of the asset on that ground.
In a pixel that shows nothing but asset and ground, a + g is 1, so ``1 - alpha`` is ``s g``. The picture of the bare
ground is B / g there, and adds s B to the colour. Another picture below is multiplied by s in the same way, where the
frame shows the ground.

Both halves and the frame have the same s. The difference of the halves therefore measures the noise of B and of A + G,
the frame over the ground.
"""

from __future__ import annotations

import numpy as np

from lookdev.arrays import Floats
from lookdev.rendering.adaptive import Half
from lookdev.rendering.passes import CATCHER_ARRAYS


def combine_catcher_halves(first: Half, second: Half) -> tuple[Floats, Floats, Floats]:
    """Return the colour of each half (H, W, 3), A + G - s B, and the alpha (H, W) of the frame.

    The `color` of a half is A + G, and its `alpha` is a + g. Of its `parts`, ``ground`` is G, ``bare`` is B, and
    ``covered`` is g in each of three channels.
    """
    ground, bare, ground_coverage = (
        0.5 * (_mean_part(first, name) + _mean_part(second, name)) for name in (*CATCHER_ARRAYS, "covered")
    )
    share = remaining_share(ground, bare)
    a, b = (half.color - share[..., None] * _mean_part(half, "bare") for half in (first, second))
    return a, b, 0.5 * (first.alpha + second.alpha) - share * ground_coverage[..., 0]


def remaining_share(ground: Floats, bare: Floats) -> Floats:
    """Return the share s (...) of the light `bare` (..., 3) that remains in every channel of `ground` (..., 3).

    ``...`` stands for the axes of the pixels. Where a channel of `bare` is 0, its ratio counts as 1.
    """
    ratio = np.divide(ground, bare, out=np.ones_like(bare), where=bare > 0.0)
    return np.asarray(np.clip(ratio.min(axis=-1), 0.0, 1.0))


def _mean_part(half: Half, name: str) -> Floats:
    """Return the mean over samples of a part of a half's light, (H, W, 3)."""
    return np.asarray(half.parts[name] / half.samples[..., None])
