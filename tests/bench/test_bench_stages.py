"""Every stage of the profile renders: a part is missing, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from lookdev.bench.backends import POSE, shot_of
from lookdev.bench.matrix import Cell
from lookdev.bench.profile import stages
from lookdev.render.task import one_frame
from lookdev.render.worker import renderer

pytestmark = pytest.mark.cycles


@pytest.mark.parametrize("look", ["plastic", "metal"])
def test_stages_render(look: str) -> None:
    made = stages(Cell("shaderball", "studio", look), 24)
    with renderer() as render:
        shots = [
            shot_of(render(one_frame(each.scene, POSE, f"{number}", samples=16))) for number, each in enumerate(made)
        ]
    whole = shots[0]
    covered = whole.alpha > 0.99
    for shot in shots:
        # The same rays of the camera, whatever is shown.
        np.testing.assert_array_equal(shot.alpha, whole.alpha)
        assert shot.image[covered].mean() > 0.0
    means = [float(shot.image[covered].mean()) for shot in shots]
    # Without bounces light is missing; without rays none is occluded.
    assert means[1] < means[0]
    assert means[2] > means[1]
    for shot in shots[-2:]:
        np.testing.assert_allclose(shot.image[covered], 1.0, rtol=1e-6)
