"""Doubts about a frame, from its pixels alone: faults of inputs and of renderers that produce a useless picture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from lookdev.rendering.results import Rendered


def frame_doubts(rendered: Rendered, beauty: ArrayLike, *, constant_light: bool = False) -> Iterator[str]:
    """Yield the doubts about a frame, each as a sentence whose subject, the frame, is left out.

    Parameters
    ----------
    rendered
        The halves and the alpha.
    beauty : (H, W, 3)
        The mean of the halves, exposed, as in the file.
    constant_light
        The radiance is the same from all directions: the halves may then be equal.
    """
    bright = ~np.isfinite(beauty).all(axis=-1)
    if bright.any():
        y, x = np.argwhere(bright)[0]
        yield (
            f"has pixels brighter than a number of 32 bits ({bright.sum()}, the first in column {x}, row {y}); a lower"
            " exposure of its light would be right"
        )
    covered = rendered.alpha > 0.0
    if not covered.any():
        yield "is empty: no part of the asset is in the picture"
        return
    is_black = not ((rendered.a[covered] != 0.0).any() or (rendered.b[covered] != 0.0).any())
    if is_black:
        yield "is black: no light reaches the viewer from the asset"
    elif not constant_light and np.array_equal(rendered.a, rendered.b):
        yield "has two equal halves: its error is unknown, though it is stated as 0"
