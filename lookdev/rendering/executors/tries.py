"""A frame on a worker, in several tries."""

from __future__ import annotations

from collections.abc import Callable

from lookdev.errors import RenderError, WorkerError
from lookdev.rendering.executors.protocol import CLEAN_TRIES, CRASH_TRIES, GivenUp, Retried
from lookdev.rendering.results import Progress, Rendered
from lookdev.rendering.task import FrameTask
from lookdev.rendering.worker import Worker, last_line


def render_with_retries(
    worker: Worker,
    task: FrameTask,
    progressed: Callable[[Progress], None],
    retried: Callable[[Retried], None],
    ended: Callable[[], bool] = lambda: False,
) -> Rendered | GivenUp:
    """Render a frame, with further tries where its worker dies or fails, unless `ended` says that the run has ended.

    Raises WorkerError where the worker does not start, OutputError where it cannot write.
    """
    attempt = 1
    while True:
        start(worker)
        try:
            return worker.render(task, progressed)
        except (WorkerError, RenderError) as error:
            tries = CRASH_TRIES if isinstance(error, WorkerError) else CLEAN_TRIES
            attempt += 1
            if attempt > tries or ended():
                return GivenUp(task, str(error), worker.log)
            retried(Retried(task, str(error), attempt, tries))


def start(worker: Worker) -> None:
    """Start a worker, with `CRASH_TRIES` tries; raises WorkerError."""
    for attempt in range(CRASH_TRIES):
        try:
            worker.start()
        except WorkerError as error:
            if attempt == CRASH_TRIES - 1:
                line = last_line(worker.log)
                log_note = f"; its last line: {line}" if line and line not in str(error) else ""
                raise WorkerError(
                    f"{error}{log_note}; it did so {CRASH_TRIES} times before any frame (log: {worker.log}). "
                    "'lookdev doctor' lists what this machine lacks"
                ) from error
        else:
            return
