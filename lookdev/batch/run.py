"""A plan becomes frames on disk: made by a worker that may fail, written whole, resumed where it stopped."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lookdev.batch.chunks import forget_chunks, plan_of_chunk
from lookdev.batch.events import (
    FrameDone,
    FrameFailed,
    FrameFound,
    FrameProgressed,
    FrameRetried,
    FrameStarted,
    Noted,
    Report,
    RunEnded,
    RunJoined,
    RunStarted,
    SheetWritten,
)
from lookdev.batch.frame_file import exposed, store
from lookdev.batch.ledger import Ledger
from lookdev.batch.pictures import Background, PictureFile, Pictures
from lookdev.batch.runs import Run
from lookdev.batch.status import forget_failures, record_failure, record_plan
from lookdev.cache import share
from lookdev.errors import LookdevError, OutputError, close_hint
from lookdev.job import Job, JobOutputs, load_job
from lookdev.job.mapping import PathRules
from lookdev.output.exr import read_frame, read_header
from lookdev.plan import Plan, Setup, Turns, build_plan
from lookdev.plan.chunks import Chunk
from lookdev.plan.plan import DAMAGED
from lookdev.render.backends import BACKENDS
from lookdev.render.executors import (
    Executor,
    Finished,
    GivenUp,
    Happening,
    Place,
    Progressed,
    Remarked,
    Retried,
    Started,
    Stored,
)
from lookdev.render.executors.choice import LOCAL, Choice, opened
from lookdev.render.task import FrameTask, SceneTask
from lookdev.render.worker import PATIENCE, Rendered

if TYPE_CHECKING:
    from lookdev.batch.prepare import Prepared

Backdrop = str | tuple[float, float, float]

_NAMED = 5  # frames in a message

_WAITS = (0.05, 2.0)  # seconds between looks at what other runs make, the first and the longest


@dataclass(frozen=True)
class Failure:
    """A failed frame, the reason of its last try, and the log with the details, if it is on this machine."""

    name: str
    reason: str
    log: Path | None


@dataclass(frozen=True)
class RunResult:
    """The result of a run: of `total` frames, `done` are on disk, `rendered` of them by this run.

    `missing` are the names of those that it was to find on disk, and did not.
    """

    total: int
    done: int
    rendered: int
    failures: tuple[Failure, ...]
    interrupted: bool
    missing: tuple[str, ...] = ()

    @property
    def exit_code(self) -> int:
        """0 when all is done, 1 when frames failed or are missing, 130 after Ctrl-C."""
        if self.interrupted:
            return 130
        return 1 if self.failures or self.missing else 0

    @property
    def event(self) -> RunEnded:
        """The result as an event."""
        failed, missing = len(self.failures), len(self.missing)
        return RunEnded(self.total, self.done, self.rendered, failed, missing, self.interrupted)

    def summary(self) -> str:
        """Return the result as text, with a line for each failed frame."""
        logged = [f" (log: {failure.log})" if failure.log else "" for failure in self.failures]
        lines = [f"{each.name}: {each.reason}{log}" for each, log in zip(self.failures, logged, strict=True)]
        if lines:
            lines.insert(0, f"{len(self.failures)} of {self.total} frames failed:")
        if self.missing:
            named = ", ".join(self.missing[:_NAMED]) + (", ..." if len(self.missing) > _NAMED else "")
            lines.append(f"{len(self.missing)} of {self.total} frames are not rendered yet: {named}")
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
    rules: PathRules = (),
    output: Path | None = None,
    force: bool = False,
    only: Sequence[str] = (),
    chunk: Chunk | None = None,
    outputs_only: bool = False,
    choice: Choice = LOCAL,
    report: Report = lambda event: None,
) -> RunResult:
    """Render a job file: join the runs of its output, prepare it, run its plan, write its manifest.

    `rules` are those of paths, `output` takes the place of the job's.
    A `chunk` of it has its share of the frames, and makes nothing of several frames, nor the manifest. `force`, `only`,
    `outputs_only` and `report` are as for `run_plan`; `choice` is of what renders; `prepare` is
    `lookdev.batch.prepare.plan_job` but in tests.
    Raises LookdevError where the input is wrong, another run renders something else there, or as `run_plan`.
    """
    job = _on_device(load_job(path, rules), choice.device)
    if output is not None:
        job = job.model_copy(update={"output": output.absolute()})
    backend = BACKENDS[job.render.backend]
    with Run(job.output, str(chunk or "")) as run, _opened(choice, run, backend.command) as executor:
        if not outputs_only and (force or _lacks_frames(job)):
            if choice.here:
                backend.check_device(job.render.device)
            # Blender starts while files are read.
            executor.launch()
        prepared = prepare(job, executor.prepare if backend.ahead else None)
        for note in prepared.notes:
            report(Noted(note))
        job, plan = prepared.job, prepared.plan
        _join(run, plan, report)
        record_plan(run, job.file, plan)
        if chunk is not None:
            plan = plan_of_chunk(plan, chunk)
        result = run_plan(
            plan,
            job.outputs,
            job.render.background,
            force=force,
            only=only,
            outputs_only=outputs_only,
            run=run,
            executor=executor,
            report=report,
        )
        if chunk is None:
            from lookdev.batch.manifest import record_run  # not at the top: reading USD files takes long to import

            record_run(job, plan)
            if result.done == result.total and not run.others():
                forget_chunks(run.state)
                forget_failures(run.state)
                run.remove_logs()
        report(result.event)
        return result


def _on_device(job: Job, device: str | None) -> Job:
    """Return a job rendered on another kind of device; raises LookdevError where its backend does not run there."""
    if device is None:
        return job
    backend = BACKENDS[job.render.backend]
    if device not in backend.devices:
        raise LookdevError(
            f"--device: backend '{backend.name}' of the job does not run on '{device}'; it runs on "
            f"{' or '.join(backend.devices)}"
        )
    return job.model_copy(update={"render": job.render.model_copy(update={"device": device})})


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


def _join(run: Run, plan: Plan, report: Report) -> None:
    """State what a run renders, and report who else does; raises OutputError where others render something else."""
    others = run.renders(plan.digest)
    report(RunJoined(run.info.id, run.info.part, plan.digest))
    # Of a job in chunks, others are expected.
    if same := [other for other in others if not run.info.part or other.part in ("", run.info.part)]:
        more = f" and {len(same) - 1} more" if len(same) > 1 else ""
        report(Noted(f"{same[0]}{more} also renders to {plan.output}: each frame is rendered by one of these runs"))


@contextmanager
def _opened(choice: Choice, run: Run, command: Sequence[str], patience: float = PATIENCE) -> Iterator[Executor]:
    """Yield what renders for a run, with its logs and scratch in the state folder, and end it."""
    with (
        run.scratch() as scratch,
        opened(choice, Place(scratch, run.log, tuple(command), patience), store) as executor,
    ):
        yield executor


def render_setups(
    setups: Sequence[Setup], turns: Turns, outputs: JobOutputs, *, report: Report = lambda event: None
) -> tuple[Plan, RunResult]:
    """Render scenes made in memory: join the runs of the output, plan, run the plan; errors as `render_job`."""
    with Run(turns.output) as run:
        plan = build_plan(setups, turns, read_header, beside=outputs.beside)
        _join(run, plan, report)
        return plan, run_plan(plan, outputs, run=run, report=report)


def run_plan(
    plan: Plan,
    outputs: JobOutputs,
    background: Backdrop = "black",
    *,
    force: bool = False,
    only: Sequence[str] = (),
    outputs_only: bool = False,
    behind: Background | None = None,
    run: Run | None = None,
    executor: Executor | None = None,
    worker_command: Sequence[str] | None = None,
    patience: float = PATIENCE,
    report: Report = lambda event: None,
) -> RunResult:
    """Render pending frames, and make the pictures and sheets that are missing or out of date.

    Other runs of the same plan may be at work: each frame is rendered by the one that claims it, and this one ends when
    all are done. Ctrl-C ends the run; finished frames are kept.

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
    outputs_only
        Render nothing; the result has the names of the frames that are missing.
    behind
        Returns the light behind each frame, instead of `background_light`.
    run
        The run among those of the output folder, which the caller has joined; None: a new one.
    executor
        What renders, in a context of the caller's; None: one worker here, as `worker_command`, by default that of the
        backend, and `patience` describe.
    report
        Is called with every event.

    Raises
    ------
    LookdevError
        The plan has no frame of a name in `only`.
    OutputError
        A file cannot be written.
    RenderError
        The device of the frames cannot be had here.
    WorkerError
        The worker does not start.
    """
    with ExitStack() as stack:
        if run is None:
            run = stack.enter_context(Run(plan.output))
            _join(run, plan, report)
        ledger = stack.enter_context(_ledger(run))
        pictures = Pictures(plan, outputs, background, behind or background_light(background), ledger)
        frames = _Frames(plan, pictures, run, report, force)
        try:
            tasks = frames.bring_up_to_date(only)
            if tasks and not outputs_only:
                if executor is None:
                    scene = tasks[0].scene
                    backend = BACKENDS[scene.backend]
                    if worker_command is None:
                        backend.check_device(scene.device)
                    command = worker_command or backend.command
                    executor = stack.enter_context(_opened(Choice(workers=1), run, command, patience))
                frames.render(tasks, executor)
            frames.wait_for_sheets()
        except KeyboardInterrupt:
            return frames.result(interrupted=True)
        except BrokenPipeError:
            raise  # of the report: frames are not written to pipes
        except OSError as error:
            place, why = error.filename or plan.output, error.strerror or error
            raise OutputError(f"{place}: the output cannot be written: {why}") from error
        return frames.result(missing=tasks if outputs_only else ())


@contextmanager
def _ledger(run: Run) -> Iterator[Ledger]:
    ledger = Ledger(run.state, run.info.id)
    try:
        yield ledger
    finally:
        with suppress(OSError):  # as on a full disk, which is reported where a frame is written; it is read again
            ledger.close([other.id for other in run.others()])


def background_light(background: Backdrop) -> Background:
    """Return the light behind each frame."""
    if background == "ibl":
        from lookdev.output.background import environment_background

        return environment_background
    color = np.zeros(3) if isinstance(background, str) else np.array(background)
    return lambda task: color


class _Frames:
    """The frames of a plan, as a run makes them."""

    def __init__(self, plan: Plan, pictures: Pictures, run: Run, report: Report, force: bool) -> None:
        self._root = plan.output
        self._plan = plan
        self._run = run
        self._report = report
        self._pictures = pictures
        self._props = set(plan.charts.values())
        self._force = force
        self._done: set[Path] = set()
        self._rendered = 0
        self._failures: list[Failure] = []
        self._with_others: list[PictureFile] = []

    def result(self, interrupted: bool = False, missing: Sequence[FrameTask] = ()) -> RunResult:
        done = sum(self._done.issuperset(frame.task.files) for frame in self._plan.frames)
        names = tuple(map(self._name, missing))
        return RunResult(len(self._plan.frames), done, self._rendered, tuple(self._failures), interrupted, names)

    def bring_up_to_date(self, only: Sequence[str]) -> list[FrameTask]:
        """Make copies, pictures and sheets that need no rendering; return the frames to render."""
        force = self._force
        tasks = [frame.task for frame in self._plan.frames]
        chosen = self._chosen(only) if only else {task.files for task in tasks}
        folders = {path.parent for task in tasks for path in task.files}
        # Overviews are in folders named by lights, beside those of the looks.
        self._run.remove_leftovers({self._run.state} | folders | {self._root / folder.name for folder in folders})
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
                self._pictures.refresh(task, self._done)
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
        self._refresh_sheets()
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
        chosen = {known[name] for name in names}
        tasks = {path: frame.task.files for frame in self._plan.frames for path in frame.task.files}
        return chosen | {tasks[self._plan.charts[f]] for files in chosen for f in files if f in self._plan.charts}

    def render(self, tasks: Sequence[FrameTask], executor: Executor) -> None:
        """Render frames, each claimed until it is done; only workers that never start end the batch.

        Scenes at which no other run works come first, then any frames that none has claimed, backwards; those that
        others have claimed are waited for.
        """
        left = self._rendered_apart(tasks, executor, apart=True)
        waits = _waits()
        while left:
            before = len(self._done)
            left = self._rendered_apart(left, executor, apart=False)
            waits = _waits() if len(self._done) > before else waits
            if left:
                time.sleep(next(waits))

    def _rendered_apart(self, tasks: Sequence[FrameTask], executor: Executor, *, apart: bool) -> list[FrameTask]:
        """Render frames but those that other runs have claimed, and, if `apart`, the rest of their scenes.

        These are returned, the last first.
        """
        claimed: list[FrameTask] = []
        scenes: set[int] = set()

        def wanted(task: FrameTask) -> bool:
            if (apart and id(task.scene) in scenes) or not self._run.claim(self._name(task)):
                claimed.append(task)
                scenes.add(id(task.scene))
                return False
            return not self._found(task)

        for happening in executor.render(tasks, wanted):
            self._take(happening)
        return claimed[::-1]

    def _found(self, task: FrameTask) -> bool:
        """Return whether another run has rendered a frame since it was planned; if so, take it and end its claim."""
        if self._force or not _has(task.files[0], task):
            return False
        for path in task.files[1:]:
            if not _has(path, task):
                share(task.files[0], path)
        self._pictures.refresh(task, self._done)
        self._settle(task)
        self._report(FrameFound(self._name(task), task.digest))
        self._refresh_sheets()
        return True

    def _take(self, what: Happening) -> None:
        if isinstance(what, Remarked):
            self._report(Noted(what.text))
            return
        task = what.task
        name, digest = self._name(task), task.digest
        match what:
            case Started():
                self._report(FrameStarted(name, digest))
            case Progressed(_, progress):
                self._report(FrameProgressed(name, progress.samples, progress.of, progress.relmse, digest))
            case Retried(_, reason, attempt, attempts):
                self._report(FrameRetried(name, reason, attempt, attempts, digest))
            case GivenUp(_, reason, log):
                self._run.release(name)
                self._failures.append(Failure(name, reason, log))
                record_failure(self._run, name, reason, log)
                self._report(FrameFailed(name, reason, digest))
            case Finished(_, rendered, seconds):
                self._finish(task, rendered, seconds)

    def _finish(self, task: FrameTask, rendered: Rendered | Stored, seconds: float) -> None:
        """Write a frame, unless its worker did, and what is made of it."""
        self._run.check()
        stored = rendered if isinstance(rendered, Stored) else store(task, rendered)
        for note in stored.notes:
            self._report(Noted(note))
        if isinstance(rendered, Stored):
            self._pictures.refresh(task, self._done)
        else:
            self._pictures.write(task, exposed(task, rendered), rendered.alpha, self._done)
        self._settle(task)
        self._rendered += 1
        self._report(FrameDone(self._name(task), seconds, stored.samples, stored.relmse, task.digest))
        self._refresh_sheets(task)

    def _settle(self, task: FrameTask) -> None:
        self._done.update(task.files)
        if task.files[0] in self._props:
            self._pictures.refresh_under(task, self._done)
        self._run.release(self._name(task))

    def _refresh_sheets(self, task: FrameTask | None = None) -> None:
        """Make what is out of date of several frames that are all done; with `task`, what shows that new frame."""
        for file in self._pictures.sheets(self._done, task):
            if task is None and not self._pictures.is_due(file):
                continue
            if not self._make_sheet(file, new=task is not None):
                self._with_others.append(file)

    def _make_sheet(self, file: PictureFile, *, new: bool = False) -> bool:
        """Make a file of several frames unless it is neither `new` nor due; return False where another run is at it."""
        name = file.paths[0].relative_to(self._root).as_posix()
        if not self._run.claim(name):
            return False
        try:
            if new or self._pictures.is_due(file):
                self._pictures.make(file)
                for path in file.paths:
                    self._report(SheetWritten(path))
        finally:
            self._run.release(name)
        return True

    def wait_for_sheets(self) -> None:
        """Wait until other runs have made what they are at, or make it."""
        for wait in _waits():
            self._with_others = [file for file in self._with_others if not self._make_sheet(file)]
            if not self._with_others:
                return
            time.sleep(wait)

    def _name(self, task: FrameTask) -> str:
        return task.files[0].relative_to(self._root).with_suffix("").as_posix()


def _waits() -> Iterator[float]:
    wait, longest = _WAITS
    while True:
        yield wait
        wait = min(2.0 * wait, longest)


def _has(file: Path, task: FrameTask) -> bool:
    """Return whether a file is whole and of a frame."""
    if not file.exists():
        return False
    try:
        return read_header(file).get("digest") == task.digest
    except OutputError:
        return False


def _is_whole(frame: Path) -> bool:
    try:
        read_frame(frame)
    except OutputError:
        return False
    return True
