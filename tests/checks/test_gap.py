"""The gap between pictures, on pictures whose gap is known."""

import numpy as np
import pytest

from lookdev.checks.images import MAX_FLIP, check_gap, measure_gap
from lookdev.metrics import EPSILON

SHAPE = (64, 64, 3)


def halves(value: float, noise: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return tuple((value * (1.0 + noise * rng.standard_normal(SHAPE))).astype(np.float32) for _ in range(2))  # type: ignore[return-value]


def disc() -> np.ndarray:
    y, x = np.mgrid[:64, :64] - 31.5
    return (np.hypot(x, y) < 25.0).astype(np.float32)


@pytest.mark.parametrize("off", [0.0, 0.02, 0.1])
def test_relmse_is_that_of_the_expectations_whatever_the_noise(off: float) -> None:
    rng = np.random.default_rng(3)
    gap = measure_gap(halves(0.5, 0.05, rng), halves(0.5 * (1.0 + off), 0.05, rng), disc())
    expected = (0.5 * off) ** 2 / (0.25 + EPSILON)
    assert abs(gap.relmse - expected) < 4.0 * gap.relmse_error
    assert gap.relmse_error < 3e-4


def test_only_the_asset_counts() -> None:
    alpha, exact = disc(), halves(0.5, 0.0, np.random.default_rng(4))
    wrong = tuple(np.where(alpha[..., None] > 0.0, half, np.float32(1.0)) for half in exact)
    gap = measure_gap(exact, wrong, alpha)  # type: ignore[arg-type]
    assert gap.relmse == 0.0
    assert gap.flip_map[32, 32] == 0.0
    assert gap.flip_map[2, 2] > 0.1


def test_flip_is_zero_for_the_same_picture_and_noise_is_reported() -> None:
    exact = halves(0.5, 0.05, np.random.default_rng(5))
    gap = measure_gap(exact, exact, disc())
    assert gap.flip == 0.0
    assert gap.noise > 0.0


@pytest.mark.parametrize(("factor", "passes"), [(1.0, True), (1.5, False)])
def test_a_visible_difference_fails(factor: float, passes: bool) -> None:
    rng = np.random.default_rng(6)
    finding = check_gap("paint", halves(0.5, 0.0, rng), halves(0.5 * factor, 0.0, rng), disc())
    assert finding.passed is passes
    assert (finding.figures["flip"] <= MAX_FLIP) is passes
    assert finding.plots[0].pictures[2].pixels.shape == SHAPE[:2]
