"""A frame's own error estimate against its error: within a factor of two, for every one of eight seeds; and denoising.

The estimate is for frames that can be used: where rare bright paths carry most of the light (relMSE above about 0.1,
polished metal in the shaderball's recess) it errs on the safe side, by up to 20 at relMSE 1.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from frames import RenderScene
from looks import LOOKS, quick_among

from lookdev.light import Dome
from lookdev.material import Layer
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
    fine = render("sphere", LOOKS["coated"], light, samples=4096, error=2e-3)
    assert coarse.relmse <= 2e-2
    assert fine.relmse <= 2e-3
    assert coarse.samples < fine.samples < 4096
    # Rounds that repeated each other's samples would lower the estimate's hopes, not the error.
    converged = render("sphere", LOOKS["coated"], light, samples=1024, seed=1000)
    truth = (converged.a + converged.b) / 2
    assert relmse((fine.a + fine.b) / 2, truth, fine.alpha) < 4e-3


TARGET = 6e-3  # between the errors of the first round, raw and denoised
COPPER = Layer("copper", "disney", {"metallic": 1.0, "roughness": 0.35, "baseColor": (0.9, 0.5, 0.3)})


def test_a_denoised_frame_is_nearer_and_its_error_is_measured(render: RenderScene, light_of: Callable[[str], Dome]):
    def frame(**given):
        return render("shaderball", [COPPER], light_of("studio"), size=72, **given)

    reference = frame(samples=512, seed=7)
    truth = 0.5 * (reference.a + reference.b)
    for seed in range(2):
        raw, smooth = (frame(samples=32, seed=seed, denoise=choice) for choice in ("off", "measured"))
        assert raw.raw is None
        # The same halves were denoised.
        np.testing.assert_allclose(smooth.raw, 0.5 * (raw.a + raw.b), rtol=1e-5, atol=1e-6)
        assert smooth.raw_relmse == pytest.approx(raw.relmse, rel=1e-4)
        before, after = (relmse(0.5 * (each.a + each.b), truth, reference.alpha) for each in (raw, smooth))
        assert after < 0.6 * before
        assert after / 2.0 < smooth.relmse < 2.0 * after


@pytest.mark.both_pythons
def test_a_target_is_reached_by_the_denoised_frame(render: RenderScene, light_of: Callable[[str], Dome]):
    given = {"size": 72, "samples": 1024, "error": TARGET}
    raw, smooth = (render("shaderball", [COPPER], light_of("studio"), **given, denoise=d) for d in ("off", "measured"))
    assert smooth.relmse <= TARGET < smooth.raw_relmse
    assert smooth.samples < raw.samples
