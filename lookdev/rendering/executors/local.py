"""Workers on this machine: one, or several that render different frames at the same time.

Each worker has a thread, which tries a frame again where the process dies. The thread of the run assigns frames; short
ones are assigned one ahead, so that no worker waits until a frame is written.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from lookdev.errors import WorkerError
from lookdev.rendering.executors.capacity import Use, free_memory, idle_cores, is_worth_another
from lookdev.rendering.executors.protocol import (
    Finished,
    FrameFilter,
    GivenUp,
    Happening,
    Progressed,
    Started,
    WorkerFiles,
)
from lookdev.rendering.executors.shares import Shares
from lookdev.rendering.executors.tries import render_with_retries
from lookdev.rendering.results import Progress, Rendered
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.rendering.threads import share_of_cores
from lookdev.rendering.worker import Worker

_MEASURED_SECONDS = 4.0
"""Seconds over which the idle cores are measured."""

_SHORT_FRAME = 5.0
"""Seconds of a frame up to which a worker gets one ahead; of longer ones, others would wait for it at the end."""


@dataclass(frozen=True)
class _Ended:
    """The thread of a worker raised an error that ends the run."""

    error: BaseException


class _Slot:
    """A worker and its thread, which renders the assigned frames and reports to a queue that all slots share."""

    def __init__(self, worker: Worker, reports: queue.Queue[tuple[_Slot, Happening | _Ended]]) -> None:
        self.worker = worker
        self.assigned = 0  # frames that are not finished
        self.seconds: float | None = None  # of its last frame
        self._inbox: queue.SimpleQueue[FrameTask | None] = queue.SimpleQueue()
        self._reports = reports
        self._thread: threading.Thread | None = None
        self._closing = False

    def assign(self, task: FrameTask) -> None:
        """Render a frame, after those assigned before."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._serve, daemon=True)
            self._thread.start()
        self.assigned += 1
        self._inbox.put(task)

    def close(self) -> None:
        """End the process and the thread, and drop the assigned frames."""
        self._closing = True
        self._inbox.put(None)
        # The thread may be starting another process just then.
        while self._thread is not None and self._thread.is_alive():
            self.worker.stop()
            self._thread.join(0.05)
        self.worker.kill()

    def _serve(self) -> None:
        while (task := self._inbox.get()) is not None and not self._closing:
            try:
                self._render(task)
            except BaseException as error:  # noqa: BLE001  the thread of the run raises it
                self._report(_Ended(error))
                return

    def _render(self, task: FrameTask) -> None:
        start = time.monotonic()
        self._report(Started(task))

        def on_progress(progress: Progress) -> None:
            self._report(Progressed(task, progress))

        result = render_with_retries(self.worker, task, on_progress, self._report, lambda: self._closing)
        seconds = time.monotonic() - start
        self._report(result if isinstance(result, GivenUp) else Finished(task, result, seconds))

    def _report(self, event: Happening | _Ended) -> None:
        if not self._closing:
            self._reports.put((self, event))


class LocalExecutor:
    """Renders on workers of this machine.

    Parameters
    ----------
    files
        The files of logs and scratch, and the workers' command and patience.
    workers
        Their number. None starts one, and others while cores and memory are idle.
    devices
        Environment variables that give a worker its devices; workers take turns with the entries.
    """

    def __init__(
        self, files: WorkerFiles, workers: int | None = 1, devices: Sequence[Mapping[str, str]] = ({},)
    ) -> None:
        self._files = files
        self._workers = workers
        self._devices = devices
        self._slots: list[_Slot] = []
        self._use_before: Use | None = None
        self._reports: queue.Queue[tuple[_Slot, Happening | _Ended]] = queue.Queue()

    def __enter__(self) -> LocalExecutor:
        self._slots.append(self._new_slot())
        return self

    def __exit__(self, *exception: object) -> None:
        for slot in self._slots:
            slot.close()

    def launch(self) -> None:
        """Start the first worker without waiting for it; the first frame raises the error if that fails."""
        try:
            self._slots[0].worker.launch()
        except WorkerError:
            return

    def prepare(self, scene: SceneTask) -> None:
        """Send a scene to the first worker while that is starting."""
        self._slots[0].worker.prepare(scene)

    def render(self, tasks: Sequence[FrameTask], is_needed: FrameFilter) -> Iterator[Happening]:
        """Render tasks, as `Executor.render`."""
        shares = Shares(tasks)
        self._use_before = None
        scene_of: dict[_Slot, object] = {}
        while len(self._slots) < min(self._workers or 1, len(tasks)):
            self._slots.append(self._new_slot())
        for slot in self._slots:
            self._fill(slot, shares, is_needed)
        while any(slot.assigned for slot in self._slots):
            slot, event = self._reports.get()
            match event:
                case _Ended(error):
                    raise error
                case Finished(task, rendered, seconds):
                    first = scene_of.get(slot) is not task.scene
                    scene_of[slot] = task.scene
                    shares.record_time(task, seconds, first=first)
                    slot.seconds = seconds
                    assert isinstance(rendered, Rendered)  # workers of this machine do not write frames
                    if self._workers is None and not first and self._is_worth_another(shares, rendered.memory, seconds):
                        self._slots.append(self._new_slot())
                        self._fill(self._slots[-1], shares, is_needed)
            if isinstance(event, Finished | GivenUp):
                slot.assigned -= 1
                self._fill(slot, shares, is_needed)
            yield event

    def _is_worth_another(self, shares: Shares, memory: int, seconds: float) -> bool:
        """Return whether another worker is worth it, by the cores and the memory that the last seconds left idle."""
        now = Use.of(pid for slot in self._slots if (pid := slot.worker.pid) is not None)
        before = self._use_before
        if before is None or now.clock < before.clock + _MEASURED_SECONDS:
            self._use_before = before or now
            return False
        self._use_before = now
        idle, count = idle_cores(before, now), len(self._slots)
        is_worth_it = is_worth_another(count, idle, len(shares) * seconds / count, memory, free_memory())
        self._use_before = None if is_worth_it else now  # measured anew when the next worker renders
        return is_worth_it

    def _fill(self, slot: _Slot, shares: Shares, is_needed: FrameFilter) -> None:
        """Assign frames to a worker until it has enough."""
        limit = 2 if slot.seconds is not None and slot.seconds < _SHORT_FRAME else 1
        while slot.assigned < limit and (task := shares.next_for(slot)) is not None:
            if is_needed(task):
                slot.assign(task)
        if not slot.assigned:
            shares.remove_worker(slot)

    def _new_slot(self) -> _Slot:
        number = len(self._slots)
        name = f"worker-{number + 1}" if number else "worker"
        # The pixels do not depend on the cores: each pixel is one sum, in the order of its samples.
        count = self._workers or 1
        cores = share_of_cores(number, count) if count > 1 else None
        files, variables = self._files, self._devices[number % len(self._devices)]
        worker = Worker(files.command, files.log(name), files.scratch, files.patience, variables, cores)
        return _Slot(worker, self._reports)
