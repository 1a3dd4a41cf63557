"""A frame's own error estimate against its error: within a factor of two, for every one of eight seeds.

The estimate is for frames that can be used: where rare bright paths carry most of the light (relMSE above about 0.1,
polished metal in the shaderball's recess) it errs on the safe side, by up to 20 at relMSE 1.
"""

from __future__ import annotations

import pytest
from frames import RenderScene
from looks import LOOKS, quick_among

from lookdev.metrics import relmse

pytestmark = pytest.mark.cycles

QUICK = [("sphere", "city", "coated", 16)]
ALL = [
    # The mirrored lamps of studio are a few pixels' edges: with 8 samples in each half the spread of their own squares
    # takes one seed of eight to 2.1.
    *(
        ("sphere", ibl, look, 64 if (ibl, look) == ("studio", "polished") else 16)
        for ibl in ("white", "studio", "city")
        for look in ("diffuse", "cloth", "coated", "brushed", "polished", "painted", "leaf")
    ),
    # Indirect light has rarer, brighter paths: 64 samples bring the frame below relMSE 0.1.
    *(("shaderball", ibl, look, 64) for ibl in ("studio", "city") for look in ("diffuse", "coated")),
]


@pytest.mark.parametrize(("asset", "ibl", "look", "samples"), quick_among(ALL, QUICK))
def test_estimate_is_honest(asset: str, ibl: str, look: str, samples: int, render: RenderScene, light_of) -> None:
    light = light_of(ibl)
    converged = render(asset, LOOKS[look], light, samples=64 * samples, seed=1000)
    truth = (converged.a + converged.b) / 2
    ratios = []
    for seed in range(8):
        frame = render(asset, LOOKS[look], light, samples=samples, seed=seed)
        ratios.append(frame.relmse / relmse((frame.a + frame.b) / 2, truth, frame.alpha))
    assert min(ratios) > 0.5, ratios
    assert max(ratios) < 2.0, ratios


def test_error_target_adds_samples_until_it_is_reached(render: RenderScene, light_of) -> None:
    light = light_of("studio")
    coarse = render("sphere", LOOKS["coated"], light, samples=4096, error=2e-2)
    fine = render("sphere", LOOKS["coated"], light, samples=4096, error=1e-3)
    assert coarse.relmse <= 2e-2
    assert fine.relmse <= 1e-3
    assert coarse.samples < fine.samples < 4096
    # Rounds that repeated each other's samples would lower the estimate's hopes, not the error.
    converged = render("sphere", LOOKS["coated"], light, samples=2048, seed=1000)
    truth = (converged.a + converged.b) / 2
    assert relmse((fine.a + fine.b) / 2, truth, fine.alpha) < 2e-3
