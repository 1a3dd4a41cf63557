"""The executor for this machine: one worker, or several that render different frames at the same time.

A worker is a process. Each worker has a thread in this process, which tries a frame again if the worker dies. The
thread of the run assigns frames to these threads. If frames are short, a worker gets its next frame ahead of time, so
that it need not wait while a frame is written.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from lookdev.errors import WorkerError
from lookdev.rendering.executors.capacity import CpuUse, free_memory, idle_cores, is_worker_worthwhile
from lookdev.rendering.executors.frame_queue import FrameQueue
from lookdev.rendering.executors.protocol import (
    ExecutorEvent,
    Finished,
    FrameFilter,
    GivenUp,
    Progressed,
    Started,
    WorkerFiles,
)
from lookdev.rendering.executors.tries import render_with_retries
from lookdev.rendering.results import ProgressMessage, WorkerFrame
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.rendering.threads import share_of_cores
from lookdev.rendering.worker import Worker

_MEASURED_SECONDS = 4.0
"""Seconds over which idle cores are measured."""

_SHORT_FRAME = 5.0
"""A worker whose last frame took at most this many seconds gets its next frame ahead of time.

If longer frames were assigned ahead of time, other workers could be idle at the end of the run while such a frame still
waits for its worker.
"""


@dataclass(frozen=True)
class _ThreadError:
    """A report that the thread of a worker raised an error, which ends the run."""

    error: BaseException


class _WorkerThread:
    """A worker and its thread. The thread has the worker render assigned frames, and reports to a queue.

    All threads share the queue. An entry is a pair of a thread and its event or error.
    """

    def __init__(
        self, worker: Worker, reports: queue.Queue[tuple[_WorkerThread, ExecutorEvent | _ThreadError]]
    ) -> None:
        self.worker = worker
        self.assigned = 0  # number of assigned frames that are not finished
        self.seconds: float | None = None  # duration of its last frame
        self._inbox: queue.SimpleQueue[FrameTask | None] = queue.SimpleQueue()  # None ends the thread
        self._reports = reports
        self._thread: threading.Thread | None = None
        self._closing = False

    def assign(self, task: FrameTask) -> None:
        """Queue a frame: it is rendered after the frames that were assigned before."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._serve, daemon=True)
            self._thread.start()
        self.assigned += 1
        self._inbox.put(task)

    def close(self) -> None:
        """End the process and the thread, and drop the assigned frames."""
        self._closing = True
        self._inbox.put(None)
        # The thread may start the worker's process again, so the process is stopped repeatedly until the thread ends.
        while self._thread is not None and self._thread.is_alive():
            self.worker.stop()
            self._thread.join(0.05)
        self.worker.kill()

    def _serve(self) -> None:
        """Render the assigned frames, in the thread, until the thread is to end."""
        while (task := self._inbox.get()) is not None and not self._closing:
            try:
                self._render(task)
            except BaseException as error:  # noqa: BLE001  the thread of the run raises it
                self._report(_ThreadError(error))
                return

    def _render(self, task: FrameTask) -> None:
        """Render a frame, and report its events."""
        start = time.monotonic()
        self._report(Started(task))

        def on_progress(progress: ProgressMessage) -> None:
            self._report(Progressed(task, progress))

        result = render_with_retries(self.worker, task, on_progress, self._report, lambda: self._closing)
        seconds = time.monotonic() - start
        self._report(result if isinstance(result, GivenUp) else Finished(task, result, seconds))

    def _report(self, event: ExecutorEvent | _ThreadError) -> None:
        """Put an event into the shared queue, unless the thread is to end."""
        if not self._closing:
            self._reports.put((self, event))


class LocalExecutor:
    """Renders on workers of this machine.

    Parameters
    ----------
    files
        The files of logs, the scratch folder, and the command and timeout of workers.
    workers
        The number of workers. None starts one worker, and adds others while cores and memory are idle.
    devices
        Sets of environment variables, as `device_environments` returns them. Worker i takes set i modulo the number of
        sets.
    """

    def __init__(
        self, files: WorkerFiles, workers: int | None = 1, devices: Sequence[Mapping[str, str]] = ({},)
    ) -> None:
        self._files = files
        self._workers = workers
        self._devices = devices
        self._threads: list[_WorkerThread] = []
        self._use_before: CpuUse | None = None
        self._reports: queue.Queue[tuple[_WorkerThread, ExecutorEvent | _ThreadError]] = queue.Queue()

    def __enter__(self) -> LocalExecutor:
        self._threads.append(self._new_thread())
        return self

    def __exit__(self, *exception: object) -> None:
        for thread in self._threads:
            thread.close()

    def launch(self) -> None:
        """Start the first worker without waiting for it. If that fails, the first frame raises the error."""
        try:
            self._threads[0].worker.launch()
        except WorkerError:
            return

    def prepare(self, scene: SceneTask) -> None:
        """Send a scene to the first worker, which prepares it if it is still starting."""
        self._threads[0].worker.prepare(scene)

    def render(self, tasks: Sequence[FrameTask], is_needed: FrameFilter) -> Iterator[ExecutorEvent]:
        """Render tasks, as `Executor.render`."""
        frames = FrameQueue(tasks)
        self._use_before = None
        scene_of: dict[_WorkerThread, object] = {}
        while len(self._threads) < min(self._workers or 1, len(tasks)):
            self._threads.append(self._new_thread())
        for thread in self._threads:
            self._assign_frames(thread, frames, is_needed)
        while any(thread.assigned for thread in self._threads):
            thread, event = self._reports.get()
            match event:
                case _ThreadError(error):
                    raise error
                case Finished(task, rendered, seconds):
                    first = scene_of.get(thread) is not task.scene
                    scene_of[thread] = task.scene
                    frames.record_time(task, seconds, first=first)
                    thread.seconds = seconds
                    assert isinstance(rendered, WorkerFrame)  # workers of this machine do not write frames
                    if (
                        self._workers is None
                        and not first
                        and self._is_worker_worthwhile(frames, rendered.memory, seconds)
                    ):
                        self._threads.append(self._new_thread())
                        self._assign_frames(self._threads[-1], frames, is_needed)
            if isinstance(event, Finished | GivenUp):
                thread.assigned -= 1
                self._assign_frames(thread, frames, is_needed)
            yield event

    def _is_worker_worthwhile(self, frames: FrameQueue, memory: int, seconds: float) -> bool:
        """Return whether another worker gains more than it costs.

        This depends on the free memory, and on the cores that were idle since the last measurement. `memory` is the
        number of bytes that a worker takes, and `seconds` is the time that a frame takes.
        """
        now = CpuUse.of(pid for thread in self._threads if (pid := thread.worker.pid) is not None)
        before = self._use_before
        if before is None or now.clock < before.clock + _MEASURED_SECONDS:
            self._use_before = before or now
            return False
        self._use_before = now
        idle, count = idle_cores(before, now), len(self._threads)
        is_worth_it = is_worker_worthwhile(count, idle, len(frames) * seconds / count, memory, free_memory())
        self._use_before = None if is_worth_it else now  # after a new worker, the measurement starts anew
        return is_worth_it

    def _assign_frames(self, thread: _WorkerThread, frames: FrameQueue, is_needed: FrameFilter) -> None:
        """Assign frames to a worker until it has one, or two if its frames are short."""
        limit = 2 if thread.seconds is not None and thread.seconds < _SHORT_FRAME else 1
        while thread.assigned < limit and (task := frames.next_frame(thread)) is not None:
            if is_needed(task):
                thread.assign(task)
        if not thread.assigned:
            frames.remove_worker(thread)

    def _new_thread(self) -> _WorkerThread:
        """Return a further worker with its thread, its log, and its share of devices and cores."""
        number = len(self._threads)
        name = f"worker-{number + 1}" if number else "worker"
        # The number of cores does not change pixels: the samples of a pixel are summed up in their order.
        count = self._workers or 1
        cores = share_of_cores(number, count) if count > 1 else None
        files, variables = self._files, self._devices[number % len(self._devices)]
        worker = Worker(files.command, files.log(name), files.scratch, files.timeout, variables, cores)
        return _WorkerThread(worker, self._reports)
