"""The image check on synthetic frames: correct ones pass, all kinds of faults are found."""

import numpy as np
import pytest

from lookdev.checks.images import LEVEL, check_frame, choose_pixels, compare_pixels, flip
from lookdev.errors import RenderError
from lookdev.reference.render import Estimate

SIZE, COUNT, HALVES, SAMPLES = 32, 100, 16, 256


def disc():
    y, x = np.mgrid[:SIZE, :SIZE] - (SIZE - 1) / 2
    return (np.hypot(x, y) < 0.4 * SIZE).astype(float)


class Case:
    """A frame and a reference of known values, with the noise of as many draws; of rare bright ones if `tails`."""

    def __init__(self, seed=0, tails=False):
        rng = np.random.default_rng(seed)
        self.alpha = disc()
        self.truth = rng.uniform(0.05, 1.0, (SIZE, SIZE, 3)) * self.alpha[..., None]
        self.pixels = choose_pixels(self.alpha, COUNT, seed)

        def values(sets, draws, shape, truth):
            if tails:
                # One draw in forty finds a lamp that is as bright as everything else of the pixel.
                hits = rng.binomial(draws, 0.025, (sets, *shape, 1)) / (0.025 * draws)
                return truth * (0.5 + 0.5 * hits)
            return truth * (1.0 + rng.normal(0.0, 1.0 / np.sqrt(draws), (sets, *shape, 3)))

        self.halves = values(HALVES, SAMPLES // HALVES, (SIZE, SIZE), self.truth)
        columns, rows = self.pixels.T
        samples = values(8, 128, (COUNT,), self.truth[rows, columns])
        self.reference = Estimate(samples.mean(axis=0), samples.std(axis=0, ddof=1) / np.sqrt(8), 128, 8)

    @property
    def brightest(self):
        return self.pixels[self.reference.value.mean(axis=-1).argmax()]

    def check(self, halves=None, truth=None):
        halves = self.halves if halves is None else halves
        return check_frame("look", halves, self.alpha, SAMPLES, self.pixels, self.reference, truth)


@pytest.mark.parametrize("tails", [False, True])
def test_a_hundred_right_frames_pass(tails):
    # Three tests of LEVEL each: that more than one in a hundred fails has a probability of 4e-3.
    assert LEVEL <= 3e-4
    assert sum(not Case(seed, tails).check().passed for seed in range(100)) <= 1


def rare_light(case, rng):
    """Make half of the pixels as dark as light that one half in twenty finds; the reference has little noise there."""
    dark = np.arange(COUNT) < COUNT // 2
    columns, rows = case.pixels[dark].T
    mean, chance = 3e-4, 0.05
    hits = rng.binomial(1, chance, (HALVES, len(rows), 1)) * (mean / chance)
    case.halves[:, rows, columns] = np.broadcast_to(hits, (HALVES, len(rows), 3))
    error = np.where(dark[:, None], 0.1 * mean, case.reference.error)
    value = np.where(dark[:, None], mean, case.reference.value)
    case.reference = Estimate(value, error, case.reference.samples, case.reference.scrambles)
    return case


def test_rare_light_is_no_fault_and_hides_none():
    cases = [rare_light(Case(seed), np.random.default_rng(seed)) for seed in range(100)]
    assert sum(not case.check().passed for case in cases) <= 1
    column, row = cases[0].brightest
    cases[0].halves[:, row, column] = 0.0
    assert cases[0].check().figures["suspicious"] == 1


def test_the_finding_of_a_right_frame():
    finding = Case().check()
    assert finding.check == "image"
    assert finding.figures["pixels"] == COUNT
    assert finding.figures["suspicious"] == 0
    # The variance of a mean of 256 draws of unit variance, over values of 0.05 to 1 against a floor of 0.1.
    assert 0.5 / 256 < finding.figures["relmse_claimed"] < 1.0 / 256
    assert finding.figures["relmse"] == pytest.approx(finding.figures["relmse_claimed"], rel=0.5)
    assert "FLIP" in finding.skipped
    assert len(finding.details) == 5
    assert len(finding.plots) == 3


def one_pixel(case):
    halves = case.halves.copy()
    column, row = case.brightest
    halves[:, row, column] *= 0.3
    return halves


FAULTS = {
    "darker": lambda case: case.halves * 0.96,
    "one pixel": one_pixel,
    # Equal on average, with errors at every pixel.
    "texture moved": lambda case: (
        case.halves * (1.0 + 0.15 * np.sign(np.random.default_rng(1).normal(size=(SIZE, SIZE, 1))))
    ),
    "channels swapped": lambda case: case.halves[..., [2, 1, 0]],
    "one channel": lambda case: case.halves * (1.0, 1.0, 0.95),
    "mirrored": lambda case: case.halves[:, :, ::-1],
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
@pytest.mark.parametrize("seed", range(3))
def test_a_fault_is_found(fault, seed):
    case = Case(seed)
    assert not case.check(fault(case)).passed


def test_each_test_finds_what_it_is_for():
    case = Case()
    pixel, moved, dark = (case.check(FAULTS[name](case)).figures for name in ("one pixel", "texture moved", "darker"))
    assert pixel["suspicious"] == 1
    assert pixel["beyond"] <= pixel["beyond_limit"]
    assert moved["beyond"] > moved["beyond_limit"]
    assert abs(dark["bias"]) > dark["bias_limit"]
    assert dark["bias"] == pytest.approx(-0.04, abs=0.02)
    assert dark["suspicious"] == 0


def test_the_worst_pixel_is_first():
    case = Case()
    column, row = case.brightest
    assert case.check(one_pixel(case)).details[0].startswith(f"pixel {column},{row}: frame ")


def test_a_frame_that_missed_a_rare_path_is_noisier_than_it_seems():
    # 256 draws, none of which found what one in 200 does; the reference found it, with its noise.
    halves = np.full((HALVES, 1, 3), 0.5)
    reference = Estimate(np.full((1, 3), 0.51), np.full((1, 3), 0.01 * np.sqrt(200 / 1024)), 128, 8)
    assert (np.abs(compare_pixels(halves, SAMPLES, reference).t) < 3.0).all()


def test_freedom_is_that_of_the_noisier_side():
    halves = 0.5 + np.random.default_rng(1).normal(0.0, 0.1, (HALVES, 50, 3))
    exact = Estimate(np.full((50, 3), 0.5), np.full((50, 3), 1e-9), 128, 8)
    np.testing.assert_allclose(compare_pixels(halves, SAMPLES, exact).freedom, HALVES - 1, rtol=1e-6)
    rough = Estimate(np.full((50, 3), 0.5), np.full((50, 3), 1.0), 1, 8)
    # 7 of the reference alone; its bound of the frame's noise, 2^-7 of its own variance, adds next to nothing.
    np.testing.assert_allclose(compare_pixels(halves, SAMPLES, rough).freedom, 7.0, rtol=0.1)


def test_pixels_that_are_not_finite_fail():
    case = Case()
    column, row = case.pixels[3]
    case.halves[2, row, column, 1] = np.nan
    finding = case.check()
    assert not finding.passed
    assert finding.details == (f"pixel {column},{row}: not finite",)


def test_black_frames_agree():
    halves, pixels = np.zeros((HALVES, SIZE, SIZE, 3)), choose_pixels(disc(), 50)
    black = Estimate(np.zeros((50, 3)), np.zeros((50, 3)), 128, 8)
    assert check_frame("look", halves, disc(), SAMPLES, pixels, black).passed


def test_too_few_halves_are_refused():
    with pytest.raises(RenderError, match="2 independent renders"):
        Case().check(Case().halves[:2])


def test_pixels_are_chosen_from_the_asset_and_its_rim():
    alpha = np.zeros((9, 12))
    alpha[3:5, 6:9] = 0.5
    pixels = choose_pixels(alpha, 1000, 1)
    assert sorted(map(tuple, pixels.tolist())) == [(x, y) for x in range(5, 10) for y in range(2, 6)]
    few = choose_pixels(alpha, 6, 1)
    assert len(np.unique(few, axis=0)) == 6
    assert (few == choose_pixels(alpha, 6, 1)).all()
    assert (few != choose_pixels(alpha, 6, 2)).any()


def test_flip_shows_differences():
    case = Case()
    assert flip(case.truth, case.truth)[0] == 0.0
    changed = case.truth.copy()
    changed[:, : SIZE // 2] *= 0.5
    mean, flip_map = flip(changed, case.truth)
    assert flip_map.shape == (SIZE, SIZE)
    assert mean == pytest.approx(flip_map.mean(), rel=1e-4)
    assert flip_map[:, : SIZE // 2 - 4].mean() > 5.0 * flip_map[:, SIZE // 2 + 4 :].mean()
    finding = case.check(truth=case.truth)
    assert 0.0 < finding.figures["flip"] < 1.0
    assert finding.skipped == ""
