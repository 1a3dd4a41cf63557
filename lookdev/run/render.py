"""Renders a job or a plan to frames on disk: the entry points of a run.

The command line calls `render_job`; programs that have scenes in memory call `render_setups`. Workers may fail, files
are written completely or not at all, and an interrupted run can be continued.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lookdev.errors import LookdevError, OutputError
from lookdev.job import Job, JobOutputs, load_job
from lookdev.job.mapping import PathRules, map_path
from lookdev.output.exr import read_header
from lookdev.plan import Plan, Setup, TurntableFrames, build_plan
from lookdev.plan.chunks import Chunk
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.executors.choice import LOCAL_OPTIONS, ExecutorOptions, open_executor
from lookdev.rendering.executors.protocol import Executor, WorkerFiles
from lookdev.rendering.task import SceneTask
from lookdev.rendering.worker import ANSWER_TIMEOUT
from lookdev.run.chunks import plan_of_chunk, remove_chunk_divisions
from lookdev.run.events import Noted, ReportEvent, RunJoined
from lookdev.run.frame_file import store_frame
from lookdev.run.frames import RunFrames, RunResult
from lookdev.run.ledger import Ledger
from lookdev.run.pictures import PictureWriter, RenderBackground
from lookdev.run.runs import Run
from lookdev.run.status import record_plan, remove_failures

if TYPE_CHECKING:
    from lookdev.plan.prepare import PlannedJob

Backdrop = str | tuple[float, float, float]
"""The background of pictures: ``"black"``, ``"ibl"`` (the light itself), or a linear colour."""

PrepareJob = Callable[[Job, Callable[[SceneTask], None] | None], "PlannedJob"]
"""Reads the files of a job and plans its frames.

The second argument is a function, or None. The function is called early, with a scene that a worker can prepare."""


def _plan_job(job: Job, ahead: Callable[[SceneTask], None] | None) -> PlannedJob:
    """Plan a job by `lookdev.plan.prepare.plan_job`."""
    # This is not imported at the top, because its readers of files take as long to import as the rest of the program.
    # Here, Blender starts at the same time.
    from lookdev.plan.prepare import plan_job

    return plan_job(job, ahead)


def render_job(
    path: Path,
    *,
    prepare: PrepareJob = _plan_job,
    rules: PathRules = (),
    output: Path | None = None,
    force: bool = False,
    only: Sequence[str] = (),
    chunk: Chunk | None = None,
    outputs_only: bool = False,
    executor_options: ExecutorOptions = LOCAL_OPTIONS,
    report: ReportEvent = lambda event: None,
) -> RunResult:
    """Render a job file: join the runs of its output folder, plan its frames, render them, write the manifest.

    Parameters
    ----------
    path
        The job file.
    prepare
        The function that plans the frames: `lookdev.plan.prepare.plan_job`, except in tests.
    rules
        The path rules. They replace beginnings of paths, for example of paths on another machine.
    output
        The output folder, instead of the job's.
    chunk
        The chunk to render; None renders all frames. For a chunk, the run writes neither the manifest nor the files
        that are made from several frames, such as contact sheets and movies.
    force, only, outputs_only, report
        As for `run_plan`.
    executor_options
        The choice of the executor that renders.

    Raises
    ------
    LookdevError
        The input is wrong, or another run renders something else to the output.
    OutputError, RenderError, WorkerError
        As `run_plan`.
    """
    job = load_mapped_job(path, rules, output, executor_options.device)
    backend = BACKENDS[job.render.backend]
    with (
        mapped_files(rules),
        _output_errors(job.output),
        Run(job.output, str(chunk or "")) as run,
        _open_executor(executor_options, run, backend.command) as executor,
    ):
        if not outputs_only and (force or _lacks_frames(job)):
            if executor_options.is_local:
                backend.check_device(job.render.device)
            # Blender starts while this process reads the files of the job.
            executor.launch()
        prepared = prepare(job, executor.prepare if backend.can_prepare else None)
        for note in prepared.notes:
            report(Noted(note))
        job, plan = prepared.job, prepared.plan
        _join_runs(run, plan, report)
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
            from lookdev.run.manifest import record_run  # not at the top: the readers of USD files take long to import

            record_run(job, plan)
            if result.done == result.total and not run.others():
                remove_chunk_divisions(run.state)
                remove_failures(run.state)
                run.remove_logs()
        report(result.event)
        return result


def mapped_files(rules: PathRules) -> AbstractContextManager[None]:
    """Return a context in which path rules are applied to the asset paths in USD files."""
    if not rules:
        return nullcontext()
    from lookdev.stage import map_asset_paths  # not at the top: the readers of USD files take long to import

    return map_asset_paths(lambda asset: map_path(asset, rules))


def load_mapped_job(path: Path, rules: PathRules = (), output: Path | None = None, device: str | None = None) -> Job:
    """Load a job. `output` and `device`, a kind of device, replace the values of the job if they are not None.

    Raises JobError, and LookdevError where the backend of the job does not run on the device.
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
    """Return whether frames of a job are missing, as far as their names follow from the job file alone.

    A look whose variant is ``"*"`` becomes several looks, whose names are known only from USD files. Such a look counts
    as complete if the frames of all its folders in the output exist.
    """
    turns = TurntableFrames(job.turntable, job.output)
    for look in job.look:
        wild = "*" in look.variants.values()
        names = [folder.name for folder in job.output.glob(f"{look.name}_*")] if wild else [look.name]
        # The names of a look, a rig and a turntable determine the files of a sequence of frames.
        name_triples = list(product(names, (rig.name for rig in job.rigs), turns.turntables))
        if not name_triples or not all(file.exists() for triple in name_triples for file in turns.files(*triple)):
            return True
    return False


def _join_runs(run: Run, plan: Plan, report: ReportEvent) -> None:
    """Announce the plan of a run to other runs, and report the runs that render the same plan.

    Raises OutputError where another run renders another plan to the output.
    """
    others = run.announce_plan(plan.digest)
    report(RunJoined(run.info.id, run.info.part, plan.digest))
    # Runs that render other chunks are not reported, because they are expected.
    if same := [other for other in others if not run.info.part or other.part in ("", run.info.part)]:
        more = f" and {len(same) - 1} more" if len(same) > 1 else ""
        report(Noted(f"{same[0]}{more} also renders to {plan.output}: each frame is rendered by one of these runs"))


@contextmanager
def _output_errors(output: Path) -> Iterator[None]:
    """Turn an OSError in the block into an OutputError if it names a file in the output, or no file."""
    try:
        yield
    except BrokenPipeError:
        raise  # the report raises it: only the report writes to a pipe
    except OSError as error:
        path = error.filename or output
        if not Path(str(path)).is_relative_to(output):
            raise
        raise OutputError(f"{path}: the output cannot be written: {error.strerror or error}") from error


@contextmanager
def _open_executor(
    executor_options: ExecutorOptions, run: Run, command: Sequence[str], timeout: float = ANSWER_TIMEOUT
) -> Iterator[Executor]:
    """Yield an executor for a run, with its logs and temporary files in the state folder, and close it."""
    with (
        run.scratch_folder() as scratch,
        open_executor(
            executor_options, WorkerFiles(scratch, run.log_file, tuple(command), timeout), store_frame
        ) as executor,
    ):
        yield executor


def render_setups(
    setups: Sequence[Setup],
    turns: TurntableFrames,
    outputs: JobOutputs,
    background: Backdrop = "black",
    *,
    report: ReportEvent = lambda event: None,
) -> tuple[Plan, RunResult]:
    """Render scenes that are in memory: join the runs of the output, plan the frames, render them.

    setups : the scenes; turns : the turntables and the output folder; outputs : the files to make of the frames. Raises
    the errors of `render_job`.
    """
    with Run(turns.output) as run:
        plan = build_plan(setups, turns, read_header, frame_suffixes=outputs.frame_suffixes)
        _join_runs(run, plan, report)
        return plan, run_plan(plan, outputs, background, run=run, report=report)


def run_plan(
    plan: Plan,
    outputs: JobOutputs,
    background: Backdrop = "black",
    *,
    force: bool = False,
    only: Sequence[str] = (),
    outputs_only: bool = False,
    render_background: RenderBackground | None = None,
    run: Run | None = None,
    executor: Executor | None = None,
    worker_command: Sequence[str] | None = None,
    timeout: float = ANSWER_TIMEOUT,
    report: ReportEvent = lambda event: None,
) -> RunResult:
    """Render the frames of a plan that are not done, and make the pictures and sheets that are missing or outdated.

    A picture shows one frame, a sheet several. Other runs of the same plan may render at the same time: each frame is
    rendered by the run that claims it, and this run ends when all frames are done. Ctrl-C ends the run; finished frames
    remain.

    Parameters
    ----------
    plan
        The frames.
    outputs
        The kinds of pictures and sheets to make of the frames, and the OpenColorIO views for these.
    background
        The background of pictures: ``"black"``, ``"ibl"`` (the light itself), or a linear colour.
    force
        Render every frame, even if it is done.
    only
        Render only these frames. The name of a frame is the path of one of its files, as "gold/city/element.0001".
    outputs_only
        Render nothing, but make pictures and sheets. The result has the names of the missing frames.
    render_background
        A function that returns the light behind a frame. None takes the function that `background_light` returns.
    run
        A run that the caller has entered. None starts a new run.
    executor
        The executor that renders, which the caller closes. None opens one worker on this machine.
    worker_command, timeout
        If `executor` is None: the command of the worker, by default the backend's command, and the seconds without an
        answer after which the worker counts as hung.
    report
        A function that is called with every event.

    Raises
    ------
    LookdevError
        A name in `only` is not the name of a frame of the plan.
    OutputError
        A file cannot be written.
    RenderError
        This machine does not have the device of the frames.
    WorkerError
        The worker does not start.
    """
    with _output_errors(plan.output), ExitStack() as stack:
        if run is None:
            run = stack.enter_context(Run(plan.output))
            _join_runs(run, plan, report)
        ledger = stack.enter_context(_open_ledger(run))
        pictures = PictureWriter(plan, outputs, background, render_background or background_light(background), ledger)
        frames = RunFrames(plan, pictures, run, report, force)
        try:
            tasks = frames.update_files(only)
            if tasks and not outputs_only:
                if executor is None:
                    scene = tasks[0].scene
                    backend = BACKENDS[scene.backend]
                    if worker_command is None:
                        backend.check_device(scene.device)
                    command = worker_command or backend.command
                    executor = stack.enter_context(_open_executor(ExecutorOptions(workers=1), run, command, timeout))
                frames.render(tasks, executor)
            frames.wait_for_sheets()
        except KeyboardInterrupt:
            return frames.result(interrupted=True)
        return frames.result(missing=tasks if outputs_only else ())


@contextmanager
def _open_ledger(run: Run) -> Iterator[Ledger]:
    """Yield the ledger of a run's output folder, and close it."""
    ledger = Ledger(run.state, run.info.id)
    try:
        yield ledger
    finally:
        # The next run merges the files of the ledger if this fails. The error, such as a full disk, is reported where a
        # frame is written.
        with suppress(OSError):
            ledger.close([other.id for other in run.others()])


def background_light(background: Backdrop) -> RenderBackground:
    """Return a function that takes the task of a frame and returns the light behind the asset in that frame."""
    if background == "ibl":
        from lookdev.output.background import environment_background

        return environment_background
    color = np.zeros(3) if isinstance(background, str) else np.array(background)
    return lambda task: color
