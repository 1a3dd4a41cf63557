"""Turntables against the plain script, with producers that only write noise."""

import json
import math
from dataclasses import asdict
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock, call

import numpy as np
import pytest
from bench_fakes import quiet, truth

from lookdev.asset import read_asset
from lookdev.bench import sequence
from lookdev.bench.measure import CurvePoint
from lookdev.bench.options import BenchOptions
from lookdev.bench.sequence import (
    ProduceFrames,
    SequenceBenchmark,
    SequenceResult,
    SequenceSubject,
    choose_samples,
    match_error,
    producers_of,
)  # fmt: skip
from lookdev.errors import LookdevError, RenderError
from lookdev.job import JobOutputs
from lookdev.metrics import EPSILON
from lookdev.output.exr import read_frame, read_header, write_frame
from lookdev.plan import Plan, Setup, TurntableFrames, build_plan

GREY = 0.5
SUBJECT = SequenceSubject("suzanne", "plastic", ("city", "studio"), 64)


def curve(scale: float, exponent: float = 1.0) -> list[CurvePoint]:
    return [CurvePoint(scale * n**-exponent, 0.0, 0.0, n, 0.1 * n) for n in (4, 16, 64)]


class FakeProducer:
    """Writes frames whose noise has a variance of ``scale^2 / samples``, at so many seconds a sample."""

    def __init__(self, scale: float, cost: float, skips: tuple[str, ...] = ()) -> None:
        self.scale = scale
        self.skips = skips
        self.cost = cost
        self.calls: list[tuple[int, int, int]] = []

    def __call__(self, folder: Path, samples: int, frames: int, seed: int) -> tuple[float, tuple[str, ...]]:
        self.calls.append((samples, frames, seed))
        _, alpha = truth()
        image = np.repeat(GREY * alpha[..., None], 3, axis=-1)
        for ibl, kind, number in product(SUBJECT.ibls, sequence.KINDS, range(frames)):
            rng = np.random.default_rng([samples, seed, number, *ibl.encode(), *kind.encode()])
            noise = rng.normal(size=image.shape) * self.scale / math.sqrt(samples) * alpha[..., None]
            write_frame(folder / "plastic" / ibl / f"{kind}.{number + 1:04d}.exr", image + noise, alpha, {})
        return self.cost * samples * frames, self.skips


def time_producers(fakes: dict[str, ProduceFrames], samples: int, guess: int, **options: int) -> SequenceResult:
    subject = {"scenes": (SUBJECT.scene,), "ibls": SUBJECT.ibls, "resolution": SUBJECT.resolution}
    benchmark = SequenceBenchmark(options=BenchOptions(**subject, **options), report=quiet, producers=fakes)
    benchmark.check()
    benchmark.time_producers(samples, guess)
    assert benchmark.result is not None
    return benchmark.result


def test_samples_that_make_mean_errors_equal() -> None:
    # exact: 0.02 / n and 0.04 / n, on average 1e-3 at 30, so 32 and an error of 9.375e-4.
    exact, plain = choose_samples([curve(0.02), curve(0.04)], [curve(0.1), curve(0.2)], 1e-3)
    assert exact == 32
    assert plain == math.ceil(0.15 / (0.03 / 32))


def test_a_curve_beyond_its_points() -> None:
    assert choose_samples([curve(0.5)], [curve(0.5)], 1e-3) == (512, 512)


@pytest.mark.parametrize(
    ("exact", "message"), [([curve(0.02)[:1]], "two points"), ([curve(1.0, 0.01)], "out of reach")]
)
def test_insufficient_curves_are_refused(exact: list[list[CurvePoint]], message: str) -> None:
    with pytest.raises(LookdevError, match=message):
        choose_samples(exact, [curve(0.1)], 1e-3)


@pytest.mark.parametrize("exponent", [0.6, 1.0, 2.2])
def test_the_plain_scripts_samples_are_corrected_by_its_measured_error(exponent: float) -> None:
    error = Mock(side_effect=lambda count: float(0.5 * count**-exponent))
    right = (0.5 / 1e-3) ** (1.0 / exponent)
    assert error(match_error(1e-3, max(1, round(right / 3.0)), error)) == pytest.approx(1e-3, rel=0.1)
    assert error.call_count <= 5


def test_an_error_that_samples_do_not_change_ends_the_search() -> None:
    error = Mock(return_value=1e-2)
    assert call(match_error(1e-3, 100, error)) in error.mock_calls
    assert error.call_count <= 4


def test_both_are_timed_at_equal_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sequence, "FRAMES", 6)
    fakes = {"exact": FakeProducer(0.1, 0.01, ("no frames (none)",)), "plain": FakeProducer(0.2, 0.02)}
    # Four times the samples make the plain script's error equal; the first guess is far off.
    result = time_producers(fakes, 16, 20, repeats=2, seed=5)
    assert result.samples["exact"] == 16
    assert result.samples["plain"] == pytest.approx(64, rel=0.15)
    assert result.relmse["plain"] == pytest.approx(result.relmse["exact"], rel=0.15)
    assert result.frames == 6 * 2 * 2
    assert result.skips == ("no frames (none)",)
    assert [(run.backend, run.repeat) for run in result.runs] == [
        ("exact", 0), ("plain", 0), ("exact", 1), ("plain", 1)
    ]  # fmt: skip
    seconds = 0.01 * 16 * 6
    assert result.runs[0].frames_per_minute == pytest.approx(60.0 * 24 / seconds)
    assert result.ratio == pytest.approx(2.0 * result.samples["plain"] / 16)
    assert result.low == result.high == result.ratio
    # What judges the timed frames has other seeds than they.
    assert {seed for _, frames, seed in fakes["exact"].calls if frames == 6} == {5}
    assert 5 not in {seed for _, frames, seed in fakes["exact"].calls if frames == 3}


def test_the_measured_error_is_that_of_one_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sequence, "FRAMES", 3)
    fakes = {"exact": FakeProducer(0.05, 1.0), "plain": FakeProducer(0.05, 1.0)}
    result = time_producers(fakes, 16, 16, repeats=1)
    # From 12 frames of 43 x 64 x 3 values: 1 % of noise, and as much because the median of neighbours has noise too.
    assert result.relmse["exact"] == pytest.approx(0.05**2 / 16 / (GREY**2 + EPSILON), rel=0.05)


def test_what_the_script_cannot_show_is_refused() -> None:
    with pytest.raises(LookdevError, match="the plain script cannot render pixar on suzanne"):
        SequenceSubject("suzanne", "pixar", ("city",), 64)


def test_both_show_the_same(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    plans, requests = [], []

    def render(setups: list[Setup], turns: TurntableFrames, outputs: JobOutputs) -> tuple[Plan, object]:
        plans.append(build_plan(setups, turns, read_header))
        return plans[0], SimpleNamespace(interrupted=False, exit_code=0)

    def run(command: tuple[str, ...], **options: object) -> object:
        requests.append(json.loads(Path(command[-1]).read_text()))
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(sequence, "render_setups", render)
    monkeypatch.setattr(sequence.subprocess, "run", run)
    produce = producers_of(SequenceSubject("suzanne", "plastic", ("white",), 64))
    assert "light from behind (nothing transmits)" in produce["exact"](tmp_path / "a", 16, 3, 7)[1]
    assert produce["plain"](tmp_path / "b", 20, 3, 7)[0] >= 0.0
    (plan,), (request,) = plans, requests
    scene = plan.frames[0].task.scene
    assert (scene.sampling.samples, scene.sampling.seed, scene.sampling.bounces) == (16, 7, request["bounces"])
    assert (request["samples"], request["seed"]) == (20, 7)
    assert list(scene.resolution) == request["resolution"]
    assert json.loads(json.dumps(asdict(scene.camera))) == request["camera"]
    for reel, frames in zip(plan.reels, (request["frames"][:3], request["frames"][3:]), strict=True):
        places = [path.relative_to(tmp_path / "a") for path in reel.files]
        assert places == [Path(frame["file"]).relative_to(tmp_path / "b") for frame in frames]
    second = request["frames"][1]
    assert (second["element"], second["lighting"]) == (120.0, 0.0)
    assert Path(request["asset"]) == scene.asset.path
    assert read_asset(scene.asset.path).name == "suzanne"
    # The white light, as an image: 1 everywhere.
    light, _ = read_frame(Path(request["frames"][-1]["light"]))
    assert (light == 1.0).all()


def test_a_script_that_fails_reports_its_last_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sequence, "PLAIN_COMMAND", ("sh", "-c", "echo no Blender here >&2; exit 3"))
    subject = SequenceSubject("suzanne", "plastic", ("white",), 64)
    with pytest.raises(RenderError, match="exit code 3: no Blender here"):
        producers_of(subject)["plain"](tmp_path / "b", 20, 3, 7)
