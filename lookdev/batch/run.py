"""A plan becomes frames on disk: made by a worker that may fail, written whole, resumed where it stopped."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lookdev.batch.events import (
    FrameDone,
    FrameFailed,
    FrameProgressed,
    FrameRetried,
    FrameStarted,
    Noted,
    Report,
    RunStarted,
    SheetWritten,
)
from lookdev.batch.frame_file import write_rendered
from lookdev.batch.lock import SCRATCH_PREFIX, STATE_FOLDER, output_lock, remove_leftovers
from lookdev.batch.pictures import Background, Pictures
from lookdev.batch.sanity import doubts
from lookdev.cache import share
from lookdev.errors import LookdevError, OutputError, RenderError, WorkerError, close_hint
from lookdev.job import Job, JobOutputs, load_job
from lookdev.output.exr import read_frame, read_header
from lookdev.plan import Plan, Setup, Turns, build_plan
from lookdev.plan.plan import DAMAGED
from lookdev.render.backends import BACKENDS
from lookdev.render.task import FrameTask, SceneTask
from lookdev.render.worker import PATIENCE, Progress, Rendered, Worker, last_line

if TYPE_CHECKING:
    from lookdev.batch.prepare import Prepared

Backdrop = str | tuple[float, float, float]

CRASH_TRIES = 3
"""Tries of a frame whose worker dies, hangs or sends no valid answer: the frame before may be the cause."""

CLEAN_TRIES = 2
"""Tries of a frame that the worker reports as failed: most such errors recur."""


@dataclass(frozen=True)
class Failure:
    """A failed frame, the reason of its last try, and the log with the details."""

    name: str
    reason: str
    log: Path


@dataclass(frozen=True)
class RunResult:
    """The result of a run: of `total` frames, `done` are on disk, `rendered` of them by this run."""

    total: int
    done: int
    rendered: int
    failures: tuple[Failure, ...]
    interrupted: bool

    @property
    def exit_code(self) -> int:
        """0 when all is done, 1 when frames failed, 130 after Ctrl-C."""
        if self.interrupted:
            return 130
        return 1 if self.failures else 0

    def summary(self) -> str:
        """Return the result as text, with a line for each failed frame."""
        lines = [f"{failure.name}: {failure.reason} (log: {failure.log})" for failure in self.failures]
        if lines:
            lines.insert(0, f"{len(self.failures)} of {self.total} frames failed:")
        lines.append(f"{self.done} of {self.total} frames are done, {self.rendered} of them rendered now.")
        if self.interrupted:
            lines.append("Interrupted; run the same command again to continue.")
        return "\n".join(lines)


Prepare = Callable[[Job, Callable[[SceneTask], None] | None], "Prepared"]


def _plan_job(job: Job, ahead: Callable[[SceneTask], None] | None) -> Prepared:
    # Imported while Blender starts: what reads files takes as long to import as the rest of the program.
    from lookdev.batch.prepare import plan_job

    return plan_job(job, ahead)


def render_job(
    path: Path,
    *,
    prepare: Prepare = _plan_job,
    force: bool = False,
    only: Sequence[str] = (),
    report: Report = lambda event: None,
) -> RunResult:
    """Render a job file: lock its output, prepare it, run its plan, write its manifest.

    `force`, `only` and `report` are as for `run_plan`.

    `prepare`, `lookdev.batch.prepare.plan_job` but in tests, is called under the lock, so that no other run changes the
    frames that it plans. Raises LookdevError where the input is wrong, another run holds the lock, or as `run_plan`.
    """
    job = load_job(path)
    backend = BACKENDS[job.render.backend]
    with output_lock(job.output) as folder, _opened(folder, backend.command) as worker:
        if force or _lacks_frames(job):
            backend.check_device(job.render.device)
            # Blender starts while files are read; an error is that of the first frame, then.
            with suppress(WorkerError):
                worker.launch()
        prepared = prepare(job, worker.prepare if backend.ahead else None)
        for note in prepared.notes:
            report(Noted(note))
        job = prepared.job
        result = run_plan(
            prepared.plan, job.outputs, job.render.background, force=force, only=only, worker=worker, report=report
        )
        from lookdev.batch.manifest import record_run  # not at the top: reading USD files takes long to import

        record_run(job, prepared.plan)
        return result


def _lacks_frames(job: Job) -> bool:
    """Return whether files of a job's frames are missing, as far as their names are known before its files are read."""
    turns = Turns(job.turntable, job.output)
    for look in job.look:
        names = [look.name]
        if "*" in look.variants.values():
            names = [folder.name for folder in job.output.glob(f"{look.name}_*")]
        frames = [
            file
            for name in names
            for rig in job.rigs
            for each in turns.turntables
            for file in turns.files(name, rig.name, each)
        ]
        if not frames or not all(file.exists() for file in frames):
            return True
    return False


@contextmanager
def _opened(folder: Path, command: Sequence[str], patience: float = PATIENCE) -> Iterator[Worker]:
    """Yield a worker with its log and scratch in a state folder, and end it."""
    with (
        tempfile.TemporaryDirectory(prefix=SCRATCH_PREFIX, dir=folder) as scratch,
        Worker(command, folder / "worker.log", Path(scratch), patience) as worker,
    ):
        yield worker


def render_setups(
    setups: Sequence[Setup], turns: Turns, outputs: JobOutputs, *, report: Report = lambda event: None
) -> tuple[Plan, RunResult]:
    """Render scenes made in memory: lock the output, plan, run the plan; errors as `render_job`."""
    with output_lock(turns.output):
        plan = build_plan(setups, turns, read_header, beside=outputs.beside)
        return plan, run_plan(plan, outputs, report=report)


def run_plan(
    plan: Plan,
    outputs: JobOutputs,
    background: Backdrop = "black",
    *,
    force: bool = False,
    only: Sequence[str] = (),
    behind: Background | None = None,
    worker: Worker | None = None,
    worker_command: Sequence[str] | None = None,
    patience: float = PATIENCE,
    report: Report = lambda event: None,
) -> RunResult:
    """Render pending frames, and make the pictures and sheets that are missing or out of date.

    The caller holds the output's lock, and has made `plan` under it. Ctrl-C ends the run; finished frames are kept.

    Parameters
    ----------
    plan, outputs
        The frames; which pictures and sheets are made, in which view.
    background
        Behind the asset in pictures: ``"black"``, ``"ibl"`` (the light itself), or a linear colour.
    force
        Render every frame, done or not.
    only
        Render no frames but these, each by the path of one of its files in the output, as "gold/city/element.0001".
    behind
        Returns the light behind each frame, instead of `background_light`.
    worker
        The render worker, which the caller ends; None: one that `worker_command`, by default the backend's, and
        `patience` describe.
    report
        Is called with every event.

    Raises
    ------
    LookdevError
        The plan has no frame of a name in `only`.
    OutputError
        A file cannot be written.
    WorkerError
        The worker does not start.
    """
    pictures = Pictures(plan, outputs, background, behind or background_light(background))
    run = _Run(plan, pictures, report)
    try:
        run.render(run.bring_up_to_date(force, only), worker, worker_command, patience)
    except KeyboardInterrupt:
        return run.result(interrupted=True)
    except BrokenPipeError:
        raise  # of the report: frames are not written to pipes
    except OSError as error:
        place, why = error.filename or plan.output, error.strerror or error
        raise OutputError(f"{place}: the output cannot be written: {why}") from error
    return run.result(interrupted=False)


def background_light(background: Backdrop) -> Background:
    """Return the light behind each frame."""
    if background == "ibl":
        from lookdev.output.background import environment_background

        return environment_background
    color = np.zeros(3) if isinstance(background, str) else np.array(background)
    return lambda task: color


class _Run:
    def __init__(self, plan: Plan, pictures: Pictures, report: Report) -> None:
        self._root = plan.output
        self._plan = plan
        self._folder = plan.output / STATE_FOLDER
        self._folder.mkdir(parents=True, exist_ok=True)
        self._report = report
        self._pictures = pictures
        self._done: set[Path] = set()
        self._rendered = 0
        self._failures: list[Failure] = []

    def result(self, interrupted: bool) -> RunResult:
        done = sum(self._done.issuperset(frame.task.files) for frame in self._plan.frames)
        return RunResult(len(self._plan.frames), done, self._rendered, tuple(self._failures), interrupted)

    def bring_up_to_date(self, force: bool, only: Sequence[str]) -> list[FrameTask]:
        """Make copies, pictures and sheets that need no rendering; return the frames to render."""
        tasks = [frame.task for frame in self._plan.frames]
        chosen = self._chosen(only) if only else {task.files for task in tasks}
        folders = {path.parent for task in tasks for path in task.files}
        # Overviews are in folders named by lights, beside those of the looks.
        remove_leftovers({self._folder} | folders | {self._root / folder.name for folder in folders})
        # By file: equal looks have one digest.
        waiting = {task.files for task in self._plan.pending()} | (chosen if force else set())
        pending = [task for task in tasks if task.files in waiting & chosen]
        files = () if force else (each for frame in self._plan.frames for each in frame.files)
        damaged = [each.path for each in files if each.reason == DAMAGED]
        for copy in () if force else self._plan.copies():
            share(copy.source, copy.target)
        for task in tasks:
            if task.files in waiting:
                continue
            try:
                self._pictures.refresh(task)
            except OutputError:
                if _is_whole(task.files[0]):
                    raise
                # Of a version without checksums: its header is valid, its pixels are not.
                damaged.append(task.files[0])
                pending += [task] if task.files in chosen else []
            else:
                self._done.update(task.files)
        for path in damaged:
            self._report(Noted(f"{path}: was damaged, and is made again"))
        self._report_sheets(self._pictures.refresh_sheets(self._done))
        self._report(RunStarted(len(tasks), len(pending)))
        return pending

    def _chosen(self, names: Sequence[str]) -> set[tuple[Path, ...]]:
        """Return the files of the frames that names stand for."""
        known = {
            path.relative_to(self._root).with_suffix("").as_posix(): frame.task.files
            for frame in self._plan.frames
            for path in frame.task.files
        }
        for name in names:
            if name not in known:
                raise LookdevError(f"the job has no frame '{name}' ({close_hint(name, list(known)) or 'see its plan'})")
        return {known[name] for name in names}

    def render(
        self, tasks: Sequence[FrameTask], worker: Worker | None, command: Sequence[str] | None, patience: float
    ) -> None:
        """Render frames; only a worker that never starts ends the batch."""
        if not tasks:
            return
        with ExitStack() as stack:
            if worker is None:
                command = command or BACKENDS[tasks[0].scene.backend].command
                worker = stack.enter_context(_opened(self._folder, command, patience))
            for task in tasks:
                started = time.monotonic()
                self._report(FrameStarted(self._name(task)))
                if (rendered := self._rendered_in_tries(worker, task)) is None:
                    continue
                for note in rendered.notes:
                    self._report(Noted(note))
                self._write(task, rendered)
                seconds = time.monotonic() - started
                self._report(FrameDone(self._name(task), seconds, rendered.samples, rendered.relmse))
                self._report_sheets(self._pictures.refresh_sheets(self._done, task))

    def _rendered_in_tries(self, worker: Worker, task: FrameTask) -> Rendered | None:
        name = self._name(task)

        def report(progress: Progress) -> None:
            self._report(FrameProgressed(name, progress.samples, progress.of, progress.relmse))

        attempt = 1
        while True:
            _start(worker)
            try:
                return worker.render(task, report)
            except (WorkerError, RenderError) as error:
                tries = CRASH_TRIES if isinstance(error, WorkerError) else CLEAN_TRIES
                attempt += 1
                if attempt > tries:
                    self._failures.append(Failure(name, str(error), self._folder / "worker.log"))
                    self._report(FrameFailed(name, str(error)))
                    return None
                self._report(FrameRetried(name, str(error), attempt, tries))

    def _write(self, task: FrameTask, rendered: Rendered) -> None:
        with np.errstate(over="ignore"):
            beauty = (rendered.a + rendered.b) * np.float32(0.5 * 2.0**task.exposure)
        constant = all(light.constant for light in task.scene.lights)
        for doubt in doubts(rendered, beauty, constant_light=constant):
            self._report(Noted(f"{self._name(task)}: {doubt}"))
        write_rendered(task, rendered, beauty)
        self._pictures.write(task, beauty, rendered.alpha)
        self._done.update(task.files)
        self._rendered += 1

    def _report_sheets(self, paths: Sequence[Path]) -> None:
        for path in paths:
            self._report(SheetWritten(path))

    def _name(self, task: FrameTask) -> str:
        return task.files[0].relative_to(self._root).with_suffix("").as_posix()


def _is_whole(frame: Path) -> bool:
    try:
        read_frame(frame)
    except OutputError:
        return False
    return True


def _start(worker: Worker) -> None:
    """Start the worker, with `CRASH_TRIES` tries."""
    for attempt in range(CRASH_TRIES):
        try:
            worker.start()
        except WorkerError as error:
            if attempt == CRASH_TRIES - 1:
                line = last_line(worker.log)
                logged = f"; its last line: {line}" if line and line not in str(error) else ""
                raise WorkerError(
                    f"{error}{logged}; it did so {CRASH_TRIES} times before any frame (log: {worker.log}). "
                    "'lookdev doctor' lists what this machine lacks"
                ) from error
        else:
            return
