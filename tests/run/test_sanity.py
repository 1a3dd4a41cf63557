from typing import Any

import numpy as np
import pytest

from lookdev.rendering.results import WorkerFrame
from lookdev.run.frame_file import frame_doubts


def frame(a: Any, b: Any, alpha: Any = 1.0) -> WorkerFrame:
    halves = (np.full((4, 6, 3), half, np.float32) for half in (a, b))
    return WorkerFrame(*halves, np.full((4, 6), alpha, np.float32), 8, 0.1, 0.01, blender="4.5", memory=1 << 20)


def doubts_about(rendered: WorkerFrame, beauty: Any = 0.5, **options: Any) -> list[str]:
    return list(frame_doubts(rendered, np.full((4, 6, 3), beauty, np.float32), **options))


def test_a_sound_frame_is_not_doubted() -> None:
    assert doubts_about(frame(0.25, 0.75)) == []
    assert doubts_about(frame(0.0, 0.75)) == []
    assert doubts_about(frame(0.5, 0.5), constant_light=True) == []


@pytest.mark.parametrize(
    ("rendered", "start"),
    [
        (frame(0.25, 0.75, 0.0), "is empty"),
        (frame(0.0, 0.0), "is black"),
        (frame(0.5, 0.5), "has two equal halves"),
    ],
)
def test_a_useless_frame_is_doubted(rendered: WorkerFrame, start: str) -> None:
    (doubt,) = doubts_about(rendered)
    assert doubt.startswith(start)


def test_pixels_that_are_too_bright_are_named() -> None:
    beauty = np.full((4, 6, 3), 0.5, np.float32)
    beauty[2, 3, 1] = np.inf
    (doubt,) = frame_doubts(frame(0.25, 0.75), beauty)
    assert doubt.startswith("has pixels brighter than 32-bit floats (1, the first in column 3, row 2)")
