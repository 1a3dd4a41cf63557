"""Renders a frame on a worker, with several tries. All executors use it."""

from __future__ import annotations

from collections.abc import Callable

from lookdev.errors import RenderError, WorkerError
from lookdev.rendering.executors.protocol import CLEAN_TRIES, CRASH_TRIES, GivenUp, Retried
from lookdev.rendering.results import ProgressMessage, WorkerFrame
from lookdev.rendering.task import FrameTask
from lookdev.rendering.worker import Worker, last_line


def render_with_retries(
    worker: Worker,
    task: FrameTask,
    on_progress: Callable[[ProgressMessage], None],
    on_retry: Callable[[Retried], None],
    is_ended: Callable[[], bool] = lambda: False,
) -> WorkerFrame | GivenUp:
    """Render a frame, and try again if its worker dies or fails.

    After the last try, or once `is_ended` returns that the run has ended, the result of a failed try is a `GivenUp`.
    Raises WorkerError where the worker does not start, and OutputError where the worker cannot write.
    """
    attempt = 1
    while True:
        start_worker(worker)
        try:
            return worker.render(task, on_progress)
        except (WorkerError, RenderError) as error:
            tries = CRASH_TRIES if isinstance(error, WorkerError) else CLEAN_TRIES
            attempt += 1
            if attempt > tries or is_ended():
                return GivenUp(task, str(error), worker.log)
            on_retry(Retried(task, str(error), attempt, tries))


def start_worker(worker: Worker) -> None:
    """Start a worker, with at most `CRASH_TRIES` tries; raises WorkerError where all fail."""
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
