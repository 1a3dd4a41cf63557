"""A rendered frame, and the rounds in which it is rendered, of whichever renderer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookdev.scene import Sampling

Image = NDArray[np.float32]

# Samples of a half in the first round towards a target error.
_FIRST_ROUND = 8


@dataclass(frozen=True)
class RenderedFrame:
    """Half renders (H, W, 3), coverage (H, W), rows top-down, exposure not applied; samples over both halves.

    A frame as a user of Cycles would have it is one render: `a` and `b` are equal, and `relmse` is nan. `raw` is the
    mean of the halves before they were denoised, `raw_relmse` its error.
    """

    a: Image
    b: Image
    alpha: Image
    samples: int
    seconds: float
    relmse: float
    raw: Image | None = None
    raw_relmse: float | None = None


Progress = Callable[[int, int, float | None], None]
"""Called with the samples done, the samples planned, and the relMSE so far."""


def rounds(sampling: Sampling) -> Iterator[int]:
    """Yield the samples a pixel of each half by rounds: powers of two, as only such blocks are stratified.

    The fewest rounds with the sum that is set; with a target error, each round doubles the total up to the sum.
    """
    left = sampling.samples // 2
    size = _FIRST_ROUND if sampling.error is not None else left
    while left:
        size = 1 << (min(size, left).bit_length() - 1)
        yield size
        left -= size
        if sampling.error is not None:
            size = max(size, sampling.samples // 2 - left)
