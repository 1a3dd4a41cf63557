"""Indirect light: a white furnace, in which a mirror that loses nothing shows the environment wherever it reflects it.

Light that leaves the recess of the shaderball has been reflected several times; each reflection passes a ray portal.
"""

import numpy as np
import pytest
from frames import RenderScene

from lookdev.material import Layer

pytestmark = pytest.mark.cycles

# F is 1 for a white metal at every angle; at this roughness masking takes less than 1e-4 of a reflection.
MIRROR = (Layer("Mirror", "disney", {"baseColor": (1.0, 1.0, 1.0), "metallic": 1.0, "roughness": 0.1}),)


def test_a_lossless_mirror_vanishes_in_a_white_furnace(render: RenderScene, light_of) -> None:
    light = light_of("white")
    means = {}
    for bounces in (0, 1, 16):
        frame = render("shaderball", MIRROR, light, samples=32, size=32, bounces=bounces)
        inside = frame.alpha == 1.0
        means[bounces] = float(((frame.a + frame.b) / 2)[inside].mean())
    values = list(means.values())
    # Each bounce brings light that the ones before had lost, and none brings more than there is.
    assert values == sorted(values)
    assert values[0] < 0.95
    assert means[16] == pytest.approx(1.0, abs=5e-3)
    assert np.isfinite(values).all()
