"""Denoised frames: nearer to the reference, with an error that is measured, and the raw picture beside them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from frames import RenderScene

from lookdev.light import Dome
from lookdev.material import Layer
from lookdev.metrics import relmse

pytestmark = pytest.mark.cycles

TARGET = 6e-3  # between the errors of the first round, raw and denoised
COPPER = Layer("copper", "disney", {"metallic": 1.0, "roughness": 0.35, "baseColor": (0.9, 0.5, 0.3)})


def test_a_denoised_frame_is_nearer_and_its_error_is_measured(render: RenderScene, light_of: Callable[[str], Dome]):
    def frame(**given):
        return render("shaderball", [COPPER], light_of("studio"), size=72, **given)

    reference = frame(samples=1024, seed=7)
    truth = 0.5 * (reference.a + reference.b)
    for seed in range(3):
        raw, smooth = (frame(samples=32, seed=seed, denoise=choice) for choice in ("off", "measured"))
        assert raw.raw is None
        # The same halves were denoised.
        np.testing.assert_allclose(smooth.raw, 0.5 * (raw.a + raw.b), rtol=1e-5, atol=1e-6)
        assert smooth.raw_relmse == pytest.approx(raw.relmse, rel=1e-4)
        before, after = (relmse(0.5 * (each.a + each.b), truth, reference.alpha) for each in (raw, smooth))
        assert after < 0.6 * before
        assert after / 2.0 < smooth.relmse < 2.0 * after


def test_a_target_is_reached_by_the_denoised_frame(render: RenderScene, light_of: Callable[[str], Dome]):
    given = {"size": 72, "samples": 1024, "error": TARGET}
    raw, smooth = (render("shaderball", [COPPER], light_of("studio"), **given, denoise=d) for d in ("off", "measured"))
    assert smooth.relmse <= TARGET < smooth.raw_relmse
    assert smooth.samples < raw.samples
