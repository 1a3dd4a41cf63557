"""Frames of Cycles against the float64 reference: a sphere in a constant environment, under studio and under city.

Eight frames of different seeds are sixteen independent halves of every pixel, whose spread is the noise that the
frames claim. Student's t of each pixel against the reference must then be distributed as noise alone makes it.
"""

from __future__ import annotations

import numpy as np
import pytest
from conftest import POSE, RenderScene, orbit_camera
from looks import LOOKS
from scipy import stats

from lookdev.brdf import complete_parameters
from lookdev.checks.error import EPSILON
from lookdev.ibl import read_distribution
from lookdev.reference.sphere import sphere_pixels

pytestmark = pytest.mark.cycles

SIZE, SAMPLES, SEEDS, PIXELS = 48, 32, 8, 300

QUICK = [("white", "diffuse"), ("studio", "coated"), ("city", "brushed")]
ALL = [(ibl, look) for ibl in ("white", "studio", "city") for look in LOOKS]


@pytest.mark.parametrize(
    ("ibl", "look"),
    [pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow) for case in ALL],
)
def test_sphere_agrees_within_its_own_noise(ibl: str, look: str, render: RenderScene, light_of) -> None:
    light = light_of(ibl)
    frames = [render("sphere", LOOKS[look], light, samples=SAMPLES, seed=seed, size=SIZE) for seed in range(SEEDS)]
    covered = np.argwhere(frames[0].alpha > 0.0)
    chosen = np.random.default_rng(1).permutation(covered)[:PIXELS]
    reference = sphere_pixels(
        "disney",
        complete_parameters("disney", LOOKS[look]),
        read_distribution(light),
        orbit_camera((0.0, 0.0, 0.0), 1.0),
        POSE,
        (SIZE, SIZE),
        chosen[:, ::-1],
        samples=1024,
        scrambles=4,
    )
    halves = np.stack([half[tuple(chosen.T)] for frame in frames for half in (frame.a, frame.b)]).astype(np.float64)
    # Channels share their samples: one number a pixel.
    values, expected = halves.mean(axis=-1), reference.value.mean(axis=-1)
    error = np.sqrt(values.var(axis=0, ddof=1) / len(values) + reference.error.mean(axis=-1) ** 2)
    t = (values.mean(axis=0) - expected) / np.maximum(error, 1e-6)
    freedom = len(values) - 1

    # No bias: pixels are scrambled independently, so the mean of their t is normal. Four sigma.
    spread = np.sqrt(freedom / (freedom - 2) / PIXELS)
    assert abs(t.mean()) < 4.0 * spread
    # No pixel is off by more than noise makes it, Sidak-corrected to 1e-3 over all pixels; coverage of a silhouette is
    # a binary variable, whose tails a t-distribution underestimates: these get a quarter more.
    limit = stats.t.ppf(1.0 - (1.0 - (1.0 - 1e-3) ** (1.0 / PIXELS)) / 2.0, freedom)
    interior = frames[0].alpha[tuple(chosen.T)] == 1.0
    assert np.abs(t[interior]).max() < limit
    assert np.abs(t).max() < 1.25 * limit
    # The usual number of pixels beyond 5 %, within four sigma of a binomial.
    beyond = (np.abs(t) > stats.t.ppf(0.975, freedom)).mean()
    assert beyond < 0.05 + 4.0 * np.sqrt(0.05 * 0.95 / PIXELS)

    # What the frames claim is what they are: relMSE against the reference, over the same pixels on average.
    means = (halves[0::2] + halves[1::2]) / 2.0
    true = ((means - reference.value) ** 2 / (reference.value**2 + EPSILON)).mean()
    claimed = np.mean([frame.relmse for frame in frames])
    assert 0.5 < claimed / true < 2.0
