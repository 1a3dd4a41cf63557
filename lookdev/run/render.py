"""A plan becomes frames on disk: made by a worker that may fail, written whole, resumed where it stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lookdev.errors import LookdevError, OutputError
from lookdev.job import Job, JobOutputs, load_job
from lookdev.job.mapping import PathRules, mapped
from lookdev.output.exr import read_header
from lookdev.plan import Plan, Setup, Turns, build_plan
from lookdev.plan.chunks import Chunk
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.executors import Executor, Place
from lookdev.rendering.executors.choice import LOCAL, Choice, open_executor
from lookdev.rendering.task import SceneTask
from lookdev.rendering.worker import PATIENCE
from lookdev.run.chunks import forget_chunks, plan_of_chunk
from lookdev.run.events import Noted, Report, RunJoined
from lookdev.run.frame_file import store
from lookdev.run.frames import Frames, RunResult
from lookdev.run.ledger import Ledger
from lookdev.run.pictures import Background, Pictures
from lookdev.run.runs import Run
from lookdev.run.status import forget_failures, record_plan

if TYPE_CHECKING:
    from lookdev.plan.prepare import Prepared

Backdrop = str | tuple[float, float, float]

Prepare = Callable[[Job, Callable[[SceneTask], None] | None], "Prepared"]


def _plan_job(job: Job, ahead: Callable[[SceneTask], None] | None) -> Prepared:
    # Imported while Blender starts: what reads files takes as long to import as the rest of the program.
    from lookdev.plan.prepare import plan_job

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
    `lookdev.plan.prepare.plan_job` but in tests.
    Raises LookdevError where the input is wrong, another run renders something else there, or as `run_plan`.
    """
    job = load_mapped_job(path, rules, output, choice.device)
    backend = BACKENDS[job.render.backend]
    with (
        mapped_files(rules),
        _writing(job.output),
        Run(job.output, str(chunk or "")) as run,
        _opened(choice, run, backend.command) as executor,
    ):
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
            from lookdev.run.manifest import record_run  # not at the top: reading USD files takes long to import

            record_run(job, plan)
            if result.done == result.total and not run.others():
                forget_chunks(run.state)
                forget_failures(run.state)
                run.remove_logs()
        report(result.event)
        return result


@contextmanager
def mapped_files(rules: PathRules) -> Iterator[None]:
    """Let rules of paths count for what USD files name, too."""
    if not rules:
        yield
        return
    from lookdev.stage import map_asset_paths  # not at the top: reading USD files takes long to import

    with map_asset_paths(lambda asset: mapped(asset, rules)):
        yield


def load_mapped_job(path: Path, rules: PathRules = (), output: Path | None = None, device: str | None = None) -> Job:
    """Return a job as the options of a run want it: `output` and the kind of `device`, if any, instead of its own.

    Raises JobError, and LookdevError where its backend does not run on the device.
    """
    job = load_job(path, rules)
    if output is not None:
        job = job.model_copy(update={"output": output.absolute()})
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
def _writing(output: Path) -> Iterator[None]:
    """Let an OSError of a file in the output, or of none that it names, be an OutputError."""
    try:
        yield
    except BrokenPipeError:
        raise  # of the report: frames are not written to pipes
    except OSError as error:
        place = error.filename or output
        if not Path(str(place)).is_relative_to(output):
            raise
        raise OutputError(f"{place}: the output cannot be written: {error.strerror or error}") from error


@contextmanager
def _opened(choice: Choice, run: Run, command: Sequence[str], patience: float = PATIENCE) -> Iterator[Executor]:
    """Yield what renders for a run, with its logs and scratch in the state folder, and end it."""
    with (
        run.scratch() as scratch,
        open_executor(choice, Place(scratch, run.log, tuple(command), patience), store) as executor,
    ):
        yield executor


def render_setups(
    setups: Sequence[Setup],
    turns: Turns,
    outputs: JobOutputs,
    background: Backdrop = "black",
    *,
    report: Report = lambda event: None,
) -> tuple[Plan, RunResult]:
    """Render scenes made in memory: join the runs of the output, plan, run the plan; errors as `render_job`."""
    with Run(turns.output) as run:
        plan = build_plan(setups, turns, read_header, beside=outputs.beside)
        _join(run, plan, report)
        return plan, run_plan(plan, outputs, background, run=run, report=report)


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
    with _writing(plan.output), ExitStack() as stack:
        if run is None:
            run = stack.enter_context(Run(plan.output))
            _join(run, plan, report)
        ledger = stack.enter_context(_ledger(run))
        pictures = Pictures(plan, outputs, background, behind or background_light(background), ledger)
        frames = Frames(plan, pictures, run, report, force)
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
