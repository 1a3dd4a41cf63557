"""What runs on the workers of Dask: a renderer each, kept from chunk to chunk, and files by their content.

`lookdev.rendering.executors.dask` calls these functions on other machines. A chunk is bytes until it is known that
both have the same versions. It answers for each of its frames, or why it renders none.
"""

from __future__ import annotations

import os
import pickle
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lookdev.cache import Content, cache_dir
from lookdev.errors import LookdevError, OutputError, WorkerError
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.executors.protocol import GivenUp, Retried, Store, Stored
from lookdev.rendering.executors.tries import rendered_in_tries
from lookdev.rendering.executors.versions import mismatch, versions
from lookdev.rendering.results import Progress, Rendered
from lookdev.rendering.task import FrameTask, contents
from lookdev.rendering.threads import share_of_cores
from lookdev.rendering.worker import Worker

IDLE = 300.0
"""Seconds without a chunk after which a renderer is ended: its memory serves others."""

_LOOK = 0.5  # seconds between looks at whether the chunk is still wanted, and between reports
_APPEARS = 5.0  # seconds until a new file is seen on shared file systems


@dataclass(frozen=True)
class Order:
    """A chunk of frames of one scene, pickled, and how to render it.

    `store` writes frames to the shared output, whose mark is the file `shared`; None: pixels are the answer. `command`
    replaces that of the backend, in tests. `sharing` workers, whose names are numbers, divide the cores of a machine.
    """

    frames: bytes
    backend: str
    versions: Mapping[str, str]
    topic: str
    patience: float
    store: Store | None = None
    shared: Path | None = None
    command: tuple[str, ...] | None = None
    sharing: int = 1


@dataclass(frozen=True)
class Answer:
    """What came of a frame, by its number in the chunk, and its seconds."""

    number: int
    made: Rendered | Stored | str  # a reason where it failed
    seconds: float


@dataclass(frozen=True)
class Answers:
    """What came of the frames of a chunk."""

    worker: str
    frames: list[Answer]


@dataclass(frozen=True)
class Lacks:
    """Files that the worker lacks."""

    worker: str
    files: tuple[Content, ...]


@dataclass(frozen=True)
class Unfit:
    """Why the worker renders nothing."""

    worker: str
    reason: str


@dataclass(frozen=True)
class Unwritable:
    """A file that the worker cannot write."""

    reason: str


Result = Answers | Lacks | Unfit | Unwritable


def render_order(order: Order) -> Result:
    """Render a chunk, on a worker of Dask."""
    from distributed import get_worker

    me: Any = get_worker()
    if problem := mismatch(order.versions, versions(order.backend), f"worker {me.address}"):
        return Unfit(me.address, problem)
    tasks: list[FrameTask] = pickle.loads(order.frames)
    if order.shared is not None and not _appears(order.shared):
        return Unfit(
            me.address,
            f"worker {me.address} does not see {order.shared.parent}: mount the output folder there under the same "
            "path, or leave out --shared",
        )
    try:
        if lacking := tuple(each for each in sorted(contents(tasks[0].scene), key=str) if not each.is_whole()):
            return Lacks(me.address, lacking)
        with _RENDERERS.lent(order, me) as worker, _wanted(me, worker) as ended:
            frames = [_render(order, number, task, worker, me, ended) for number, task in enumerate(tasks)]
            return Answers(me.address, frames)
    except OutputError as error:
        return Unwritable(f"worker {me.address}: {error}")
    except WorkerError as error:
        return Unfit(me.address, f"worker {me.address}: {error}")


def receive(name: str, digest: str, offset: int, data: bytes, last: bool) -> str:
    """Take a part of a file of the content store; with the `last`, check it. Return what is wrong, or ""."""
    part = cache_dir("content") / f".{name}.{os.getpid()}.part"  # workers of one machine share the folder
    try:
        with part.open("r+b" if offset else "wb") as stream:
            stream.seek(offset)
            stream.write(data)
        if not last:
            return ""
        suffix = Path(name).suffix
        try:
            made = Content.written(suffix, lambda path: shutil.move(part, path))
        finally:
            part.unlink(missing_ok=True)
    except (OSError, LookdevError) as error:
        return str(error)
    return "" if made.digest == digest else f"{name}: what arrived has another content"


def worker_versions(backend: str) -> dict[str, str]:
    """Return `versions`."""
    return versions(backend)


def _appears(file: Path) -> bool:
    until = time.monotonic() + _APPEARS
    while not file.exists():
        if time.monotonic() > until:
            return False
        time.sleep(0.1)
    return True


def _render(order: Order, number: int, task: FrameTask, worker: Worker, me: Any, ended: Callable[[], bool]) -> Answer:
    started, reported = time.monotonic(), [0.0]

    def tell(**what: object) -> None:
        me.log_event(order.topic, {"digest": task.digest, **what})

    def progressed(progress: Progress) -> None:
        if time.monotonic() > reported[0] + _LOOK:
            reported[0] = time.monotonic()
            tell(samples=progress.samples, of=progress.of, relmse=progress.relmse)

    def retried(each: Retried) -> None:
        tell(reason=each.reason, attempt=each.attempt, attempts=each.attempts)

    if ended():
        return Answer(number, "cancelled", 0.0)
    tell(started=True)
    made = rendered_in_tries(worker, task, progressed, retried, ended)
    seconds = time.monotonic() - started
    if isinstance(made, GivenUp):
        return Answer(number, f"{made.reason} (on {me.address}, log: {made.log})", seconds)
    return Answer(number, made if order.store is None else order.store(task, made), seconds)


@contextmanager
def _wanted(me: Any, worker: Worker) -> Iterator[Callable[[], bool]]:
    """Yield whether the chunk in this thread was cancelled; the renderer is stopped when it is."""
    key, over, cancelled = me.get_current_task(), threading.Event(), threading.Event()

    def look() -> None:
        while not over.wait(_LOOK):
            task = me.state.tasks.get(key)
            if task is None or task.state not in ("executing", "long-running"):
                cancelled.set()
                worker.stop()

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield cancelled.is_set
    finally:
        over.set()
        thread.join()


class _Renderers:
    """The renderer of this process: one, whoever asks, ended when nobody has asked for long."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._worker: Worker | None = None
        self._made_by: object = None
        self._idle: threading.Timer | None = None

    @contextmanager
    def lent(self, order: Order, me: Any) -> Iterator[Worker]:
        """Yield the renderer to one thread at a time."""
        command = order.command or BACKENDS[order.backend].command
        with self._lock:
            if self._idle is not None:
                self._idle.cancel()
            cores = share_of_cores(int(me.name), order.sharing) if order.sharing > 1 else None
            made_by = (command, cores, order.patience)
            if self._worker is None or self._made_by != made_by:
                self._end()
                # Dask removes its folder when the worker ends, even long after it was killed.
                scratch = Path(tempfile.mkdtemp(prefix="lookdev-", dir=me.local_directory))
                log = scratch / "worker.log"
                self._worker = Worker(command, log, scratch, order.patience, cores=cores)
                self._made_by = made_by
            try:
                yield self._worker
            finally:
                self._idle = threading.Timer(IDLE, self._end_if_idle)
                self._idle.daemon = True
                self._idle.start()

    def _end_if_idle(self) -> None:
        if self._lock.acquire(blocking=False):
            try:
                self._end()
            finally:
                self._lock.release()

    def _end(self) -> None:
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.kill()
            shutil.rmtree(worker.log.parent, ignore_errors=True)


_RENDERERS = _Renderers()
