"""A frame's own error estimate against its error: within a factor of two, for every one of eight seeds; and denoising.

The estimate is for frames that can be used: where rare bright paths carry most of the light (relMSE above about 0.1,
polished metal in the shaderball's recess) it errs on the safe side, by up to 20 at relMSE 1.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from frames import RenderScene
from looks import LOOKS, quick_among

from lookdev.arrays import Reals
from lookdev.light import Dome
from lookdev.material import Layer
from lookdev.metrics import relmse
from lookdev.rendering.results import WorkerFrame

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


def mean(frame: WorkerFrame) -> Reals:
    return (frame.a + frame.b) / 2


@pytest.fixture(scope="module")
def truth_of(render: RenderScene, light_of: Callable[[str], Dome]) -> Callable[..., WorkerFrame]:
    """Return a function that renders a frame of many samples, of a seed of its own, once for all tests."""
    return cache(
        lambda asset, ibl, look, samples: render(asset, LOOKS[look], light_of(ibl), samples=samples, seed=1000)
    )


@pytest.mark.parametrize(("asset", "ibl", "look", "samples"), quick_among(ALL, QUICK))
def test_estimate_is_honest(
    asset: str, ibl: str, look: str, samples: int, render: RenderScene, light_of, truth_of: Callable[..., WorkerFrame]
) -> None:
    truth = truth_of(asset, ibl, look, 16 * samples)
    ratios = []
    for seed in range(8):
        frame = render(asset, LOOKS[look], light_of(ibl), samples=samples, seed=seed)
        # What remains without the error of the truth, a sixteenth of the frame's.
        ratios.append(frame.relmse / (relmse(mean(frame), mean(truth), frame.alpha) - truth.relmse))
    assert min(ratios) > 0.5, ratios
    assert max(ratios) < 2.0, ratios


def test_error_target_adds_samples_until_it_is_reached(
    render: RenderScene, light_of, truth_of: Callable[..., WorkerFrame]
) -> None:
    coarse, fine = (
        render("sphere", LOOKS["coated"], light_of("city"), samples=4096, error=error) for error in (5e-3, 5e-4)
    )
    assert coarse.relmse <= 5e-3
    assert fine.relmse <= 5e-4
    assert coarse.samples < fine.samples < 4096
    truth = truth_of("sphere", "city", "coated", 256)
    first, all_rounds = (
        frame.samples * (relmse(mean(frame), mean(truth), frame.alpha) - truth.relmse) for frame in (coarse, fine)
    )
    # Later samples bring at least what the first did: rounds that repeat each other's take twice as many.
    assert all_rounds < first


TARGET = 1e-2  # between the errors of the first rounds, raw and denoised
COPPER = Layer("copper", "disney", {"metallic": 1.0, "roughness": 0.35, "baseColor": (0.9, 0.5, 0.3)})


def test_a_denoised_frame_is_nearer_and_its_error_is_measured(render: RenderScene, light_of: Callable[[str], Dome]):
    def frame(**options: Any) -> WorkerFrame:
        return render("sphere", [COPPER], light_of("city"), **options)

    truth = mean(frame(samples=256, seed=7))
    raw, smooth = (frame(samples=16, denoise=choice) for choice in ("off", "measured"))
    assert raw.raw is None
    # The same halves were denoised.
    np.testing.assert_allclose(smooth.raw, mean(raw), rtol=1e-5, atol=1e-6)
    assert smooth.raw_relmse == pytest.approx(raw.relmse, rel=1e-4)
    before, after = (relmse(mean(rendered), truth, raw.alpha) for rendered in (raw, smooth))
    assert after < 0.6 * before
    assert after / 2.0 < smooth.relmse < 2.0 * after


@pytest.mark.both_pythons
def test_a_target_is_reached_by_the_denoised_frame(render: RenderScene, light_of: Callable[[str], Dome]):
    options = {"samples": 1024, "error": TARGET}
    raw, smooth = (render("shaderball", [COPPER], light_of("city"), **options, denoise=d) for d in ("off", "measured"))
    assert smooth.relmse <= TARGET < smooth.raw_relmse
    assert 16 < smooth.samples < raw.samples
