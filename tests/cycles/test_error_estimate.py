"""A frame's own error estimate against its error: within a factor of two, for every one of eight seeds."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import RenderScene
from looks import LOOKS

from lookdev.checks.error import relmse

pytestmark = pytest.mark.cycles

SAMPLES = 16

QUICK = [("sphere", "city", "coated")]
ALL = [
    *QUICK,
    *(("sphere", ibl, look) for ibl in ("white", "studio", "city") for look in LOOKS if (ibl, look) != QUICK[0][1:]),
    *(("shaderball", ibl, look) for ibl in ("studio", "city") for look in ("coated", "brushed")),
]


@pytest.mark.parametrize(
    ("asset", "ibl", "look"),
    [pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow) for case in ALL],
)
def test_estimate_is_honest(asset: str, ibl: str, look: str, render: RenderScene, light_of) -> None:
    light = light_of(ibl)
    converged = render(asset, LOOKS[look], light, samples=64 * SAMPLES, seed=1000)
    truth = (converged.a + converged.b) / 2
    ratios = []
    for seed in range(8):
        frame = render(asset, LOOKS[look], light, samples=SAMPLES, seed=seed)
        ratios.append(frame.relmse / relmse((frame.a + frame.b) / 2, truth, frame.alpha))
    assert min(ratios) > 0.5, ratios
    assert max(ratios) < 2.0, ratios


def test_error_target_adds_samples_until_it_is_reached(render: RenderScene, light_of) -> None:
    light = light_of("studio")
    coarse = render("sphere", LOOKS["coated"], light, samples=4096, error=1e-2)
    fine = render("sphere", LOOKS["coated"], light, samples=4096, error=1e-3)
    assert coarse.relmse <= 1e-2
    assert fine.relmse <= 1e-3
    assert coarse.samples < fine.samples < 4096
    # More rounds must not repeat the samples of the first: then the error would stay where it was.
    assert np.abs(coarse.a - fine.a).max() > 0.0
