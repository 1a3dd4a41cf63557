"""Who renders when; times and ratios from curves that are known; what Ctrl-C leaves."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest
from bench_fakes import FakeBackends, FakeRenderer, measured, quiet, run_matrix

from lookdev.bench import matrix
from lookdev.bench.measure import Candidate, CellRun, Series, schedule
from lookdev.bench.options import MAX_REPEATS, SEEDS, BenchOptions, Cell
from lookdev.bench.reference import FIRST_SEED, TimedPicture
from lookdev.errors import LookdevError, RenderError

CELL = Cell("sphere", "city", "plastic")
SMALL = BenchOptions(scenes=("sphere",), ibls=("city",), samples=(4, 16, 64), repeats=3)


def run_cell(options: BenchOptions = SMALL, *renderers: FakeRenderer) -> CellRun:
    candidates = [Candidate(renderer.name, renderer.name, renderer, (), True) for renderer in renderers]
    run = CellRun(CELL, candidates, options, quiet)
    run.run()
    return run


def test_backends_take_turns_and_are_warm_before_the_first_measurement() -> None:
    backends = FakeBackends()
    with backends(CELL, SMALL) as candidates:
        CellRun(CELL, candidates, SMALL, quiet).run()
    turns = measured(backends.calls, FIRST_SEED)
    assert [(name, samples) for name, samples, _ in turns] == 3 * [
        (name, samples) for samples in (4, 16, 64) for name in ("exact", "principled")
    ]
    # Both have the same seed at their turn.
    assert [seed for name, _, seed in turns if name == "exact"] == [s for name, _, s in turns if name == "principled"]
    first = backends.calls.index(turns[0])
    assert backends.calls[first - 2 : first] == [("exact", 4, FIRST_SEED), ("principled", 4, FIRST_SEED)]


def test_no_two_renders_share_a_seed_and_none_is_a_references() -> None:
    samples = tuple(1 << exponent for exponent in range(1, 15))
    options = [BenchOptions(samples=samples, repeats=MAX_REPEATS, seed=seed) for seed in (0, 1, SEEDS - 1)]
    seeds = [seed for choice in options for _, _, seed in schedule(choice)]
    assert len(set(seeds)) == len(seeds) == 3 * MAX_REPEATS * len(samples)
    assert max(seeds) < FIRST_SEED


def test_times_and_ratios_of_known_curves() -> None:
    # Noise falls as 1 / samples and time grows with them: relMSE 1e-3 takes so many seconds.
    exact, other = FakeRenderer("exact", 0.1, fixed=0.0), FakeRenderer("principled", 0.2, fixed=0.0, rate=0.0005)
    result = run_cell(SMALL, exact, other)
    for renderer in (exact, other):
        reached = result.times(Series(renderer.name), 1e-3).value
        seconds = renderer.rate * renderer.relmse(1) / 1e-3
        assert reached is not None
        # The noise of relMSE itself, a few per cent.
        assert reached.value == pytest.approx(seconds, rel=0.08)
    ratio = result.ratio(Series("principled"), 1e-3)
    assert ratio is not None
    assert None not in (ratio.value, ratio.low, ratio.high)
    # Twice the noise is four times the samples, at half the cost.
    assert ratio.value.value == pytest.approx(0.5, rel=0.1)
    assert ratio.low <= ratio.value.value <= ratio.high
    assert ratio.high - ratio.low < 0.15


def test_a_times_median_and_an_errors_mean_make_a_point() -> None:
    class Irregular(FakeRenderer):
        def __call__(self, samples: int, seed: int, **sampling: object) -> TimedPicture:
            shot = super().__call__(samples, seed)
            slow = len(measured(self.calls, FIRST_SEED)) == 1
            return replace(shot, seconds=100.0) if slow else shot

    renderer = Irregular()
    result = run_cell(BenchOptions(samples=(4,), repeats=3), renderer)
    (point,) = result.curves[Series("exact")]
    assert point.seconds == pytest.approx(renderer.fixed + 4 * renderer.rate)
    assert point.relmse == pytest.approx(sum(row.relmse for row in result.measurements) / 3)


def test_ctrl_c_keeps_what_was_measured(tmp_path: Path) -> None:
    # Two references of 8 parts, two warm-ups, and 5 renders of the 18.
    backends = FakeBackends(ends_after=16 + 2 + 5)
    assert not run_matrix(SMALL, tmp_path, backends).complete
    assert backends.closed == 1
    with (tmp_path / "results.csv").open(newline="") as stream:
        assert len(list(csv.DictReader(stream))) == 5
    stored = json.loads((tmp_path / "results.json").read_text())
    assert stored["complete"] is False
    assert [len(series["curve"]) for series in stored["cells"][0]["series"].values()] == [3, 2]
    assert (tmp_path / "curves_plastic.svg").exists()


def test_ctrl_c_in_a_reference_leaves_files_without_rows(tmp_path: Path) -> None:
    assert run_matrix(SMALL, tmp_path, FakeBackends(ends_after=3)).cells == []
    assert len((tmp_path / "results.csv").read_text().splitlines()) == 1


def test_a_backend_that_fails_is_left_out_of_its_cell(tmp_path: Path) -> None:
    # It ends in its first measurement, after both references and warm-ups.
    results = run_matrix(SMALL, tmp_path, FakeBackends(principled=16 + 2 + 1))
    assert results.complete
    assert results.failures == ["sphere, city, plastic: principled: principled has no more ink"]
    stored = json.loads((tmp_path / "results.json").read_text())
    assert stored["failures"] == results.failures
    assert [len(series["curve"]) for series in stored["cells"][0]["series"].values()] == [3, 0]


def test_a_cell_that_fails_leaves_the_others(tmp_path: Path) -> None:
    backends = FakeBackends()
    options = BenchOptions(scenes=("suzanne", "sphere"), ibls=("city",), samples=(4, 16), repeats=1)

    def failing(cell: Cell, options: BenchOptions):
        if cell.scene == "suzanne":
            raise RenderError("no suzanne today")
        return backends(cell, options)

    results = run_matrix(options, tmp_path, failing)
    assert results.failures == ["suzanne, city, plastic: no suzanne today"]
    assert [cell["scene"] for cell in json.loads((tmp_path / "results.json").read_text())["cells"]] == ["sphere"]


def test_a_backend_that_is_not_here_is_left_out_by_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def missing() -> None:
        raise RenderError("no LLVM")

    monkeypatch.setitem(matrix.BACKEND_CHECKS, "mitsuba-principled", missing)
    options = replace(SMALL, backends=("exact", "mitsuba-principled"))
    results = run_matrix(options, tmp_path, FakeBackends())
    assert results.missing == {"mitsuba-principled": "no LLVM"}
    assert {row.backend for row in results.cells[0].measurements} == {"exact"}
    with pytest.raises(LookdevError, match="mitsuba-principled: no LLVM"):
        run_matrix(replace(SMALL, backends=("mitsuba-principled",)), tmp_path, FakeBackends())


DENOISED = replace(SMALL, denoise=True, repeats=2, targets=(1e-3,))


def test_one_render_gives_a_raw_and_a_denoised_measurement() -> None:
    exact, other = FakeRenderer("exact", 0.1), FakeRenderer("principled", 0.2)
    result = run_cell(DENOISED, exact, other)
    assert list(result.curves) == [Series(name, way) for name in ("exact", "principled") for way in ("raw", "denoised")]
    raw, smooth = (result.curves[Series("exact", way)][0] for way in ("raw", "denoised"))
    # The same noise, halved.
    assert smooth.relmse == pytest.approx(raw.relmse / 4.0, rel=0.05)
    assert smooth.seconds == pytest.approx(raw.seconds + 0.1)
    assert len(measured(exact.calls, FIRST_SEED)) == 3 * 2
    assert [series for series in result.curves if result.ratio(series, 1e-3)] == list(result.curves)[2:]


def test_samples_stop_rising_where_the_error_is_small_enough() -> None:
    # relMSE is about 0.018 / samples: 16 samples are just not enough for 1e-3, 64 are, raw and denoised.
    exact = FakeRenderer("exact", 0.1)
    limit = 1.3 * exact.relmse(16)
    assert {row.samples for row in run_cell(replace(SMALL, stop_relmse=limit), exact).measurements} == {4, 16}
    assert {row.samples for row in run_cell(SMALL, FakeRenderer("exact", 0.1)).measurements} == {4, 16, 64}


def test_frames_end_at_a_target_error() -> None:
    exact = FakeRenderer("exact", 0.1)
    aim = 1.01 * exact.relmse(32)
    result = run_cell(replace(DENOISED, target_estimate=aim), exact)
    aimed, denoised = (result.measurements_of(Series("exact", way)) for way in ("aimed", "aimed, denoised"))
    assert [row.samples for row in aimed] == [32, 32]
    assert [row.samples for row in denoised] == [8, 8]
    # What the most samples do not reach is tried once.
    assert len(run_cell(replace(SMALL, target_estimate=1e-9), exact).measurements_of(Series("exact", "aimed"))) == 1


def test_beyond_its_samples_a_curve_falls_as_that_of_independent_samples() -> None:
    exact = FakeRenderer("exact", 0.1, fixed=0.0)
    reached = run_cell(replace(SMALL, targets=(1e-6,), independent=True), exact).times(Series("exact"), 1e-6).value
    assert reached is not None
    assert reached.mark == "~"
    assert reached.value == pytest.approx(exact.rate * exact.relmse(1) / 1e-6, rel=0.05)
    assert run_cell(replace(SMALL, targets=(1e-6,)), exact).times(Series("exact"), 1e-6).value is None


def test_by_samples_leaves_out_what_slowed_one_render() -> None:
    class Slow(FakeRenderer):
        def __call__(self, samples: int, seed: int, **sampling: object) -> TimedPicture:
            shot = super().__call__(samples, seed)
            return replace(shot, seconds=10.0 * shot.seconds) if seed % 16 < 2 else shot

    result = run_cell(SMALL, FakeRenderer("exact", 0.1, fixed=0.0), Slow("principled", 0.2, fixed=0.0, rate=0.0005))
    ratio = result.ratio(Series("principled"), 1e-3)
    assert ratio is not None
    # A quarter of the samples at twice the cost.
    assert ratio.by_samples is not None
    assert ratio.by_samples.value == pytest.approx(0.5, rel=0.1)


def test_a_second_run_renders_no_reference(tmp_path: Path) -> None:
    run_matrix(SMALL, tmp_path, FakeBackends())
    backends = FakeBackends()
    assert run_matrix(SMALL, tmp_path, backends).complete
    assert len(backends.calls) == 2 + 18  # warm-ups and measurements
