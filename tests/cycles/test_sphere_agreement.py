"""Frames of Cycles against the float64 reference: a sphere in a constant environment, under studio and under city."""

from __future__ import annotations

import pytest
from agreement import assert_agreement
from conftest import POSE, RenderScene
from looks import LOOKS

from lookdev.reference.shapes import Sphere

pytestmark = pytest.mark.cycles

SIZE, SAMPLES, SEEDS = 48, 32, 8

QUICK = [("white", "diffuse"), ("studio", "coated"), ("city", "brushed"), ("city", "painted")]
REFLECTING = ("diffuse", "cloth", "coated", "brushed", "polished", "painted", "chrome")
# Under white light a mirror has no noise but that of light samples, of which one in 10,000 falls into its cone: some
# pixels have one and are 5e-3 too bright, most have none and are 1e-4 too dark.
ALL = [(ibl, look) for ibl in ("white", "studio", "city") for look in REFLECTING if (ibl, look) != ("white", "chrome")]


@pytest.mark.parametrize(
    ("ibl", "look"),
    [pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow) for case in ALL],
)
def test_sphere_agrees_within_its_own_noise(ibl: str, look: str, render: RenderScene, light_of) -> None:
    light = light_of(ibl)
    frames = [render("sphere", LOOKS[look], light, samples=SAMPLES, seed=seed, size=SIZE) for seed in range(SEEDS)]
    assert_agreement(frames, LOOKS[look], Sphere(), 1.0, light, POSE)
