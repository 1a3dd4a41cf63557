"""Who renders when; times and ratios from curves that are known; what Ctrl-C leaves."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from bench_fakes import FakeBackends, FakeRenderer, measured, quiet

from lookdev.bench.matrix import MOST_REPEATS, SEEDS, Cell, Options
from lookdev.bench.measure import Candidate, CellResult, CellRun, schedule
from lookdev.bench.reference import FIRST_SEED, Shot
from lookdev.bench.run import run_matrix
from lookdev.errors import RenderError

CELL = Cell("sphere", "city", "plastic")
SMALL = Options(scenes=("sphere",), ibls=("city",), samples=(4, 16, 64), repeats=3)


def run_cell(options: Options = SMALL, *renderers: FakeRenderer) -> CellResult:
    run = CellRun(CELL, [Candidate(each.name, each.name, each) for each in renderers], options)
    run.run(quiet)
    return run.result()


@pytest.fixture
def backends() -> FakeBackends:
    """Return backends that have rendered the cell."""
    backends = FakeBackends()
    with backends(CELL, SMALL) as candidates:
        CellRun(CELL, candidates, SMALL).run(quiet)
    return backends


def test_backends_take_turns(backends: FakeBackends) -> None:
    turns = measured(backends.calls, FIRST_SEED)
    assert [(name, samples) for name, samples, _ in turns] == 3 * [
        (name, samples) for samples in (4, 16, 64) for name in ("exact", "principled")
    ]
    # Both have the same seed at their turn, and no seed comes twice.
    seeds = [seed for name, _, seed in turns if name == "exact"]
    assert seeds == [seed for name, _, seed in turns if name == "principled"]
    assert len(set(seeds)) == len(seeds) == 9


def test_every_candidate_is_warm_before_the_first_measurement(backends: FakeBackends) -> None:
    first = backends.calls.index(measured(backends.calls, FIRST_SEED)[0])
    assert backends.calls[first - 2 : first] == [("exact", 4, FIRST_SEED), ("principled", 4, FIRST_SEED)]


def test_no_two_renders_share_a_seed_and_none_is_a_references() -> None:
    samples = tuple(1 << exponent for exponent in range(1, 15))
    options = [Options(samples=samples, repeats=MOST_REPEATS, seed=seed) for seed in (0, 1, SEEDS - 1)]
    seeds = [turn.seed for each in options for turn in schedule(each, ["exact"])]
    assert len(set(seeds)) == len(seeds) == 3 * MOST_REPEATS * len(samples)
    assert max(seeds) < FIRST_SEED


def test_times_and_ratios_of_known_curves() -> None:
    # Noise falls as 1 / samples and time grows with them: relMSE 1e-3 takes so many seconds.
    exact = FakeRenderer("exact", 0.1, fixed=0.0)
    other = FakeRenderer("principled", 0.2, fixed=0.0, rate=0.0005)
    result = run_cell(SMALL, exact, other)
    for renderer in (exact, other):
        found = result.reached[renderer.name][1e-3]
        seconds = renderer.rate * renderer.relmse(1) / 1e-3
        assert found is not None
        # The noise of relMSE itself, a few per cent.
        assert found.value == pytest.approx(seconds, rel=0.08)
    ratio = next(each for each in result.ratios if each.target == 1e-3)
    # Twice the noise is four times the samples, at half the cost.
    assert ratio.value is not None
    assert ratio.value.value == pytest.approx(0.5, rel=0.1)
    assert ratio.low is not None
    assert ratio.high is not None
    assert ratio.low <= ratio.value.value <= ratio.high
    assert ratio.high - ratio.low < 0.15


def test_a_times_median_and_an_errors_mean_make_a_point() -> None:
    class Irregular(FakeRenderer):
        def __call__(self, samples: int, seed: int) -> Shot:
            shot = super().__call__(samples, seed)
            slow = len([each for each in self.calls if each[2] < FIRST_SEED]) == 1
            return Shot(shot.image, shot.alpha, 100.0 if slow else shot.seconds, shot.memory, shot.renderer)

    renderer = Irregular()
    result = run_cell(Options(samples=(4,), repeats=3), renderer)
    (point,) = result.curves["exact"]
    assert point.seconds == pytest.approx(renderer.fixed + 4 * renderer.rate)
    errors = [row.relmse for row in result.measurements]
    assert point.relmse == pytest.approx(sum(errors) / 3)


def test_ctrl_c_keeps_what_was_measured(tmp_path: Path) -> None:
    # Two references of 8 parts, two warm-ups, and 5 renders of the 18.
    backends = FakeBackends(ends_after=16 + 2 + 5)
    results = run_matrix(SMALL, tmp_path, quiet, opened=backends)
    assert not results.complete
    assert backends.closed == 1
    with (tmp_path / "results.csv").open(newline="") as stream:
        assert len(list(csv.DictReader(stream))) == 5
    stored = json.loads((tmp_path / "results.json").read_text())
    assert stored["complete"] is False
    assert [len(each["curve"]) for each in stored["cells"][0]["backends"].values()] == [3, 2]
    assert (tmp_path / "curves_plastic.svg").exists()


def test_ctrl_c_in_a_reference_leaves_files_without_rows(tmp_path: Path) -> None:
    assert run_matrix(SMALL, tmp_path, quiet, opened=FakeBackends(ends_after=3)).cells == []
    assert len((tmp_path / "results.csv").read_text().splitlines()) == 1


def test_a_backend_that_fails_leaves_the_cells_before_it(tmp_path: Path) -> None:
    backends = FakeBackends()
    options = Options(scenes=("sphere", "suzanne"), ibls=("city",), samples=(4, 16), repeats=1)

    def failing(cell: Cell, options: Options):
        if cell.scene == "suzanne":
            raise RenderError("no suzanne today")
        return backends(cell, options)

    with pytest.raises(RenderError, match="no suzanne"):
        run_matrix(options, tmp_path, quiet, opened=failing)
    stored = json.loads((tmp_path / "results.json").read_text())
    assert [each["scene"] for each in stored["cells"]] == ["sphere"]
    assert stored["complete"] is False


def test_a_second_run_renders_no_reference(tmp_path: Path) -> None:
    run_matrix(SMALL, tmp_path, quiet, opened=FakeBackends())
    backends = FakeBackends()
    assert run_matrix(SMALL, tmp_path, quiet, opened=backends).complete
    assert len(backends.calls) == 2 + 18  # warm-ups and measurements
