"""Lets jobs and checks in tests render with the workers of the whole test run, in place of workers of their own.

The fixtures `cycles_worker` and `mitsuba_worker` are started once for all tests.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Self

import pytest

from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask
from lookdev.rendering.worker import Worker


class LentWorker:
    """A worker of the test run in the form that a job expects. The job cannot end it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        """Do not end the worker."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker

    def __getattr__(self, name: str) -> Any:
        return getattr(self._worker, name)

    def stop(self) -> None:
        """Do not end the worker."""

    kill = stop


def lend_workers(request: pytest.FixtureRequest, patch: pytest.MonkeyPatch) -> None:
    """Make `render_job`, `run_plan`, `check_file` and `live_frame` use the workers of the test run.

    A job with several workers still starts its own.
    """

    def worker_of(command: Sequence[str], *options: Any) -> Worker | LentWorker:
        """Replace the constructor of `Worker`, whose arguments these are."""
        if len(options) == 5 and options[-1] is not None:  # it has cores of its own, so it is one of several workers
            return Worker(command, *options)
        name = "cycles_worker" if command == BACKENDS["exact"].command else "mitsuba_worker"
        worker: Worker = request.getfixturevalue(name)
        worker.start()  # in this thread, because the worker's process ends with the thread that starts it
        return LentWorker(worker)

    @contextmanager
    def renderer() -> Iterator[Callable[[FrameTask], WorkerFrame]]:
        def render(task: FrameTask) -> WorkerFrame:
            return worker_of(BACKENDS[task.scene.backend].command).render(task, lambda progress: None)

        yield render

    patch.setattr("lookdev.rendering.executors.local.Worker", worker_of)
    patch.setattr("lookdev.fitting.picture.live_frame.Worker", worker_of)
    patch.setattr("lookdev.checks.check.open_renderer", renderer)
