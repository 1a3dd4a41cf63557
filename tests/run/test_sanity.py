from typing import Any

import numpy as np
import pytest

from lookdev.rendering.results import Rendered
from lookdev.run.sanity import doubts


def frame(a: Any, b: Any, alpha: Any = 1.0) -> Rendered:
    halves = (np.full((4, 6, 3), half, np.float32) for half in (a, b))
    return Rendered(*halves, np.full((4, 6), alpha, np.float32), 8, 0.1, 0.01, "4.5", 1 << 20)


def of(rendered: Rendered, beauty: Any = 0.5, **options: Any) -> list[str]:
    return list(doubts(rendered, np.full((4, 6, 3), beauty, np.float32), **options))


def test_a_sound_frame_has_none() -> None:
    assert of(frame(0.25, 0.75)) == []
    assert of(frame(0.0, 0.75)) == []
    assert of(frame(0.5, 0.5), constant_light=True) == []


@pytest.mark.parametrize(
    ("rendered", "doubt"),
    [
        (frame(0.25, 0.75, 0.0), "is empty"),
        (frame(0.0, 0.0), "is black"),
        (frame(0.5, 0.5), "has two equal halves"),
    ],
)
def test_what_nobody_meant_is_doubted(rendered: Rendered, doubt: str) -> None:
    (said,) = of(rendered)
    assert said.startswith(doubt)


def test_pixels_that_are_too_bright_are_named() -> None:
    beauty = np.full((4, 6, 3), 0.5, np.float32)
    beauty[2, 3, 1] = np.inf
    (said,) = doubts(frame(0.25, 0.75), beauty)
    assert said.startswith("has pixels brighter than a number of 32 bits (1, the first in column 3, row 2)")
