"""Frames of Cycles against the float64 reference: a sphere in a constant environment, under studio and under city."""

from __future__ import annotations

import numpy as np
import pytest
from agreement import assert_agreement, relative_difference
from frames import RenderScene
from looks import LOOKS, quick_among

pytestmark = pytest.mark.cycles

SIZE, SAMPLES, SEEDS = 48, 32, 8

QUICK = [("white", "diffuse"), ("studio", "coated"), ("city", "brushed"), ("city", "painted")]
REFLECTING = ("diffuse", "cloth", "coated", "brushed", "polished", "painted", "chrome")
# White light is not sampled, and directions of a shiny surface weigh alike but for the few below its horizon: the noise
# is two-valued, and the estimated error of a pixel without any of these is too small.
TWO_VALUED = ("coated", "polished", "chrome")
LIGHTS = ("white", "studio", "city")
ALL = [(ibl, look) for ibl in LIGHTS for look in REFLECTING if not (ibl == "white" and look in TWO_VALUED)]


@pytest.mark.parametrize(("ibl", "look"), quick_among(ALL, QUICK))
def test_sphere_agrees_within_its_own_noise(ibl: str, look: str, render: RenderScene, light_of) -> None:
    light = light_of(ibl)
    # With few samples, the noise at the edge of a mirrored lamp is two-valued, not Student's.
    samples = 4 * SAMPLES if (ibl, look) == ("studio", "polished") else SAMPLES
    frames = [render("sphere", LOOKS[look], light, samples=samples, seed=seed, size=SIZE) for seed in range(SEEDS)]
    assert_agreement(frames, LOOKS[look], "sphere", light)


@pytest.mark.proof
@pytest.mark.parametrize("look", TWO_VALUED)
def test_a_shiny_sphere_agrees_in_white_light(look: str, render: RenderScene, light_of) -> None:
    light = light_of("white")
    frames = [render("sphere", LOOKS[look], light, samples=128, seed=seed, size=SIZE) for seed in range(16)]
    difference = relative_difference(frames, LOOKS[look], light)
    assert abs(difference.mean()) < 2e-4
    assert np.abs(difference).max() < 1.5e-2
