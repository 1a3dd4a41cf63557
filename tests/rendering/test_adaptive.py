"""Adaptive sampling: pixels are unbiased, the reported error is the true one, plans are within bounds."""

from collections.abc import Iterator

import numpy as np
import pytest

from lookdev.arrays import Bools, Floats
from lookdev.metrics import EPSILON, relmse, relmse_of_halves
from lookdev.rendering import adaptive
from lookdev.rendering.adaptive import Half, Region, Round, mean_samples, next_round, plan_regions
from lookdev.scene import Sampling

SIDE = 50  # not a multiple of a tile

ROW, COLUMN = np.mgrid[:SIDE, :SIDE] / SIDE - 0.5
ALPHA = (ROW * ROW + COLUMN * COLUMN < 0.2).astype(np.float64)
TRUTH = ((0.5 + ROW * COLUMN)[..., None] * (1.0, 0.7, 0.4)) * ALPHA[..., None]
NOISY = (COLUMN > 0.1) & (ROW < 0.0)
# The squared mean of a sample over its variance.
SHAPE = np.where(NOISY, 0.02, 2.0)


class Simulated:
    """A frame of a disc with skewed noise, as that of paths, ten times stronger in a corner."""

    def __init__(self, rng: np.random.Generator, shape: Floats = SHAPE) -> None:
        self.rng, self.shape = rng, shape
        self.halves = Half(SIDE, SIDE), Half(SIDE, SIDE)
        self.number, self.error = 0, np.inf

    def render(self, plan: Round) -> None:
        for half, regions in zip(self.halves, plan, strict=True):
            for region in regions:
                window = region.rows, region.columns
                # The mean of n numbers that follow a gamma distribution follows one of n times the shape.
                shape = (region.samples * self.shape[window])[..., None]
                half.add(
                    region, TRUTH[window] * self.rng.gamma(shape, 1.0 / shape, (*shape.shape[:2], 3)), ALPHA[window]
                )
        self.number += 1
        self.error = relmse_of_halves(*(half.color for half in self.halves), ALPHA)

    def run(self, **sampling: float) -> Iterator[Round]:
        while any(plan := next_round(Sampling(**sampling), self.halves, self.number, self.error)):
            self.render(plan)
            yield plan

    @property
    def color(self) -> Floats:
        return 0.5 * (self.halves[0].color + self.halves[1].color)


def whole(samples: int) -> Round:
    region = Region(slice(0, SIDE), slice(0, SIDE), samples, is_whole_frame=True)
    return (region,), (region,)


def drift(halves: list[Half], seen: Bools) -> float:
    """Return the mean deviation of pixels from the truth, in standard errors of that mean over frames."""
    means = np.array([(half.color[seen] / TRUTH[seen] - 1.0).mean() for half in halves])
    return float(means.mean() / (means.std(ddof=1) / np.sqrt(len(means))))


def test_the_error_of_a_frame_is_what_it_reports() -> None:
    frames = [Simulated(rng) for rng in np.random.default_rng(20).spawn(60)]
    for frame in frames:
        list(frame.run(samples=65536, error=3e-2))
    assert all(np.ptp(half.samples) > 0.0 for frame in frames for half in frame.halves), "samples are all the same"
    assert max(frame.error for frame in frames) <= 3e-2
    ratios = [frame.error / relmse(frame.color, TRUTH, ALPHA) for frame in frames]
    # Four standard errors.
    assert np.mean(ratios) == pytest.approx(1.0, abs=4.0 * np.std(ratios, ddof=1) / np.sqrt(len(ratios)))
    assert np.std(ratios) < 0.15


def test_a_half_plans_by_what_the_other_half_saw() -> None:
    """Planned by its own samples, a half would stop where rare bright samples are missing, and be too dark."""

    def plans(seen: int | None) -> Round:
        frame = Simulated(np.random.default_rng(6))
        frame.render(whole(8))
        frame.render(whole(8))
        if seen is not None:
            frame.halves[seen].spread[:] *= 1.0 + 99.0 * (COLUMN < -0.1)[..., None]
        return next_round(Sampling(samples=65536, error=3e-2), frame.halves, 2, 3.1e-2)

    first, second = plans(None)
    assert not any(region.is_whole_frame for region in (*first, *second))
    for seen in (0, 1):
        changed = plans(seen)
        assert changed[seen] == (first, second)[seen]
        assert changed[1 - seen] != (first, second)[1 - seen]


@pytest.mark.proof
@pytest.mark.parametrize("self_planned", [False, True])
def test_no_pixel_drifts_unless_a_half_chooses_for_itself(self_planned: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    # Small tiles and rare bright samples, so that a choice is nearly that of a pixel.
    monkeypatch.setattr(adaptive, "_TILE_SIDE", 4)
    monkeypatch.setattr(adaptive, "_TILES_PER_SIDE", SIDE)
    monkeypatch.setattr(adaptive, "_CALL_COST", 0.0)
    frames = []
    for rng in np.random.default_rng(21).spawn(200):
        frame = Simulated(rng, np.where(NOISY, 0.004, 2.0))
        first, second = frame.halves
        frame.render(whole(8))
        frame.render(whole(8))
        for ratio in (0.2, 0.5):
            pairs = ((first, first), (second, second)) if self_planned else ((first, second), (second, first))
            plans = [plan_regions(*pair, ratio, 1.0, 1000.0) for pair in pairs]
            frame.render((plans[0], plans[1]))
        frames.append(frame)
    drifts = [drift([frame.halves[half] for frame in frames], NOISY & (ALPHA > 0.0)) for half in (0, 1)]
    # In standard errors; a half that chooses for itself is dark by four of them.
    assert max(drifts) < -3.0 if self_planned else max(map(abs, drifts)) < 3.0


def test_regions_are_where_the_error_is() -> None:
    frame = Simulated(np.random.default_rng(3))
    plans = list(frame.run(samples=65536, error=2e-2))
    split = [plan for plan in plans if not plan[0][0].is_whole_frame]
    assert split
    assert plans[: -len(split)] == [whole(8), whole(8), *(whole(8 << n) for n in range(1, len(plans) - len(split) - 1))]
    for plan in split:
        for regions in plan:
            taken = np.zeros((SIDE, SIDE))
            for region in regions:
                assert region.samples & (region.samples - 1) == 0
                assert min(taken[region.rows, region.columns].shape) >= 4  # or Blender would not render it
                taken[region.rows, region.columns] += 1.0
            assert taken.max() <= 1.0
    for half in frame.halves:
        assert half.samples[NOISY & (ALPHA > 0)].mean() > 2.0 * half.samples[~NOISY & (ALPHA > 0)].mean()
        # A corner tile without the asset takes only the rounds over the whole frame.
        assert half.samples[-1, -1] == sum(plan[0][0].samples for plan in plans[: -len(split)])


@pytest.mark.parametrize("samples", [2, 4, 24, 64, 300, 1000])
def test_samples_are_bounded_and_a_sum_that_is_set_is_reached(samples: int) -> None:
    fixed, bounded = (Simulated(np.random.default_rng(4)) for _ in range(2))
    sizes = [first[0].samples for first, _ in fixed.run(samples=samples)]
    assert sum(sizes) == samples // 2
    assert sizes == sorted({size for size in sizes if size & (size - 1) == 0}, reverse=True)
    list(bounded.run(samples=samples, error=1e-5))
    # Regions are planned by what the other half saw of the silhouette, here the same.
    assert mean_samples(bounded.halves) <= samples // 2
    assert mean_samples(bounded.halves) > 0.7 * (samples // 2)


def test_seeds_suffice_however_small_the_target() -> None:
    assert len(list(Simulated(np.random.default_rng(5)).run(samples=2**20, error=1e-7))) <= 32


def test_a_frame_whose_rounds_agree_is_rendered_whole() -> None:
    halves = Half(SIDE, SIDE), Half(SIDE, SIDE)
    (region,), _ = whole(8)
    for half in (*halves, *halves):
        half.add(region, TRUTH.astype(np.float32), ALPHA.astype(np.float32))
    assert plan_regions(*halves, 0.5, 1.0, 100.0) == (Region(slice(0, SIDE), slice(0, SIDE), 16),)


def test_weights_are_samples() -> None:
    half = Half(8, 8)
    ones = np.ones((8, 8, 3), np.float32)
    half.add(Region(slice(0, 8), slice(0, 8), 8, is_whole_frame=True), ones, ones[..., 0])
    half.add(Region(slice(0, 8), slice(0, 8), 8, is_whole_frame=True), 3.0 * ones, 0.5 * ones[..., 0])
    half.add(Region(slice(0, 4), slice(4, 8), 16), 4.0 * ones[:4, 4:], 0.0 * ones[:4, 4:, 0])
    assert (half.color[0, 0, 0], half.color[0, 7, 0]) == (2.0, 3.0)
    assert (half.alpha[0, 0], half.alpha[0, 7]) == (0.75, 0.375)
    # Of the whole rounds alone: means of 8 samples that differ by 2.
    np.testing.assert_array_equal(half.spread, 16.0)


def test_the_error_of_a_sample_is_its_variance_over_the_square_of_what_is_shown() -> None:
    half = Half(8, 8, gain=0.5)
    ones = np.ones((8, 8, 3), np.float32)
    for value in (1.0, 3.0, 2.0):
        half.add(Region(slice(0, 8), slice(0, 8), 8, is_whole_frame=True), value * ones, ones[..., 0])
    half.coverage[0, 0] = 0.0
    # Of three means of 8 samples the variance is 1, so that of a sample is 8; shown is half of the mean, 2.
    expected = np.full((8, 8), 0.25 * 8.0 / (1.0 + EPSILON))
    expected[0, 0] = 0.0
    np.testing.assert_allclose(half.error[1:], expected[1:], rtol=1e-12)
    assert half.error[0, 0] == 0.0


@pytest.mark.parametrize(("size", "side"), [(1, 16), (8, 16), (9, 16), (24, 16), (25, 16), (50, 16), (130, 16), (7, 4)])
def test_no_tile_is_less_than_half_as_long_as_others(size: int, side: int) -> None:
    edges = adaptive._tile_edges(size, side)
    lengths = np.diff(edges)
    assert (edges[0], edges[-1]) == (0, size)
    assert (lengths[:-1] == side).all()
    assert min(side, size) / 2 <= lengths[-1] <= 1.5 * side


@pytest.mark.parametrize("seed", range(5))
def test_a_box_is_cut_where_both_parts_together_take_the_least_time(seed: int) -> None:
    error, time = np.random.default_rng(seed).random((2, 1, 7)) ** 3
    boxes, parts = adaptive._split_tiles(error, time)
    cuts = [(slice(0, cut), slice(cut, 7)) for cut in range(1, 7)]
    works = [sum(np.sqrt(error[0, part].sum() * time[0, part].sum()) for part in cut) for cut in cuts]
    least = np.argmin(works) + 1
    assert parts[0] == (1, 2)
    assert boxes[:3].tolist() == [[0, 1, 0, 7], [0, 1, 0, least], [0, 1, least, 7]]


@pytest.mark.parametrize(("number", "growth"), [(5, 0.05), (24, 1.0)])
def test_a_round_over_rectangles_adds_a_part_and_late_ones_double(number: int, growth: float) -> None:
    frame = Simulated(np.random.default_rng(8))
    frame.render(whole(64))
    frame.render(whole(64))
    first, _ = next_round(Sampling(samples=65536, error=1e-2), frame.halves, number, 1.001e-2)
    added = np.zeros((SIDE, SIDE))
    for region in first:
        added[region.rows, region.columns] += region.samples
    assert not first[0].is_whole_frame
    assert growth * 128 <= added[ALPHA > 0.0].mean() < 4.0 * growth * 128
