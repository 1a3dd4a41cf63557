"""Jobs and checks rendered by the warm workers of the run, in place of workers of their own."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Self

import pytest

from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask
from lookdev.rendering.worker import Worker


class LentWorker:
    """A worker of the run as a job has one, which does not end it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        """Leave it to the run."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker

    def __getattr__(self, name: str) -> Any:
        return getattr(self._worker, name)

    def stop(self) -> None:
        """Leave it to the run."""

    kill = stop


def lend_workers(request: pytest.FixtureRequest, patch: pytest.MonkeyPatch) -> None:
    """Let `render_job`, `run_plan` and `check_file` render in the warm workers, where a job has one worker."""

    def worker_of(command: Sequence[str], *options: Any) -> Worker | LentWorker:
        if len(options) == 5 and options[-1] is not None:  # cores of its own, as one of several has
            return Worker(command, *options)
        name = "cycles_worker" if command == BACKENDS["exact"].command else "mitsuba_worker"
        worker: Worker = request.getfixturevalue(name)
        worker.start()  # in this thread: the process ends with the one that starts it
        return LentWorker(worker)

    @contextmanager
    def renderer() -> Iterator[Callable[[FrameTask], WorkerFrame]]:
        def render(task: FrameTask) -> WorkerFrame:
            return worker_of(BACKENDS[task.scene.backend].command).render(task, lambda progress: None)

        yield render

    patch.setattr("lookdev.rendering.executors.local.Worker", worker_of)
    patch.setattr("lookdev.fitting.picture.live_frame.Worker", worker_of)
    patch.setattr("lookdev.checks.check.open_renderer", renderer)
