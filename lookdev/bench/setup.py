"""Benchmark of the time outside of sampling: commands in fresh processes, a worker's first frame, changes of scene.

The jobs are copies of example jobs in a temporary folder. Shader sources, maps and assets are in the cache, as after
earlier runs.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from lookdev.bench.benchmark import Benchmark, Spread, TextTable
from lookdev.codegen.source import ShaderSource
from lookdev.errors import LookdevError
from lookdev.export.examples import copy_example
from lookdev.plan.prepare import prepare_job
from lookdev.rendering.backends import WORKER_COMMAND
from lookdev.rendering.task import FrameTask
from lookdev.rendering.worker import Worker

JOBS = ("suzanne", "figure_16")
"""The measured example jobs: the first has few frames and a large mesh, the second has many looks and a small mesh."""

_TIMEOUT = 600.0  # seconds that a worker may be silent
_SAMPLES = 2  # the samples per pixel of the frames that measure changes of scene


@dataclass(frozen=True)
class StepTimes:
    """The wall seconds of each repeat of a step and, if the step is a command, its CPU seconds (`cpu`)."""

    step: str
    seconds: tuple[float, ...]
    cpu: tuple[float, ...] = ()


@dataclass(kw_only=True)
class SetupBenchmark(Benchmark):
    """The benchmark of commands, of a worker's first frame, and of changes of scene; `steps` are the measured steps."""

    NAME = "setup"
    FILE = "setup.json"
    ROWS = "steps"
    DEFAULTS = {"repeats": 5}  # noqa: RUF012

    steps: list[StepTimes] = field(default_factory=list)

    def measure(self) -> Iterator[None]:
        with tempfile.TemporaryDirectory(prefix="lookdev-bench-") as scratch:
            for times in measure_setup(Path(scratch), self.options.repeats):
                self.report(f"{times.step}: {Spread.of(times.seconds).text()} s")
                self.steps.append(times)
                yield

    def blocks(self) -> Iterator[str | TextTable]:
        yield from self.header()
        rows = [
            (times.step, *(Spread.of(seconds).text() if seconds else "" for seconds in (times.seconds, times.cpu)))
            for times in self.steps
        ]
        yield TextTable(("", "seconds", "CPU seconds"), rows)


def measure_setup(scratch: Path, repeats: int) -> Iterator[StepTimes]:
    """Yield the times of all steps: first the commands, then the first frame, then the changes of scene."""
    jobs = {name: copy_example(name, scratch / name).job for name in JOBS}
    for name, job in jobs.items():
        wall, cpu = _run_command("render", str(job))
        yield StepTimes(f"`lookdev render` of {name}, whole", (wall,), (cpu,))
    commands: dict[str, tuple[str, ...]] = {"`lookdev --help`": ("--help",)}
    for name, job in jobs.items():
        commands[f"`lookdev plan` of {name}"] = ("plan", str(job))
        commands[f"`lookdev render` of {name}, all frames done"] = ("render", str(job))
    times = zip(*([_run_command(*command) for command in commands.values()] for _ in range(repeats)), strict=True)
    for command, pairs in zip(commands, times, strict=True):
        yield StepTimes(command, *zip(*pairs, strict=True))
    tasks = {name: _first_frames(job) for name, job in jobs.items()}
    starts, frames = zip(*(_time_first_frame(scratch, tasks[JOBS[0]][0]) for _ in range(repeats)), strict=True)
    yield StepTimes("start of the worker", starts)
    yield StepTimes(f"first frame of {JOBS[0]} in a worker that is up", frames)
    for name in JOBS:
        yield from _time_changes(scratch, name, tasks[name])


def _run_command(*arguments: str) -> tuple[float, float]:
    """Run a `lookdev` command; return the wall seconds, and the CPU seconds of the command and its workers."""
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    process = subprocess.run([sys.executable, "-m", "lookdev", *arguments], capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    if process.returncode:
        error = process.stderr.strip()[-500:]
        raise LookdevError(f"lookdev {' '.join(arguments)} ended with {process.returncode}: {error}")
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _first_frames(job: Path) -> list[FrameTask]:
    """Return the first frame of each scene of a job."""
    tasks: dict[int, FrameTask] = {}
    for frame in prepare_job(job).plan.frames:
        tasks.setdefault(id(frame.task.scene), frame.task)
    return list(tasks.values())


def _time_first_frame(scratch: Path, task: FrameTask) -> tuple[float, float]:
    """Return the seconds of a worker's start and the seconds of its first frame, which include the scene's set-up."""
    with Worker(WORKER_COMMAND, scratch / "worker.log", scratch, _TIMEOUT) as worker:
        started = time.perf_counter()
        worker.start()
        up = time.perf_counter()
        worker.render(task, lambda progress: None)
        return up - started, time.perf_counter() - up


def _time_changes(scratch: Path, name: str, tasks: Sequence[FrameTask]) -> Iterator[StepTimes]:
    """Yield the seconds of frames with few samples, each in another scene than the frame before.

    Scenes with shader programs that the worker has compiled before are one step, and other scenes another step.
    """
    compiled: set[object] = set()
    seconds: dict[str, list[float]] = {"another program": [], "a known program": []}
    with Worker(WORKER_COMMAND, scratch / "worker.log", scratch, _TIMEOUT) as worker:
        worker.start()
        for number, task in enumerate(tasks):
            scene = replace(task.scene, sampling=replace(task.scene.sampling, samples=_SAMPLES, error=None))
            programs = {source.program for source in scene.shaders if isinstance(source, ShaderSource)}
            started = time.perf_counter()
            worker.render(replace(task, scene=scene), lambda progress: None)
            if number:  # the first frame is not a change of scene
                program = "a known program" if programs <= compiled else "another program"
                seconds[program].append(time.perf_counter() - started)
            compiled |= programs
    for program, values in seconds.items():
        if values:
            yield StepTimes(f"next scene of {name}, {program}, with {_SAMPLES} samples", tuple(values))
