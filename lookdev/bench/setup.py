"""What surrounds the sampling: whole commands in fresh processes, a worker's first frame, and changes of scene.

Jobs are copies of shipped ones in a folder of their own. Sources, maps and assets are in the cache, as after earlier
runs.
"""

from __future__ import annotations

import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from lookdev.bench.document import check_document, markdown, write_section
from lookdev.bench.results import Machine, machine_line, this_machine
from lookdev.cache import atomic_path
from lookdev.codegen.source import ShaderSource
from lookdev.errors import LookdevError
from lookdev.export.examples import copy_example
from lookdev.plan.prepare import prepare_job
from lookdev.rendering.backends import WORKER_COMMAND
from lookdev.rendering.task import FrameTask
from lookdev.rendering.worker import Worker

NAME = "setup"
JOBS = ("suzanne", "figure_16")
"""Few frames of a large mesh; many looks of a small one."""
_PATIENCE = 600.0
_SAMPLES = 2  # of the frames whose set-up is measured


@dataclass(frozen=True)
class Taken:
    """Wall seconds of something, in the order of the repeats, and CPU seconds where it is a command."""

    what: str
    seconds: tuple[float, ...]
    cpu: tuple[float, ...] = ()


@dataclass
class SetupResults:
    """The measurements so far."""

    machine: Machine = field(default_factory=this_machine)
    taken: list[Taken] = field(default_factory=list)
    complete: bool = False


def run_setup(folder: Path, report: Callable[[str], None], *, document: Path, repeats: int) -> SetupResults:
    """Measure, and write ``setup.json`` to `folder` and the section of the document, also after Ctrl-C.

    Raises LookdevError, before anything is measured, where the document has no place for it, and where a command fails.
    """
    check_document(document, NAME)
    folder.mkdir(parents=True, exist_ok=True)
    results = SetupResults()
    with tempfile.TemporaryDirectory(prefix="lookdev-bench-") as scratch:
        try:
            for each in _measured(Path(scratch), repeats):
                report(_line(each))
                results.taken.append(each)
            results.complete = True
        except KeyboardInterrupt:
            pass
        finally:
            with atomic_path(folder / "setup.json") as path:
                path.write_text(json.dumps(asdict(results), indent=1) + "\n", encoding="utf-8")
            if results.taken:
                write_section(document, NAME, setup_text(results))
    return results


def setup_text(results: SetupResults) -> str:
    """Return the section: the machine, and a row for each thing with medians, least and most."""
    rows = [(each.what, _spread(each.seconds), _spread(each.cpu) if each.cpu else "") for each in results.taken]
    note = "" if results.complete else "Not complete: this is what was measured until it ended.\n\n"
    return f"{machine_line(results.machine)}.\n\n{note}{markdown(('', 'seconds', 'CPU seconds'), rows)}"


def _measured(scratch: Path, repeats: int) -> Iterator[Taken]:
    jobs = {name: copy_example(name, scratch / name).job for name in JOBS}
    for name, job in jobs.items():
        wall, cpu = _command("render", str(job))
        yield Taken(f"`lookdev render` of {name}, whole", (wall,), (cpu,))
    commands: dict[str, tuple[str, ...]] = {"`lookdev --help`": ("--help",)}
    for name, job in jobs.items():
        commands[f"`lookdev plan` of {name}"] = ("plan", str(job))
        commands[f"`lookdev render` of {name}, all frames done"] = ("render", str(job))
    found: dict[str, list[tuple[float, float]]] = {what: [] for what in commands}
    for _ in range(repeats):
        for what, arguments in commands.items():
            found[what].append(_command(*arguments))
    for what, pairs in found.items():
        yield Taken(what, tuple(wall for wall, _ in pairs), tuple(cpu for _, cpu in pairs))
    frames = {name: [_few(task) for task in _first_frames(job)] for name, job in jobs.items()}
    whole = next(iter(_first_frames(jobs[JOBS[0]])))
    starts, firsts = zip(*(_first_frame(scratch, whole) for _ in range(repeats)), strict=True)
    yield Taken("start of the worker", starts)
    yield Taken(f"first frame of {JOBS[0]} in a worker that is up", firsts)
    for name in JOBS:
        yield from _changes(scratch, name, frames[name])


def _command(*arguments: str) -> tuple[float, float]:
    """Run a command of the program; return wall and CPU seconds of it and its workers."""
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    ended = subprocess.run([sys.executable, "-m", "lookdev", *arguments], capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    if ended.returncode:
        raise LookdevError(
            f"lookdev {' '.join(arguments)} ended with {ended.returncode}: {ended.stderr.strip()[-500:]}"
        )
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _first_frames(job: Path) -> Iterator[FrameTask]:
    """Yield a frame of each scene of a job."""
    scenes = set()
    for frame in prepare_job(job).plan.frames:
        if id(frame.task.scene) not in scenes:
            scenes.add(id(frame.task.scene))
            yield frame.task


def _few(task: FrameTask) -> FrameTask:
    sampling = replace(task.scene.sampling, samples=_SAMPLES, error=None)
    return replace(task, scene=replace(task.scene, sampling=sampling))


def _first_frame(scratch: Path, task: FrameTask) -> tuple[float, float]:
    """Return the seconds of a worker's start and of its first frame, set-up included."""
    with Worker(WORKER_COMMAND, scratch / "worker.log", scratch, _PATIENCE) as worker:
        started = time.perf_counter()
        worker.start()
        up = time.perf_counter()
        worker.render(task, lambda progress: None)
        return up - started, time.perf_counter() - up


def _changes(scratch: Path, name: str, tasks: Sequence[FrameTask]) -> Iterator[Taken]:
    """Yield what a change of scene takes beyond the seconds of the frame, by whether the shader is compiled already."""
    known: set[object] = set()
    taken: dict[str, list[float]] = {"another program": [], "a known program": []}
    with Worker(WORKER_COMMAND, scratch / "worker.log", scratch, _PATIENCE) as worker:
        worker.start()
        for number, task in enumerate(tasks):
            programs = {each.program for each in task.scene.shaders if isinstance(each, ShaderSource)}
            started = time.perf_counter()
            worker.render(task, lambda progress: None)
            seconds = time.perf_counter() - started
            if number:
                taken["a known program" if programs <= known else "another program"].append(seconds)
            known |= programs
    for how, seconds_of in taken.items():
        if seconds_of:
            yield Taken(f"next scene of {name}, {how}, with {_SAMPLES} samples", tuple(seconds_of))


def _line(each: Taken) -> str:
    return f"{each.what}: {_spread(each.seconds)} s"


def _spread(seconds: Sequence[float]) -> str:
    middle = f"{statistics.median(seconds):.2f}"
    return middle if len(seconds) == 1 else f"{middle} ({min(seconds):.2f}..{max(seconds):.2f})"
