"""What is wrong with a frame by its look alone: faults of inputs and of renderers that leave a picture nobody meant."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from lookdev.rendering.results import Rendered


def doubts(rendered: Rendered, beauty: ArrayLike, *, constant_light: bool = False) -> Iterator[str]:
    """Yield what is to be doubted in a frame, each as a sentence without its name.

    Parameters
    ----------
    rendered
        The halves and the alpha.
    beauty : (H, W, 3)
        Their mean, exposed, as it is written.
    constant_light
        The light is the same from everywhere: halves may then be equal.
    """
    wrong = ~np.isfinite(beauty).all(axis=-1)
    if wrong.any():
        y, x = np.argwhere(wrong)[0]
        yield (
            f"has pixels brighter than a number of 32 bits ({wrong.sum()}, the first in column {x}, row {y}); a lower"
            " exposure of its light would be right"
        )
    covered = rendered.alpha > 0.0
    if not covered.any():
        yield "is empty: no part of the asset is in the picture"
        return
    lit = (rendered.a[covered] != 0.0).any() or (rendered.b[covered] != 0.0).any()
    if not lit:
        yield "is black: no light reaches the viewer from the asset"
    elif not constant_light and np.array_equal(rendered.a, rendered.b):
        yield "has two equal halves: its error is unknown, though it is stated as 0"
