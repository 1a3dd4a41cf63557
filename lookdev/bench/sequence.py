"""Turntables by the batch runner, against the same frames by a plain Blender script, at equal error.

The plain script (`lookdev.cycles.plain_sequence`) uses the Principled BSDF, an environment texture turned by a Mapping
node, a turned object, and ``bpy.ops.render.render`` for each frame, in one process. Both are timed from their start to
their last file.
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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from lookdev.asset import BUILTINS, load_asset
from lookdev.bench.backends import bench_asset, bench_environment, bench_light, bench_scene
from lookdev.bench.curves import at
from lookdev.bench.looks import LOOKS
from lookdev.bench.matrix import LARGEST_SAMPLES, SCENES
from lookdev.bench.measure import CurvePoint
from lookdev.codegen.principled import generate_principled
from lookdev.errors import LookdevError, RenderError
from lookdev.job import JobOutputs, JobTurntable
from lookdev.light import load_environment, prepare_light
from lookdev.metrics import relmse_of_halves
from lookdev.output.exr import read_frame, write_frame
from lookdev.output.frame_name import FrameName
from lookdev.plan import Setup, Turns, make_setup
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.worker import last_line
from lookdev.run.render import render_setups
from lookdev.scene import Sampling, Scene

TARGET = 1e-3
"""relMSE of the frames."""

FRAMES = 24
KINDS: tuple[Literal["element", "lighting"], ...] = ("element", "lighting")
PLAIN_COMMAND = (sys.executable, "-m", "lookdev.cycles.plain_sequence")

# Frames of each turntable that are rendered again with other seeds, to estimate their error; a divisor of FRAMES.
_PROBES = 3
# Corrections of the plain script's samples, and the largest factor of one.
_ROUNDS = 3
_LONGEST_STEP = 8.0


@dataclass(frozen=True)
class Subject:
    """A scene and a look under lights; the frame's side in pixels. Raises LookdevError without a plain script."""

    scene: str
    look: str
    ibls: tuple[str, ...]
    resolution: int

    def __post_init__(self) -> None:
        unlike = BACKENDS["principled"].cannot_show
        if unlike(LOOKS[self.look].make()) or self.scene not in BUILTINS:
            looks = [name for name, each in LOOKS.items() if not unlike(each.make())]
            raise LookdevError(
                f"there is no plain script of {self.look} on {self.scene}; "
                f"looks that there are: {', '.join(looks)}; scenes: {', '.join(SCENES.keys() & BUILTINS.keys())}"
            )


@dataclass(frozen=True)
class Produced:
    """The cost of turntables: seconds, and skips with their reasons."""

    seconds: float
    skips: tuple[str, ...] = ()


Produce = Callable[[Path, int, int, int], Produced]
"""Renders all turntables with samples, frames a turntable and a seed, as ``<folder>/<look>/<ibl>/<kind>.####.exr``."""


@dataclass(frozen=True)
class SequenceRun:
    """One timed run of all turntables."""

    backend: str
    repeat: int
    seconds: float
    frames_per_minute: float


@dataclass(frozen=True)
class SequenceResult:
    """Frames a minute of the batch runner ("exact") and the plain script ("plain") at equal mean relMSE."""

    subject: Subject
    frames: int  # all that are shown, rendered or not
    samples: Mapping[str, int]
    relmse: Mapping[str, float]  # of frames of the timed runs
    runs: tuple[SequenceRun, ...]
    ratio: float  # of the medians, exact over plain
    low: float  # of the repeats
    high: float
    skips: tuple[str, ...] = ()  # of the batch runner


def choose_samples(
    exact: Sequence[Sequence[CurvePoint]], plain: Sequence[Sequence[CurvePoint]], target: float
) -> tuple[int, int]:
    """Return the samples with which both have the same mean error over the lights, with a curve each.

    For ``exact`` the smallest power of two at which it is at most `target`; for the plain script, the samples of the
    same error. Raises LookdevError where a curve has less than two points, or does not reach the target.
    """
    powers = [1 << exponent for exponent in range(1, LARGEST_SAMPLES.bit_length())]
    chosen = _first(powers, exact, target)
    return chosen, _first(range(1, 8 * LARGEST_SAMPLES), plain, _mean_error(exact, chosen))


def _first(counts: Sequence[int], curves: Sequence[Sequence[CurvePoint]], target: float) -> int:
    low, high = 0, len(counts) - 1
    if _mean_error(curves, counts[high]) > target:
        raise LookdevError(f"relMSE {target:g} is out of reach of {counts[high]} samples: nothing to compare")
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if _mean_error(curves, counts[middle]) <= target else (middle + 1, high)
    return counts[low]


def _mean_error(curves: Sequence[Sequence[CurvePoint]], samples: int) -> float:
    errors = []
    for curve in curves:
        known = [(float(point.samples), point.relmse) for point in curve if point.relmse is not None]
        if len(known) < 2:
            raise LookdevError("a curve of two points or more is needed; give --samples more counts")
        errors.append(at([count for count, _ in known], [error for _, error in known], samples))
    return statistics.fmean(errors)


def measure_sequence(
    subject: Subject,
    samples: tuple[int, int],
    producers: Mapping[str, Produce],
    *,
    repeats: int,
    seed: int,
    report: Callable[[str], None],
) -> SequenceResult:
    """Time the producers ``"exact"`` and ``"plain"``, interleaved.

    `samples` are those of ``exact``, and a first guess of the plain script's, corrected by the error of a few frames.
    """
    total = FRAMES * len(KINDS) * len(subject.ibls)
    runs: list[SequenceRun] = []
    with tempfile.TemporaryDirectory(prefix="lookdev-bench-") as scratch:
        folders = (Path(scratch, str(number)) for number in itertools.count())
        probes: dict[tuple[str, int], Path] = {}

        def probe(backend: str, count: int) -> float:
            report(f"sequence: {backend}: {_PROBES} frames of each turntable, {count} samples, twice")
            one, other = next(folders), next(folders)
            producers[backend](one, count, _PROBES, seed + 1)
            producers[backend](other, count, _PROBES, seed + 2)
            probes[backend, count] = one
            return _error(subject, one, other, _PROBES)

        target = probe("exact", samples[0])
        count = {"exact": samples[0], "plain": meet(target, samples[1], lambda count: probe("plain", count))}
        timed: dict[str, Path] = {}
        made: dict[str, Produced] = {}
        for repeat in range(repeats):
            for backend in ("exact", "plain"):
                report(f"sequence: {backend}: {total} frames, {count[backend]} samples")
                timed[backend] = next(folders)
                made[backend] = producers[backend](timed[backend], count[backend], FRAMES, seed)
                seconds = made[backend].seconds
                runs.append(SequenceRun(backend, repeat, seconds, 60.0 * total / seconds))
        relmse = {
            backend: _error(subject, timed[backend], probes[backend, count[backend]], FRAMES) for backend in timed
        }
    speed = {
        backend: [run.frames_per_minute for run in runs if run.backend == backend] for backend in ("exact", "plain")
    }
    ratios = [one / other for one, other in zip(speed["exact"], speed["plain"], strict=True)]
    medians = {backend: statistics.median(values) for backend, values in speed.items()}
    ratio = medians["exact"] / medians["plain"]
    skips = made["exact"].skips
    return SequenceResult(subject, total, count, relmse, tuple(runs), ratio, min(ratios), max(ratios), skips)


def meet(target: float, first: int, error: Callable[[int], float]) -> int:
    """Return the samples whose measured error is nearest to a target, within a tenth if possible.

    `first` is a guess. Further ones are interpolated, in logarithms, because the error of rare bright pixels does not
    fall as 1 / samples.
    """
    found = {first: error(first)}
    for _ in range(_ROUNDS):
        count = min(found, key=lambda count: abs(math.log(found[count] / target)))
        if abs(math.log(found[count] / target)) < math.log(1.1):
            break
        guess = count * found[count] / target
        rising = sorted((value, count) for count, value in found.items())
        if len(rising) > 1 and [each for _, each in rising] == sorted(found, reverse=True):
            guess = at([value for value, _ in rising], [float(count) for _, count in rising], target)
        guess = max(1, round(min(max(guess, count / _LONGEST_STEP), count * _LONGEST_STEP)))
        if guess in found:
            break
        found[guess] = error(guess)
    return min(found, key=lambda count: abs(math.log(found[count] / target)))


def _error(subject: Subject, one: Path, probes: Path, frames: int) -> float:
    """Return the mean relMSE of a folder's frames, from independent renders of some of them.

    `relmse_of_halves` is the error of the mean of two renders, half of that of each.
    """
    errors = []
    for ibl, kind, number in itertools.product(subject.ibls, KINDS, range(_PROBES)):
        whole = FrameName(subject.look, ibl, kind, 1 + number * (frames // _PROBES))
        a, alpha = read_frame(whole.file(one))
        b, _ = read_frame(replace(whole, number=1 + number).file(probes))
        errors.append(2.0 * relmse_of_halves(a, b, alpha))
    return statistics.fmean(errors)


def producers(subject: Subject) -> dict[str, Produce]:
    """Return the batch runner and the plain script."""

    def exact(folder: Path, samples: int, frames: int, seed: int) -> Produced:
        turntables = tuple(JobTurntable(kind=kind, frames=frames) for kind in KINDS)
        started = time.perf_counter()
        setups = _setups(subject, samples, seed)
        plan, result = render_setups(setups, Turns(turntables, folder), JobOutputs())
        seconds = time.perf_counter() - started
        if result.interrupted:
            raise KeyboardInterrupt
        if result.exit_code:
            raise RenderError(result.summary())
        return Produced(seconds, tuple(dict.fromkeys(map(str, plan.skips))))

    def plain(folder: Path, samples: int, frames: int, seed: int) -> Produced:
        request = _write_request(subject, folder, samples, frames, seed)
        log = folder / "plain.log"
        started = time.perf_counter()
        with log.open("wb") as stream:
            done = subprocess.run((*PLAIN_COMMAND, str(request)), stdout=stream, stderr=stream, check=False)
        seconds = time.perf_counter() - started
        if done.returncode:
            raise RenderError(f"the plain script ended with exit code {done.returncode}: {last_line(log)}")
        return Produced(seconds)

    return {"exact": exact, "plain": plain}


def _setups(subject: Subject, samples: int, seed: int) -> list[Setup]:
    """Read and generate everything, without caches in memory, as a job does."""
    asset, look = load_asset(builtin=subject.scene), LOOKS[subject.look].make()
    sampling = Sampling(samples=samples, bounces=SCENES[subject.scene].bounces, seed=seed)
    size = (subject.resolution, subject.resolution)
    lights = {ibl: prepare_light(load_environment(builtin=ibl)) for ibl in subject.ibls}
    return [
        make_setup(subject.look, ibl, Scene.of_look(asset, look, light, size), sampling)
        for ibl, light in lights.items()
    ]


def _write_request(subject: Subject, folder: Path, samples: int, frames: int, seed: int) -> Path:
    folder.mkdir(parents=True)
    asset, look = bench_asset(subject.scene), LOOKS[subject.look].make()
    maps = {}
    for ibl in subject.ibls:
        radiance = bench_environment(ibl).radiance
        maps[ibl] = folder / f"{ibl}.exr"
        write_frame(maps[ibl], radiance, np.ones(radiance.shape[:2]), {})
    light = bench_light(subject.ibls[0])
    scene = bench_scene(asset, look, (light,), subject.resolution, SCENES[subject.scene].bounces)
    request = {
        "asset": str(scene.asset.path),
        "principled": generate_principled(look).inputs,
        "camera": asdict(scene.camera),
        "resolution": scene.resolution,
        "samples": samples,
        "bounces": scene.sampling.bounces,
        "seed": seed,
        "frames": [
            {
                "light": str(maps[ibl]),
                "element": 360.0 * index / frames if kind == "element" else 0.0,
                "lighting": 360.0 * index / frames if kind == "lighting" else 0.0,
                "file": str(FrameName(subject.look, ibl, kind, 1 + index).file(folder)),
            }
            for ibl, kind, index in itertools.product(subject.ibls, KINDS, range(frames))
        ],
    }
    file = folder / "request.json"
    file.write_text(json.dumps(request), encoding="utf-8")
    return file
