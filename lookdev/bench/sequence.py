"""Benchmark of turntables: the frames per minute of the batch runner and of a plain Blender script, at equal error.

The plain script (`lookdev.cycles.plain_sequence`) runs in one process. It uses the Principled BSDF, rotates the asset's
object, rotates the environment texture by a Mapping node, and calls ``bpy.ops.render.render`` for each frame. Both
programs are timed from their start to their last file.
"""

from __future__ import annotations

import itertools
import json
import math
import statistics
import subprocess
import sys
import tempfile
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lookdev.asset import BUILTINS, load_asset
from lookdev.bench.benchmark import TextTable
from lookdev.bench.matrix import MatrixBenchmark
from lookdev.bench.measure import CurvePoint, Series
from lookdev.bench.options import MAX_SAMPLES
from lookdev.bench.subjects import LOOKS, SCENES, bench_environment, bench_light, bench_scene
from lookdev.codegen.principled import generate_principled
from lookdev.errors import LookdevError, RenderError
from lookdev.job import JobOutputs, JobTurntable
from lookdev.light import load_environment, prepare_light
from lookdev.metrics import relmse_of_halves
from lookdev.output.exr import read_frame, write_frame
from lookdev.output.frame_name import FrameName
from lookdev.plan import TurntableFrames, make_setup
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.worker import last_line
from lookdev.run.render import render_setups
from lookdev.scene import Sampling, Scene

TARGET = 1e-3
"""The mean relMSE that the frames of both programs shall have."""

FRAMES = 24  # the frames of each turntable
KINDS: tuple[Literal["element", "lighting"], ...] = ("element", "lighting")  # the kinds of turntables
PLAIN_COMMAND = (sys.executable, "-m", "lookdev.cycles.plain_sequence")

# A probe is a frame that is rendered again with another seed, to estimate the error of the frame from the difference.
_PROBES = 3  # probes of each turntable; it divides FRAMES
_ROUNDS = 3  # the most corrections of the samples of the plain script
_MAX_STEP = 8.0  # the largest factor by which one correction changes the samples


@dataclass(frozen=True)
class SequenceSubject:
    """A scene and a look under several lights, and the side of the frame in pixels.

    Raises LookdevError if the plain script cannot render the scene or the look.
    """

    scene: str
    look: str
    ibls: tuple[str, ...]
    resolution: int

    def __post_init__(self) -> None:
        look_gap = BACKENDS["principled"].look_gap
        if look_gap(LOOKS[self.look].make()) or self.scene not in BUILTINS:
            looks = [name for name, look in LOOKS.items() if not look_gap(look.make())]
            raise LookdevError(
                f"the plain script cannot render {self.look} on {self.scene}; "
                f"looks that there are: {', '.join(looks)}; scenes: {', '.join(SCENES.keys() & BUILTINS.keys())}"
            )


ProduceFrames = Callable[[Path, int, int, int], tuple[float, tuple[str, ...]]]
"""Renders all turntables as files ``<folder>/<look>/<ibl>/<kind>.####.exr``.

Its arguments are the folder, the samples per pixel, the frames of each turntable, and a seed. It returns the seconds
that it took, and descriptions of the work that it left out, which would change no pixel.
"""


@dataclass(frozen=True)
class SequenceRun:
    """One timed run of all turntables. `backend` is "exact", the batch runner, or "plain", the plain script."""

    backend: str
    repeat: int
    seconds: float
    frames_per_minute: float


@dataclass(frozen=True)
class SequenceResult:
    """Frames per minute of the batch runner and of the plain script at equal mean relMSE.

    The keys of mappings are "exact", the batch runner, and "plain", the plain script.
    """

    subject: SequenceSubject
    frames: int  # of all turntables, including frames that the batch runner does not need to render
    samples: Mapping[str, int]  # per pixel
    relmse: Mapping[str, float]  # mean over frames of the timed runs
    runs: tuple[SequenceRun, ...]
    ratio: float  # frames per minute of "exact" over frames per minute of "plain", from the medians of the repeats
    low: float  # the least ratio of a repeat
    high: float  # the largest ratio of a repeat
    skips: tuple[str, ...] = ()  # work that the batch runner leaves out because it changes no pixel

    def blocks(self) -> Iterator[str | TextTable]:
        """Yield the ratio, a table with a row for each program, and the skips."""
        subject = self.subject
        yield (
            f"{self.frames} frames of {subject.scene}, {subject.look}, under {', '.join(subject.ibls)}: exact makes "
            f"{self.ratio:.2f} times as many a minute ({self.low:.2f}..{self.high:.2f})"
        )
        rows = []
        for backend, samples in self.samples.items():
            speeds = ", ".join(f"{run.frames_per_minute:.2f}" for run in self.runs if run.backend == backend)
            rows.append((backend, str(samples), f"{self.relmse[backend]:.2e}", speeds))
        yield TextTable(("", "samples", "relMSE", "frames a minute"), rows)
        if self.skips:
            yield f"exact skips {', '.join(self.skips)}"


@dataclass(kw_only=True)
class SequenceBenchmark(MatrixBenchmark):
    """The benchmark that compares turntables of the batch runner with turntables of a plain Blender script.

    It first measures the curves of the backends ``exact`` and ``principled``. From these follow the samples that make
    the errors of the two programs equal. Raises LookdevError if one of these backends fails.
    """

    NAME = "sequence"
    DEFAULTS = {"scenes": ("shaderball",), "repeats": 1}  # noqa: RUF012

    result: SequenceResult | None = None
    producers: Mapping[str, ProduceFrames] | None = None  # these functions replace the result of `producers_of`

    def check(self) -> None:
        """Raise LookdevError for several scenes or looks, or if the plain script cannot render the only one."""
        options = self.options = replace(self.options, backends=("exact", "principled"))
        if len(options.scenes) != 1 or len(options.looks) != 1:
            raise LookdevError("the sequence is of one scene and one look: give --scenes and --looks one name each")
        self.subject = SequenceSubject(*options.scenes, *options.looks, options.ibls, options.resolution)

    def measure(self) -> Iterator[None]:
        yield from super().measure()
        if self.failures:
            raise RenderError(self.failures[0])
        exact, plain = ([cell.curves[Series(backend)] for cell in self.cells] for backend in self.options.backends)
        self.time_producers(*choose_samples(exact, plain, TARGET))
        yield

    def time_producers(self, samples: int, guess: int) -> None:
        """Time the batch runner and the plain script. The runs of the two programs are interleaved.

        `samples` is the number of samples of the batch runner. `guess` is a first number of samples of the plain
        script: it is corrected until the errors of a few frames of both programs are equal.
        """
        subject, seed, producers = self.subject, self.options.seed, self.producers or producers_of(self.subject)
        total = FRAMES * len(KINDS) * len(subject.ibls)
        runs: list[SequenceRun] = []
        with tempfile.TemporaryDirectory(prefix="lookdev-bench-") as scratch:
            folders = (Path(scratch, str(number)) for number in itertools.count())
            probes: dict[tuple[str, int], Path] = {}  # the folder of the probes, by program and samples

            def measure_probes(backend: str, count: int) -> float:
                """Render some frames of each turntable twice, with different seeds, and return their mean relMSE."""
                self.report(f"sequence: {backend}: {_PROBES} frames of each turntable, {count} samples, twice")
                pair = next(folders), next(folders)
                for number, folder in enumerate(pair, start=1):
                    producers[backend](folder, count, _PROBES, seed + number)
                probes[backend, count] = pair[0]
                return _mean_relmse(subject, *pair, _PROBES)

            target = measure_probes("exact", samples)
            counts = {"exact": samples, "plain": match_error(target, guess, partial(measure_probes, "plain"))}
            relmse, skips = {}, {}
            for repeat, backend in itertools.product(range(self.options.repeats), counts):
                self.report(f"sequence: {backend}: {total} frames, {counts[backend]} samples")
                folder = next(folders)
                seconds, skips[backend] = producers[backend](folder, counts[backend], FRAMES, seed)
                runs.append(SequenceRun(backend, repeat, seconds, 60.0 * total / seconds))
                relmse[backend] = _mean_relmse(subject, folder, probes[backend, counts[backend]], FRAMES)
        exact, plain = ([run.frames_per_minute for run in runs if run.backend == backend] for backend in counts)
        ratios = [ours / theirs for ours, theirs in zip(exact, plain, strict=True)]
        spread = statistics.median(exact) / statistics.median(plain), min(ratios), max(ratios)
        self.result = SequenceResult(subject, total, counts, relmse, tuple(runs), *spread, skips["exact"])

    def data(self) -> dict[str, Any]:
        return super().data() | {"sequence": asdict(self.result) if self.result else None}

    def details(self) -> Iterator[str | TextTable]:
        yield from super().details()
        if self.result:
            yield from self.result.blocks()


def choose_samples(
    exact: Sequence[Sequence[CurvePoint]], plain: Sequence[Sequence[CurvePoint]], target: float
) -> tuple[int, int]:
    """Return the samples of the batch runner and the samples of the plain script that give the same mean error.

    `exact` and `plain` have a curve for each light; the mean is over the lights. The samples of the batch runner are
    the smallest power of two with a mean error of at most `target`. Raises LookdevError if a curve has less than two
    points or does not reach the target.
    """
    powers = [1 << exponent for exponent in range(1, MAX_SAMPLES.bit_length())]
    samples = _fewest_samples(powers, exact, target)
    return samples, _fewest_samples(range(1, 8 * MAX_SAMPLES), plain, _mean_error(exact, samples))


def _fewest_samples(counts: Sequence[int], curves: Sequence[Sequence[CurvePoint]], target: float) -> int:
    """Return the first of increasing numbers of samples for which the mean error of the curves is at most `target`."""
    number = bisect_left(counts, True, key=lambda count: _mean_error(curves, count) <= target)
    if number == len(counts):
        raise LookdevError(f"relMSE {target:g} is out of reach of {counts[-1]} samples: nothing to compare")
    return counts[number]


def _mean_error(curves: Sequence[Sequence[CurvePoint]], samples: int) -> float:
    """Return the mean relMSE of curves at a number of samples."""
    certain = [[(point.samples, point.relmse) for point in curve if point.relmse is not None] for curve in curves]
    return statistics.fmean(error_at(points, samples) for points in certain)


def match_error(target: float, guess: int, error: Callable[[int], float]) -> int:
    """Return the number of samples whose measured error is nearest to a target, within a tenth if possible.

    `error` measures the error with a number of samples. The number `guess` is measured first. The next numbers follow
    by interpolation in logarithms, because the error of rare bright pixels does not fall as 1 / samples.
    """
    errors: dict[int, float] = {}
    for _ in range(1 + _ROUNDS):
        if guess in errors:
            break
        errors[guess] = error(guess)
        count = min(errors, key=lambda count: abs(math.log(errors[count] / target)))
        if abs(math.log(errors[count] / target)) < math.log(1.1):
            break
        # From a single measurement, the error is assumed to fall as 1 / samples.
        better = count * errors[count] / target
        by_samples = sorted(errors.items())
        if len(errors) > 1 and all(one > other for (_, one), (_, other) in pairwise(by_samples)):
            better = error_at([(value, samples) for samples, value in reversed(by_samples)], target)
        guess = max(1, round(min(max(better, count / _MAX_STEP), count * _MAX_STEP)))
    return count


def error_at(curve: Sequence[tuple[float, float]], effort: float) -> float:
    """Return the error at an effort on a curve of pairs (effort, error), by increasing effort.

    The curve is interpolated, and extrapolated, linearly in the logarithms of both. Raises LookdevError if the curve
    has less than two points.
    """
    if len(curve) < 2:
        raise LookdevError("a curve of two points or more is needed; give --samples more counts")
    start, end = next((pair for pair in pairwise(curve) if effort <= pair[1][0]), curve[-2:])
    slope = math.log(end[1] / start[1]) / math.log(end[0] / start[0])
    return start[1] * math.exp(slope * math.log(effort / start[0]))


def _mean_relmse(subject: SequenceSubject, folder: Path, probes: Path, frames: int) -> float:
    """Return the mean relMSE of a folder's turntables of `frames` frames, from the frames that have probes.

    `probes` is the folder with the independent renders of these frames. `relmse_of_halves` estimates the error of the
    mean of two renders, which is half the error of one render.
    """
    errors = []
    for ibl, kind, number in itertools.product(subject.ibls, KINDS, range(_PROBES)):
        # The probes are evenly spaced over the turntable.
        frame = FrameName(subject.look, ibl, kind, 1 + number * (frames // _PROBES))
        a, alpha = read_frame(frame.file(folder))
        b, _ = read_frame(replace(frame, number=1 + number).file(probes))
        errors.append(2.0 * relmse_of_halves(a, b, alpha))
    return statistics.fmean(errors)


def producers_of(subject: SequenceSubject) -> dict[str, ProduceFrames]:
    """Return the functions that render a subject by the batch runner, "exact", and by the plain script, "plain"."""
    return {"exact": partial(_render_job, subject), "plain": partial(_render_plainly, subject)}


def _render_job(
    subject: SequenceSubject, folder: Path, samples: int, frames: int, seed: int
) -> tuple[float, tuple[str, ...]]:
    """Render by the batch runner; asset, lights and sources are loaded and generated anew, as in a job's process."""
    turntables = tuple(JobTurntable(kind=kind, frames=frames) for kind in KINDS)
    started = time.perf_counter()
    asset, look = load_asset(builtin=subject.scene), LOOKS[subject.look].make()
    sampling = Sampling(samples=samples, bounces=SCENES[subject.scene].bounces, seed=seed)
    setups = []
    for ibl in subject.ibls:
        light = prepare_light(load_environment(builtin=ibl))
        scene = Scene.of_look(asset, look, light, (subject.resolution, subject.resolution))
        setups.append(make_setup(subject.look, ibl, scene, sampling))
    plan, result = render_setups(setups, TurntableFrames(turntables, folder), JobOutputs())
    seconds = time.perf_counter() - started
    if result.interrupted:
        raise KeyboardInterrupt
    if result.exit_code:
        raise RenderError(result.summary())
    return seconds, tuple(dict.fromkeys(map(str, plan.skips)))


def _render_plainly(
    subject: SequenceSubject, folder: Path, samples: int, frames: int, seed: int
) -> tuple[float, tuple[str, ...]]:
    """Render by the plain script."""
    folder.mkdir(parents=True)
    request, log = folder / "request.json", folder / "plain.log"
    fields = {"samples": samples, "seed": seed, **_request(subject, folder, frames)}
    request.write_text(json.dumps(fields), encoding="utf-8")
    started = time.perf_counter()
    with log.open("wb") as stream:
        process = subprocess.run((*PLAIN_COMMAND, str(request)), stdout=stream, stderr=stream, check=False)
    seconds = time.perf_counter() - started
    if process.returncode:
        raise RenderError(f"the plain script ended with exit code {process.returncode}: {last_line(log)}")
    return seconds, ()


def _request(subject: SequenceSubject, folder: Path, frames: int) -> dict[str, Any]:
    """Write the environment maps, and return the request for the plain script: scene, camera and frames."""
    look, maps = LOOKS[subject.look].make(), {}
    for ibl in subject.ibls:
        radiance = bench_environment(ibl).radiance
        maps[ibl] = folder / f"{ibl}.exr"
        write_frame(maps[ibl], radiance, np.ones(radiance.shape[:2]), {})
    scene = bench_scene(subject.scene, look, (bench_light(subject.ibls[0]),), subject.resolution)
    return {
        "asset": str(scene.asset.path),
        "principled": generate_principled(look).inputs,
        "camera": asdict(scene.camera),
        "resolution": scene.resolution,
        "bounces": scene.sampling.bounces,
        "frames": [
            {
                "light": str(maps[ibl]),
                **{turned: 360.0 * number / frames if turned == kind else 0.0 for turned in KINDS},
                "file": str(FrameName(subject.look, ibl, kind, 1 + number).file(folder)),
            }
            for ibl, kind, number in itertools.product(subject.ibls, KINDS, range(frames))
        ],
    }
