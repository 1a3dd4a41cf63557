"""Workers of this machine: one, or several that render frames of their own at once.

Each worker has a thread, which tries a frame again where its process dies. The thread of the run hands frames out, one
ahead where frames are short, so that no worker waits until a frame is written.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from lookdev.errors import WorkerError
from lookdev.rendering.executors.capacity import Use, free_memory, idle_cores, worth_another
from lookdev.rendering.executors.protocol import (
    Finished,
    GivenUp,
    Happening,
    Place,
    Progressed,
    Started,
    Wanted,
)
from lookdev.rendering.executors.shares import Shares
from lookdev.rendering.executors.tries import rendered_in_tries
from lookdev.rendering.results import Progress, Rendered
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.rendering.threads import share_of_cores
from lookdev.rendering.worker import Worker

_WATCHED = 4.0
"""Seconds over which is measured what workers leave unused."""

_SHORT = 5.0
"""Seconds of a frame up to which a worker is given the next one ahead: at the end the others would wait for it."""


@dataclass(frozen=True)
class _Ended:
    """The thread of a worker has an error of the whole run."""

    error: BaseException


class _Slot:
    """A worker and its thread, which renders what it is given and reports to a queue that all slots share."""

    def __init__(self, worker: Worker, reports: queue.Queue[tuple[_Slot, Happening | _Ended]]) -> None:
        self.worker = worker
        self.given = 0  # frames that it has and did not finish
        self.seconds: float | None = None  # of its last frame
        self._inbox: queue.SimpleQueue[FrameTask | None] = queue.SimpleQueue()
        self._reports = reports
        self._thread: threading.Thread | None = None
        self._closing = False

    def give(self, task: FrameTask) -> None:
        """Have a frame rendered after those given before."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._serve, daemon=True)
            self._thread.start()
        self.given += 1
        self._inbox.put(task)

    def close(self) -> None:
        """End the process and the thread, and drop what is given."""
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
        started = time.monotonic()
        self._report(Started(task))

        def progressed(progress: Progress) -> None:
            self._report(Progressed(task, progress))

        made = rendered_in_tries(self.worker, task, progressed, self._report, lambda: self._closing)
        seconds = time.monotonic() - started
        self._report(made if isinstance(made, GivenUp) else Finished(task, made, seconds))

    def _report(self, what: Happening | _Ended) -> None:
        if not self._closing:
            self._reports.put((self, what))


class LocalExecutor:
    """Workers of this machine.

    Parameters
    ----------
    place
        Of logs and scratch, the workers' command and patience.
    workers
        How many; None: one, and others while they have cores and memory to gain from.
    devices
        Variables of the environment that show a worker its devices, of which workers take turns.
    """

    def __init__(self, place: Place, workers: int | None = 1, devices: Sequence[Mapping[str, str]] = ({},)) -> None:
        self._place = place
        self._workers = workers
        self._devices = devices
        self._slots: list[_Slot] = []
        self._before: Use | None = None
        self._reports: queue.Queue[tuple[_Slot, Happening | _Ended]] = queue.Queue()

    def __enter__(self) -> LocalExecutor:
        self._slots.append(self._slot())
        return self

    def __exit__(self, *exception: object) -> None:
        for slot in self._slots:
            slot.close()

    def launch(self) -> None:
        """Start the first worker, without waiting for it; an error is that of the first frame."""
        try:
            self._slots[0].worker.launch()
        except WorkerError:
            return

    def prepare(self, scene: SceneTask) -> None:
        """Send a scene to the first worker, if it starts."""
        self._slots[0].worker.prepare(scene)

    def render(self, tasks: Sequence[FrameTask], wanted: Wanted) -> Iterator[Happening]:
        """Render tasks, as the protocol has it."""
        shares = Shares(tasks)
        self._before = None
        firsts: dict[_Slot, object] = {}
        while len(self._slots) < min(self._workers or 1, len(tasks)):
            self._slots.append(self._slot())
        for slot in self._slots:
            self._feed(slot, shares, wanted)
        while any(slot.given for slot in self._slots):
            slot, what = self._reports.get()
            match what:
                case _Ended(error):
                    raise error
                case Finished(task, rendered, seconds):
                    first = firsts.get(slot) is not task.scene
                    firsts[slot] = task.scene
                    shares.measured(task, seconds, first=first)
                    slot.seconds = seconds
                    assert isinstance(rendered, Rendered)  # no worker here writes frames
                    if self._workers is None and not first and self._gains(shares, rendered.memory, seconds):
                        self._slots.append(self._slot())
                        self._feed(self._slots[-1], shares, wanted)
            if isinstance(what, Finished | GivenUp):
                slot.given -= 1
                self._feed(slot, shares, wanted)
            yield what

    def _gains(self, shares: Shares, memory: int, seconds: float) -> bool:
        """Return whether another worker is worth it, by what the last seconds left of cores and memory."""
        now = Use.of(pid for slot in self._slots if (pid := slot.worker.pid) is not None)
        before = self._before
        if before is None or now.clock < before.clock + _WATCHED:
            self._before = before or now
            return False
        self._before = now
        idle, count = idle_cores(before, now), len(self._slots)
        gains = worth_another(count, idle, len(shares) * seconds / count, memory, free_memory())
        self._before = None if gains else now  # the next is measured when that one renders
        return gains

    def _feed(self, slot: _Slot, shares: Shares, wanted: Wanted) -> None:
        """Give a worker frames until it has enough."""
        enough = 2 if slot.seconds is not None and slot.seconds < _SHORT else 1
        while slot.given < enough and (task := shares.next_for(slot)) is not None:
            if wanted(task):
                slot.give(task)
        if not slot.given:
            shares.leave(slot)

    def _slot(self) -> _Slot:
        number = len(self._slots)
        name = f"worker-{number + 1}" if number else "worker"
        # The same pixels with any cores: each is one sum, in the order of its samples.
        count = self._workers or 1
        cores = share_of_cores(number, count) if count > 1 else None
        place, variables = self._place, self._devices[number % len(self._devices)]
        worker = Worker(place.command, place.log(name), place.scratch, place.patience, variables, cores)
        return _Slot(worker, self._reports)
