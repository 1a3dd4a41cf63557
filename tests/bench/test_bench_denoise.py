"""The trial of denoised frames: what it draws, what counts as true, and its report, with a renderer of known noise."""

import csv
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench_fakes import SIDE, quiet, truth
from typer.testing import CliRunner

from lookdev.bench import denoise_trial
from lookdev.bench.denoise_trial import (
    SAMPLES,
    DenoiseTrial,
    Trial,
    cell_scene,
    draw_cell,
    summarize_trials,
)  # fmt: skip
from lookdev.bench.options import BenchOptions
from lookdev.bench.reference import FIRST_SEED
from lookdev.cli import app
from lookdev.metrics import EPSILON
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask

NOISE = 0.5
BIAS = 0.02  # of a denoised frame, which has no noise


class Renderer:
    """Renders `truth` with noise of variance ``NOISE^2 / samples``; denoised frames are off by `BIAS`."""

    def __init__(self, ends_after: int | None = None) -> None:
        self.tasks: list[FrameTask] = []
        self._ends_after = ends_after

    @contextmanager
    def __call__(self) -> Iterator[Callable[[FrameTask], WorkerFrame]]:
        yield self.render

    def render(self, task: FrameTask) -> WorkerFrame:
        if len(self.tasks) == self._ends_after:
            raise KeyboardInterrupt
        self.tasks.append(task)
        sampling = task.scene.sampling
        image, alpha = truth()
        covered = alpha[..., None]
        noise = np.random.default_rng((sampling.seed, sampling.samples)).normal(size=image.shape)
        raw = image + noise * NOISE / np.sqrt(sampling.samples) * covered
        frame = raw if sampling.denoise == "off" else image + BIAS * covered
        arrays = {"a": frame, "b": frame, "alpha": alpha}
        halves = {name: array.astype(np.float32) for name, array in arrays.items()}
        rendered = WorkerFrame(**halves, samples=sampling.samples, seconds=1.0, relmse=2.0, blender="", memory=0)
        return rendered if sampling.denoise == "off" else replace(rendered, raw=raw.astype(np.float32), raw_relmse=3.0)


@pytest.fixture(autouse=True)
def _one_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every cell be cheap to prepare; poses stay."""
    monkeypatch.setattr(denoise_trial, "_ASSETS", ("sphere",))
    monkeypatch.setattr(denoise_trial, "_LIGHTS", ("lamp",))
    monkeypatch.setattr(denoise_trial, "trial_looks", lambda: {"plastic": denoise_trial.LOOKS["plastic"].make})


def run_trial(frames: int, folder: Path, renderer: Renderer) -> list[Trial]:
    trial = DenoiseTrial(options=BenchOptions(frames=frames, resolution=SIDE), report=quiet, open_process=renderer)
    trial.run(folder)
    return trial.trials


def test_true_errors_are_without_the_references_own(tmp_path: Path) -> None:
    trials = run_trial(7, tmp_path / "out", Renderer())
    assert [trial.samples for trial in trials] == [*SAMPLES, *SAMPLES[:2]]
    image, alpha = truth()
    relative = float((1.0 / (image[alpha > 0.0] ** 2 + EPSILON)).mean())
    for trial in trials:
        # The reference has 8 times the largest count; squares of 8,000 values spread by some percent.
        assert trial.reference_relmse == pytest.approx(NOISE**2 / (8 * SAMPLES[-1]) * relative, rel=0.2)
        assert trial.raw_relmse == pytest.approx(NOISE**2 / trial.samples * relative, rel=0.1)
        assert trial.denoised_relmse == pytest.approx(BIAS**2 * relative, rel=0.1)
        assert (trial.raw_estimate, trial.denoised_estimate) == (3.0, 2.0)
    # What an eye sees of noise is less than its error.
    assert trials[0].denoised_flip < 0.5 * trials[0].raw_flip
    with (tmp_path / "out" / DenoiseTrial.FILE).open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["denoised_relmse"]) for row in rows] == [trial.denoised_relmse for trial in trials]


def test_frames_share_no_seed_and_references_are_kept(tmp_path: Path) -> None:
    first, second = Renderer(), Renderer()
    run_trial(10, tmp_path, first)
    seeds = [task.scene.sampling.seed for task in first.tasks if task.scene.sampling.denoise == "measured"]
    assert len(set(seeds)) == 10
    assert max(seeds) < FIRST_SEED
    run_trial(10, tmp_path, second)
    assert {task.scene.sampling.denoise for task in second.tasks} == {"measured"}


def test_a_cell_depends_on_seed_and_number_alone() -> None:
    assert draw_cell(3, 5) == draw_cell(3, 5)
    assert len({draw_cell(seed, number) for seed in range(3) for number in range(3)}) == 9
    assert cell_scene(*draw_cell(0, 0), SIDE)[1] != cell_scene(*draw_cell(0, 1), SIDE)[1]


def test_ctrl_c_keeps_the_frames_before_it(tmp_path: Path) -> None:
    # A reference of four parts, then frames.
    assert len(run_trial(5, tmp_path, Renderer(ends_after=6))) == 2
    assert len((tmp_path / DenoiseTrial.FILE).read_text().splitlines()) == 3


def test_the_report_counts_what_is_out_of_bounds() -> None:
    one = Trial("sphere", "plastic", "lamp", 0.0, 0.0, 8, 4e-2, 4e-2, 1e-2, 1e-2, 0.2, 0.1, 1e-5, 1.0)
    trials = [
        one,
        replace(one, denoised_estimate=1.4e-2),
        replace(one, denoised_estimate=0.5e-2),
        replace(one, denoised_relmse=5e-2),
    ]
    same = replace(one, denoised_relmse=4e-2 * (1.0 + 1e-6))  # as rounding leaves it
    lines = summarize_trials(trials).splitlines()
    assert "denoised frames / truth: within 1.3 for 25%, least 0.20 (2 below 0.6)" in lines[1]
    assert "raw frames / truth: within 1.3 for 100%, least 1.00 (0 below 0.6)" in lines[2]
    assert lines[3] == "worse than raw: 1, at most x1.250"
    assert lines[4] == "8 samples: error / 2.67, FLIP 0.2000 raw, 0.1000 denoised"
    assert "worse than raw: 0" in summarize_trials([same]).splitlines()
    assert summarize_trials([]) == "no frame was measured"


def test_a_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[DenoiseTrial] = []

    def run(trial: DenoiseTrial, folder: Path, document: Path | None) -> None:
        assert (folder, document) == (tmp_path, None)
        runs.append(trial)

    monkeypatch.setattr(DenoiseTrial, "run", run)
    line = ["bench", "--denoise-trial", "--frames", "12", "--seed", "3", "--out", str(tmp_path)]
    assert CliRunner().invoke(app, line).exit_code == 130
    CliRunner().invoke(app, [*line, "--resolution", "160"])
    options = BenchOptions(frames=12, seed=3, reference=8, resolution=96)
    assert [trial.options for trial in runs] == [options, replace(options, resolution=160)]
