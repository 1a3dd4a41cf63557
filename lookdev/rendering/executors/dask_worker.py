"""The functions that run on workers of Dask: a renderer that stays alive between chunks, and a content store.

`lookdev.rendering.executors.dask` calls these functions on other machines. A chunk is pickled, and unpickled only after
the versions are known to be equal. Its result has an answer for each frame, or the reason why none was rendered.
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
from typing import TYPE_CHECKING, TypedDict, Unpack

from lookdev.cache import Content, cache_dir
from lookdev.errors import LookdevError, OutputError, WorkerError
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.executors.protocol import GivenUp, Retried, Store, Stored
from lookdev.rendering.executors.tries import render_with_retries
from lookdev.rendering.executors.versions import mismatch, versions
from lookdev.rendering.results import Progress, Rendered
from lookdev.rendering.task import FrameTask, files_of_task
from lookdev.rendering.threads import share_of_cores
from lookdev.rendering.worker import Worker

if TYPE_CHECKING:
    from distributed import Worker as DaskWorker

IDLE = 300.0
"""Seconds without a chunk after which a renderer is ended, so that others can use its memory."""

_POLL = 0.5  # seconds between checks that the chunk is not cancelled, and between progress reports
_APPEARANCE_TIMEOUT = 5.0  # seconds until a new file is visible on a shared file system


@dataclass(frozen=True)
class Order:
    """A chunk of frames of one scene, pickled, and how to render it.

    `store` writes frames to the shared output, in which the file `shared` is a mark; without it, answers have pixels.
    `command` replaces that of the backend, in tests. `sharing` workers, named by numbers, share the cores of a machine.
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
class FrameAnswer:
    """The result of a frame, by its number in the chunk, and its seconds."""

    number: int
    result: Rendered | Stored | str  # a reason if the frame failed
    seconds: float


@dataclass(frozen=True)
class ChunkAnswers:
    """The results of the frames of a chunk."""

    worker: str
    frames: list[FrameAnswer]


@dataclass(frozen=True)
class MissingFiles:
    """A worker renders nothing until it is sent these files."""

    worker: str
    files: tuple[Content, ...]


@dataclass(frozen=True)
class UnfitWorker:
    """A worker cannot render, for this reason."""

    worker: str
    reason: str


@dataclass(frozen=True)
class Unwritable:
    """A worker cannot write a file, for this reason."""

    reason: str


ChunkResult = ChunkAnswers | MissingFiles | UnfitWorker | Unwritable


class WorkerEvent(TypedDict, total=False):
    """An event of a frame that a worker logs: its start, a try that failed, or its progress."""

    digest: str
    started: bool
    reason: str
    attempt: int
    attempts: int
    samples: int
    of: int
    relmse: float | None


def render_order(order: Order) -> ChunkResult:
    """Render a chunk on this worker of Dask."""
    from distributed import get_worker

    host = get_worker()
    if problem := mismatch(order.versions, versions(order.backend), f"worker {host.address}"):
        return UnfitWorker(host.address, problem)
    tasks: list[FrameTask] = pickle.loads(order.frames)
    if order.shared is not None and not _wait_for_file(order.shared):
        return UnfitWorker(
            host.address,
            f"worker {host.address} does not see {order.shared.parent}: mount the output folder there under the same "
            "path, or leave out --shared",
        )
    try:
        if missing := tuple(file for file in sorted(files_of_task(tasks[0].scene), key=str) if not file.is_whole()):
            return MissingFiles(host.address, missing)
        with _RENDERER.borrow(order, host) as worker, _stop_if_cancelled(host, worker) as is_cancelled:
            frames = [
                _render_frame(order, number, task, worker, host, is_cancelled) for number, task in enumerate(tasks)
            ]
            return ChunkAnswers(host.address, frames)
    except OutputError as error:
        return Unwritable(f"worker {host.address}: {error}")
    except WorkerError as error:
        return UnfitWorker(host.address, f"worker {host.address}: {error}")


def receive(name: str, digest: str, offset: int, data: bytes, last: bool) -> str:
    """Append a part to a file of the content store, and check it after the `last`. Return what is wrong, or ""."""
    part = cache_dir("content") / f".{name}.{os.getpid()}.part"  # workers of one machine share the folder
    try:
        with part.open("r+b" if offset else "wb") as stream:
            stream.seek(offset)
            stream.write(data)
        if not last:
            return ""
        suffix = Path(name).suffix
        try:
            content = Content.store_written(suffix, lambda path: shutil.move(part, path))
        finally:
            part.unlink(missing_ok=True)
    except (OSError, LookdevError) as error:
        return str(error)
    return "" if content.digest == digest else f"{name}: what arrived has another content"


def _wait_for_file(file: Path) -> bool:
    deadline = time.monotonic() + _APPEARANCE_TIMEOUT
    while not file.exists():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)
    return True


def _render_frame(
    order: Order, number: int, task: FrameTask, worker: Worker, host: DaskWorker, is_cancelled: Callable[[], bool]
) -> FrameAnswer:
    started, last_report = time.monotonic(), [0.0]

    def log_event(**fields: Unpack[WorkerEvent]) -> None:
        host.log_event(order.topic, {"digest": task.digest, **fields})

    def on_progress(progress: Progress) -> None:
        if time.monotonic() > last_report[0] + _POLL:
            last_report[0] = time.monotonic()
            log_event(samples=progress.samples, of=progress.of, relmse=progress.relmse)

    def on_retry(retry: Retried) -> None:
        log_event(reason=retry.reason, attempt=retry.attempt, attempts=retry.attempts)

    if is_cancelled():
        return FrameAnswer(number, "cancelled", 0.0)
    log_event(started=True)
    rendered = render_with_retries(worker, task, on_progress, on_retry, is_cancelled)
    seconds = time.monotonic() - started
    if isinstance(rendered, GivenUp):
        return FrameAnswer(number, f"{rendered.reason} (on {host.address}, log: {rendered.log})", seconds)
    return FrameAnswer(number, rendered if order.store is None else order.store(task, rendered), seconds)


@contextmanager
def _stop_if_cancelled(host: DaskWorker, worker: Worker) -> Iterator[Callable[[], bool]]:
    """Yield a function that tells whether this thread's chunk was cancelled; stop the renderer when it is."""
    key, over, cancelled = host.get_current_task(), threading.Event(), threading.Event()

    def poll() -> None:
        while not over.wait(_POLL):
            task = host.state.tasks.get(key)
            if task is None or task.state not in ("executing", "long-running"):
                cancelled.set()
                worker.stop()

    thread = threading.Thread(target=poll, daemon=True)
    thread.start()
    try:
        yield cancelled.is_set
    finally:
        over.set()
        thread.join()


class _Renderer:
    """The one renderer of this process, which ends after `IDLE` seconds without use."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._worker: Worker | None = None
        self._settings: object = None
        self._idle: threading.Timer | None = None

    @contextmanager
    def borrow(self, order: Order, host: DaskWorker) -> Iterator[Worker]:
        """Yield the renderer, to one thread at a time."""
        command = order.command or BACKENDS[order.backend].command
        with self._lock:
            if self._idle is not None:
                self._idle.cancel()
            cores = share_of_cores(int(host.name), order.sharing) if order.sharing > 1 else None
            settings = (command, cores, order.patience)
            if self._worker is None or self._settings != settings:
                self._end_renderer()
                # Dask removes the folder when its worker ends, even long after a kill.
                scratch = Path(tempfile.mkdtemp(prefix="lookdev-", dir=host.local_directory))
                log = scratch / "worker.log"
                self._worker = Worker(command, log, scratch, order.patience, cores=cores)
                self._settings = settings
            try:
                yield self._worker
            finally:
                self._idle = threading.Timer(IDLE, self._end_if_idle)
                self._idle.daemon = True
                self._idle.start()

    def _end_if_idle(self) -> None:
        if self._lock.acquire(blocking=False):
            try:
                self._end_renderer()
            finally:
                self._lock.release()

    def _end_renderer(self) -> None:
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.kill()
            shutil.rmtree(worker.log.parent, ignore_errors=True)


_RENDERER = _Renderer()
