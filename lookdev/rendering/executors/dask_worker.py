"""The functions that run on workers of Dask: they render chunks of frames, and receive files.

`lookdev.rendering.executors.dask` calls these functions, also on other machines. A chunk arrives pickled, and is
unpickled only if both sides have equal versions of the packages that render frames. The result of a chunk has an answer
for each frame, or the reason why no frame was rendered. The renderer, a child process, stays alive between chunks.
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
from lookdev.rendering.executors.protocol import GivenUp, Retried, StoredFrame, StoreFrame
from lookdev.rendering.executors.tries import render_with_retries
from lookdev.rendering.executors.versions import package_versions, version_mismatch
from lookdev.rendering.results import ProgressMessage, WorkerFrame
from lookdev.rendering.task import FrameTask, files_of_task
from lookdev.rendering.threads import share_of_cores
from lookdev.rendering.worker import Worker

if TYPE_CHECKING:
    from distributed import Worker as DaskWorker

IDLE_SECONDS = 300.0
"""Seconds without a chunk after which a renderer is ended, so that other processes can use its memory."""

_POLL = 0.5  # seconds between checks whether the chunk is cancelled, and between reports of progress
_APPEARANCE_TIMEOUT = 5.0  # seconds within which a new file must be visible on a shared file system


@dataclass(frozen=True)
class ChunkRequest:
    """A chunk of frames of one scene, and the settings with which a worker renders it."""

    frames: bytes  # the pickled list of tasks
    backend: str
    versions: Mapping[str, str]  # the versions of packages on the machine that sends the request, by name
    topic: str  # the topic of Dask's event log under which the worker logs each `WorkerEvent`
    timeout: float  # seconds without an answer after which the renderer counts as hung
    store: StoreFrame | None = None  # writes a frame to the shared output folder; without it, answers have pixels
    shared_marker: Path | None = None  # a file by which a worker checks that it sees the shared output folder
    command: tuple[str, ...] | None = None  # the renderer's command; tests use it in place of the backend's command
    # The number of workers that share the cores of a machine. If there are several, the name of each is its number.
    workers_per_machine: int = 1


@dataclass(frozen=True)
class FrameAnswer:
    """The result of a frame."""

    number: int  # the index of the frame in the chunk
    result: WorkerFrame | StoredFrame | str  # pixels, or figures of a written file, or the reason of a failure
    seconds: float  # the time from the start of the frame to its result


@dataclass(frozen=True)
class ChunkAnswers:
    """The results of the frames of a chunk."""

    worker: str  # the worker's address
    frames: list[FrameAnswer]


@dataclass(frozen=True)
class MissingFiles:
    """A worker lacks these files, and can render the chunk only after it has received them."""

    worker: str
    files: tuple[Content, ...]


@dataclass(frozen=True)
class UnfitWorker:
    """A worker cannot render, for this reason."""

    worker: str
    reason: str


@dataclass(frozen=True)
class UnwritableOutput:
    """A worker cannot write a file, for this reason."""

    reason: str


ChunkResult = ChunkAnswers | MissingFiles | UnfitWorker | UnwritableOutput


class WorkerEvent(TypedDict, total=False):
    """An event of a frame that a worker logs: the start of the frame, a failed try, or progress."""

    digest: str  # the digest of the frame, in every event
    started: bool  # only in the event of the start
    # In the event of a failed try, as in `Retried`:
    reason: str
    attempt: int
    attempts: int
    # In an event of progress, as in `ProgressMessage`:
    samples: int
    of: int
    relmse: float | None


def render_chunk(request: ChunkRequest) -> ChunkResult:
    """Render a chunk on this worker of Dask."""
    from distributed import get_worker

    dask_worker = get_worker()
    address = dask_worker.address
    if problem := version_mismatch(request.versions, package_versions(request.backend), f"worker {address}"):
        return UnfitWorker(address, problem)
    tasks: list[FrameTask] = pickle.loads(request.frames)
    if request.shared_marker is not None and not _wait_for_file(request.shared_marker):
        return UnfitWorker(
            address,
            f"worker {address} does not see {request.shared_marker.parent}: mount the output folder there under the "
            "same path, or leave out --shared",
        )
    try:
        if missing := tuple(file for file in sorted(files_of_task(tasks[0].scene), key=str) if not file.is_whole()):
            return MissingFiles(address, missing)
        with _RENDERER.borrow(request, dask_worker) as worker, _stop_if_cancelled(dask_worker, worker) as is_cancelled:
            frames = [
                _render_frame(request, number, task, worker, dask_worker, is_cancelled)
                for number, task in enumerate(tasks)
            ]
            return ChunkAnswers(address, frames)
    except OutputError as error:
        return UnwritableOutput(f"worker {address}: {error}")
    except WorkerError as error:
        return UnfitWorker(address, f"worker {address}: {error}")


def receive_file_part(name: str, digest: str, offset: int, data: bytes, is_last: bool) -> str:
    """Write a part of a file for the content store; after the last part, check and store the file.

    name : the file's name in the store; digest : the digest of the whole file; offset : the number of bytes before this
    part. Returns the message of an error, or "".
    """
    part = cache_dir("content") / f".{name}.{os.getpid()}.part"  # workers of one machine share the folder
    try:
        with part.open("r+b" if offset else "wb") as stream:
            stream.seek(offset)
            stream.write(data)
        if not is_last:
            return ""
        suffix = Path(name).suffix
        try:
            content = Content.store_written(suffix, lambda path: shutil.move(part, path))
        finally:
            part.unlink(missing_ok=True)
    except (OSError, LookdevError) as error:
        return str(error)
    return "" if content.digest == digest else f"{name}: the received content does not have the digest {digest}"


def _wait_for_file(file: Path) -> bool:
    """Return whether a file exists within `_APPEARANCE_TIMEOUT` seconds."""
    deadline = time.monotonic() + _APPEARANCE_TIMEOUT
    while not file.exists():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)
    return True


def _render_frame(
    request: ChunkRequest,
    number: int,
    task: FrameTask,
    worker: Worker,
    dask_worker: DaskWorker,
    is_cancelled: Callable[[], bool],
) -> FrameAnswer:
    """Render one frame of a chunk, write it if the request asks for it, and log its events.

    `number` is the index of the frame in the chunk. `is_cancelled` returns whether the chunk is cancelled.
    """
    started, last_report = time.monotonic(), [0.0]  # the time is in a list, so that `on_progress` can change it

    def log_event(**fields: Unpack[WorkerEvent]) -> None:
        dask_worker.log_event(request.topic, {"digest": task.digest, **fields})

    def on_progress(progress: ProgressMessage) -> None:
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
        return FrameAnswer(number, f"{rendered.reason} (on {dask_worker.address}, log: {rendered.log})", seconds)
    return FrameAnswer(number, rendered if request.store is None else request.store(task, rendered), seconds)


@contextmanager
def _stop_if_cancelled(dask_worker: DaskWorker, worker: Worker) -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether this thread's chunk is cancelled; stop the renderer if it is."""
    key, is_over, cancelled = dask_worker.get_current_task(), threading.Event(), threading.Event()

    def poll() -> None:
        while not is_over.wait(_POLL):
            task = dask_worker.state.tasks.get(key)
            if task is None or task.state not in ("executing", "long-running"):
                cancelled.set()
                worker.stop()

    thread = threading.Thread(target=poll, daemon=True)
    thread.start()
    try:
        yield cancelled.is_set
    finally:
        is_over.set()
        thread.join()


class _Renderer:
    """The only renderer of this process, a child process that is ended after `IDLE_SECONDS` without use."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # held by the thread that uses the renderer
        self._worker: Worker | None = None
        self._settings: object = None  # the settings of the running renderer: other settings need another renderer
        self._idle: threading.Timer | None = None  # ends the renderer

    @contextmanager
    def borrow(self, request: ChunkRequest, dask_worker: DaskWorker) -> Iterator[Worker]:
        """Yield the renderer to one thread at a time; replace it first if the request needs other settings."""
        command = request.command or BACKENDS[request.backend].command
        with self._lock:
            if self._idle is not None:
                self._idle.cancel()
            count = request.workers_per_machine
            cores = share_of_cores(int(dask_worker.name), count) if count > 1 else None
            settings = (command, cores, request.timeout)
            if self._worker is None or self._settings != settings:
                self._end_renderer()
                # Dask removes this folder when its worker ends. If Dask's worker is killed, a later worker removes it.
                scratch = Path(tempfile.mkdtemp(prefix="lookdev-", dir=dask_worker.local_directory))
                log = scratch / "worker.log"
                self._worker = Worker(command, log, scratch, request.timeout, cores=cores)
                self._settings = settings
            try:
                yield self._worker
            finally:
                self._idle = threading.Timer(IDLE_SECONDS, self._end_if_idle)
                self._idle.daemon = True
                self._idle.start()

    def _end_if_idle(self) -> None:
        """End the renderer, unless a thread uses it."""
        if self._lock.acquire(blocking=False):
            try:
                self._end_renderer()
            finally:
                self._lock.release()

    def _end_renderer(self) -> None:
        """End the renderer if it runs, and remove its temporary files."""
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.kill()
            shutil.rmtree(worker.log.parent, ignore_errors=True)


_RENDERER = _Renderer()
