"""The executor for workers of a Dask cluster, which it starts on this machine, or which the user runs elsewhere.

- Rocklin 2015, "Dask: Parallel Computation with Blocked algorithms and Task Scheduling"; https://distributed.dask.org

The executor submits chunks to Dask. A chunk is one task of Dask, and consists of frames of one scene that take about 15
seconds (`frame_queue`). Each worker gets two chunks of its scene at a time. An adaptive scheduler then sees more work
than its workers can do, and starts more workers. The chunks of a lost worker go to other workers. If a worker answers
that it lacks files, the executor sends them, once. `dask_worker` is the code that runs on the workers.
"""

from __future__ import annotations

import asyncio
import logging
import math
import pickle
import queue
import secrets
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from lookdev.cache import Content
from lookdev.errors import LookdevError, OutputError, WorkerError
from lookdev.rendering.executors.capacity import free_memory
from lookdev.rendering.executors.dask_worker import (
    ChunkAnswers,
    ChunkRequest,
    ChunkResult,
    MissingFiles,
    UnfitWorker,
    UnwritableOutput,
    WorkerEvent,
    receive_file_part,
    render_chunk,
)
from lookdev.rendering.executors.frame_queue import ChunkQueue
from lookdev.rendering.executors.protocol import (
    CRASH_TRIES,
    ExecutorEvent,
    ExecutorNote,
    Finished,
    FrameFilter,
    GivenUp,
    Progressed,
    Retried,
    Started,
    StoreFrame,
    WorkerFiles,
)
from lookdev.rendering.executors.versions import package_versions, version_mismatch
from lookdev.rendering.results import ProgressMessage
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.rendering.threads import usable_cores

if TYPE_CHECKING:
    from distributed import Future

_CONNECT_TIMEOUT = 10.0  # seconds within which a scheduler must answer
_PART_BYTES = 32 << 20  # the most bytes of a file in one message
_CHUNKS_PER_WORKER = 2  # a worker renders one chunk while the next is sent
_POLL = 1.0  # seconds between checks of the cluster
_NO_WORKER_NOTE = 15.0  # seconds without a worker after which the user gets a note
_CORES_PER_WORKER = 4  # the cores for each worker of a cluster on this machine
_MEMORY_PER_WORKER = 2 << 30  # the bytes for each worker of a cluster on this machine


@dataclass(eq=False)
class _Chunk:
    """Frames of one scene that are one task of Dask. Addresses identify workers."""

    tasks: list[FrameTask]
    worker: str = ""  # the worker to which the chunk is assigned; "" leaves the choice to Dask
    future: Future = None  # Dask's future of the chunk's `ChunkResult`, once the chunk is submitted
    losses: int = 0  # number of workers that were lost while they rendered the chunk
    sent: set[str] = field(default_factory=set)  # the workers to which the files of the chunk were sent


class DaskExecutor:
    """Renders on the workers of a Dask cluster, which it starts itself, or whose scheduler is at an address.

    Parameters
    ----------
    files
        The scratch folder, which is in the output folder, and the timeout of workers. `WorkerFiles.command` is not
        used: `command` takes its place.
    address
        The address of the scheduler. "" starts a cluster on this machine.
    workers
        The number of workers in a cluster on this machine. None starts one for each `_CORES_PER_WORKER` cores, as
        memory allows.
    store
        The function that workers call to write the files of frames. If it is None, workers return pixels to the caller,
        who writes the files.
    command
        The command of the renderer that each worker of Dask starts. None takes the command of the backend.
    """

    def __init__(
        self,
        files: WorkerFiles,
        address: str = "",
        workers: int | None = None,
        store: StoreFrame | None = None,
        command: tuple[str, ...] | None = None,
    ) -> None:
        self._files, self._address, self._count = files, address, workers
        self._store, self._command = store, command
        self._run = secrets.token_hex(4)  # a random name, so that several runs on one cluster have different names
        self._stack = ExitStack()
        # Threads of Dask put chunks that have ended, and events of frames, into this queue.
        self._incoming: queue.SimpleQueue[_Chunk | ExecutorEvent] = queue.SimpleQueue()
        self._task_of_digest: dict[str, FrameTask] = {}
        self._started: set[str] = set()  # digests of the frames that a renderer has started
        self._in_flight: set[_Chunk] = set()  # submitted chunks whose results are not handled yet
        self._unfit: dict[str, str] = {}  # the reason why a worker cannot render, by the worker's address
        self._workers_per_machine = 1  # the number of workers that share the cores of a machine, if known
        self._workers: set[str] = set()  # the addresses of workers at the last check
        self._number = 0  # number of chunks submitted so far

    def __enter__(self) -> DaskExecutor:
        try:
            from distributed import Client, LocalCluster
        except ImportError:
            raise LookdevError("executor 'dask' needs Dask's distributed: pip install 'lookdev[farm]'") from None

        for name in ("distributed", "tornado.application", "bokeh"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # notes of this executor report lost workers
        with ExitStack() as stack, warnings.catch_warnings():
            # Dask warns about versions, which this executor compares itself, and about ports.
            warnings.simplefilter("ignore")
            target: LocalCluster | str = self._address
            if not self._address:
                count = self._count or max(
                    min(usable_cores() // _CORES_PER_WORKER, free_memory() // _MEMORY_PER_WORKER), 1
                )
                self._workers_per_machine = count
                cluster = LocalCluster(
                    n_workers=count,
                    threads_per_worker=1,
                    dashboard_address="127.0.0.1:0",
                    memory_limit=0,
                    host="127.0.0.1",
                )
                target = stack.enter_context(cluster)
            try:
                # The address is tried before a client is made. A client that cannot connect closes when it is
                # garbage-collected, and then hangs if another client starts meanwhile.
                if self._address:
                    asyncio.run(_connect_once(self._address))
                client = Client(target, timeout=_CONNECT_TIMEOUT, set_as_default=False, name="lookdev")
            except ValueError as error:
                raise LookdevError(
                    f"--executor: '{self._address}' is not an address of a scheduler of Dask ({error}): write "
                    "dask:tcp://HOST:8786"
                ) from None
            except OSError as error:
                raise WorkerError(
                    f"no scheduler of Dask answers at {self._address}: {_error_line(error)}; start one with 'dask "
                    "scheduler', and workers with 'dask worker ADDRESS --nthreads 1', or check address and firewall"
                ) from None
            self._client = stack.enter_context(client)
            self._client.subscribe_topic(self._topic, self._on_event)
            stack.callback(self._cancel_chunks)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        with suppress(Exception):  # the cluster may be gone
            self._stack.close()

    def launch(self) -> None:
        """Do nothing: workers start their renderers with their first chunk."""

    def prepare(self, scene: SceneTask) -> None:
        """Do nothing: it is not known yet which worker will render the scene."""

    def render(self, tasks: Sequence[FrameTask], is_needed: FrameFilter) -> Iterator[ExecutorEvent]:
        """Render tasks, as `Executor.render`."""
        backend = tasks[0].scene.backend
        self._check_versions(backend)
        self._queue = ChunkQueue(tasks, is_needed, returns_pixels=self._store is None)
        self._task_of_digest.update({task.digest: task for task in tasks})
        self._request = ChunkRequest(
            b"",
            backend,
            package_versions(backend),
            self._topic,
            self._files.timeout,
            self._store,
            self._create_shared_marker(),
            self._command,
            self._workers_per_machine,
        )
        last_worker, last_poll = time.monotonic(), -math.inf
        while True:
            if time.monotonic() > last_poll + _POLL:
                last_poll = time.monotonic()
                workers = self._fit_workers()
                last_worker = last_poll if workers else last_worker
                if last_poll > last_worker + _NO_WORKER_NOTE:
                    last_worker = last_poll
                    yield ExecutorNote(f"{self._cluster} has no worker: frames wait for one")
                lost, self._workers = self._workers - set(workers), set(workers)
                for worker in lost:
                    self._queue.remove_worker(worker)
                # The executor takes back the chunks of lost workers. The scheduler would keep them for a worker with
                # the same address.
                for chunk in [chunk for chunk in self._in_flight if chunk.worker in lost]:
                    self._in_flight.discard(chunk)
                    chunk.future.cancel(force=True)
                    yield from self._render_again(chunk, f"worker {chunk.worker} was lost")
            self._submit_chunks(workers)
            if not self._in_flight:
                return
            try:
                item = self._incoming.get(timeout=_POLL)
            except queue.Empty:
                continue
            if not isinstance(item, _Chunk):
                yield item
            elif item in self._in_flight:
                self._in_flight.discard(item)
                yield from self._handle_result(item)

    def _submit_chunks(self, workers: Sequence[str]) -> None:
        """Submit chunks until each worker has `_CHUNKS_PER_WORKER`.

        If there is no worker, submit one chunk, which Dask gives to the first worker that comes.
        """
        chunk_counts = Counter(chunk.worker for chunk in self._in_flight)
        for worker in workers:
            while chunk_counts[worker] < _CHUNKS_PER_WORKER and (
                frames := self._queue.next_chunk(worker, len(workers))
            ):
                self._submit_chunk(_Chunk(frames, worker))
                chunk_counts[worker] += 1
        if not workers and not self._in_flight and (frames := self._queue.next_chunk("", 1)):
            self._queue.remove_worker("")
            self._submit_chunk(_Chunk(frames))

    @property
    def _topic(self) -> str:
        """The topic of Dask's event log under which workers log the events of this run."""
        return f"lookdev-{self._run}"

    def _create_shared_marker(self) -> Path | None:
        """Create a file in the output folder, and return its path; None if workers do not write there.

        By this file, workers check that they see the output folder.
        """
        if self._store is None:
            return None
        mark = self._files.scratch / f"shared-{self._run}"
        mark.touch()
        return mark

    def _submit_chunk(self, chunk: _Chunk) -> None:
        """Submit a chunk to Dask. When the chunk has ended, it is put into `_incoming`."""
        self._number += 1
        chunk.future = self._client.submit(
            render_chunk,
            replace(self._request, frames=pickle.dumps(chunk.tasks)),
            key=f"lookdev-{self._run}-{self._number}",
            workers=[chunk.worker] if chunk.worker else None,
            priority=-self._number,
            pure=False,
        )
        self._in_flight.add(chunk)
        chunk.future.add_done_callback(lambda _: self._incoming.put(chunk))

    def _handle_result(self, chunk: _Chunk) -> Iterator[ExecutorEvent]:
        """Handle the result of a chunk, and yield the events of its frames."""
        if chunk.future.status in ("cancelled", "lost"):
            raise WorkerError(f"{self._cluster} has dropped the run; run the same command again to continue")
        result: ChunkResult
        try:
            result = self._result_of(chunk)
        except Exception as error:  # noqa: BLE001  an error of the worker, or an error of Dask about lost workers
            yield from self._render_again(chunk, _error_line(error))
            return
        match result:
            case MissingFiles(worker, files):
                if worker in chunk.sent:
                    raise WorkerError(f"worker {worker} lacks {files[0].digest}{files[0].suffix}, which it was sent")
                self._send_files(worker, files)
                chunk.sent.add(worker)
                chunk.worker = worker
                self._submit_chunk(chunk)
            case UnfitWorker(worker, reason):
                yield from self._exclude_worker(worker, reason)
                fit = sorted(set(self._addresses()) - self._unfit.keys())
                if not fit:
                    raise WorkerError(f"no worker of {self._cluster} can render: {reason}")
                chunk.worker = fit[self._number % len(fit)]
                self._submit_chunk(chunk)
            case UnwritableOutput(reason):
                raise OutputError(reason)
            case ChunkAnswers(worker, answers):
                self._submit_chunks(sorted(self._workers - self._unfit.keys()))
                for answer in answers:
                    task = chunk.tasks[answer.number]
                    if isinstance(answer.result, str):
                        yield GivenUp(task, answer.result, None)
                    else:
                        self._queue.record_time(task, answer.seconds, worker)
                        yield Finished(task, answer.result, answer.seconds)

    def _result_of(self, chunk: _Chunk) -> ChunkResult:
        """Return the result of a chunk that has ended.

        Raises what the worker raised, and TimeoutError where the result does not arrive in time or the worker is lost.
        """
        deadline = time.monotonic() + _CONNECT_TIMEOUT
        while True:
            try:
                result: ChunkResult = chunk.future.result(timeout=_POLL)
                return result
            except TimeoutError:
                # If Dask has chosen the worker, `chunk.worker` is "".
                if chunk.worker and chunk.worker not in self._addresses():
                    raise TimeoutError(f"worker {chunk.worker} was lost with its result") from None
                if time.monotonic() > deadline:
                    raise TimeoutError(f"{chunk.worker or self._cluster} does not send a result") from None

    def _render_again(self, chunk: _Chunk, reason: str) -> Iterator[ExecutorEvent]:
        """Submit the frames of a lost chunk again, and give up a frame that was lost `CRASH_TRIES` times.

        If the rendering of a frame had started, that frame may be the cause of the loss. Each frame is then submitted
        by itself.
        """
        started = any(task.digest in self._started for task in chunk.tasks)
        yield ExecutorNote(f"{len(chunk.tasks)} frames go to another worker: {reason}")
        groups = [[task] for task in chunk.tasks] if started else [chunk.tasks]
        for tasks in groups:
            losses = chunk.losses + any(task.digest in self._started for task in tasks)
            self._started.difference_update(task.digest for task in tasks)
            if losses >= CRASH_TRIES:
                yield GivenUp(tasks[0], f"{reason}, {losses} times", None)
            else:
                self._submit_chunk(_Chunk(tasks, losses=losses))

    def _exclude_worker(self, worker: str, reason: str) -> Iterator[ExecutorEvent]:
        """Exclude a worker from further chunks, and yield a note about this."""
        if worker not in self._unfit:
            self._unfit[worker] = reason
            yield ExecutorNote(f"left out: {reason}")

    def _send_files(self, worker: str, files: Sequence[Content]) -> None:
        """Send files to the content store of a worker, in parts; raises OutputError where a file cannot be stored."""
        for file in files:
            size = file.path.stat().st_size
            with file.path.open("rb") as stream:
                for offset in range(0, max(size, 1), _PART_BYTES):
                    data, is_last = stream.read(_PART_BYTES), offset + _PART_BYTES >= size
                    part = f"{file.digest}{file.suffix}", file.digest, offset, data, is_last
                    answers = self._client.run(receive_file_part, *part, workers=[worker])
                    if any(answers.values()):
                        raise OutputError(f"worker {worker} cannot keep a file: {answers[worker]}")

    def _check_versions(self, backend: str) -> None:
        """Raise WorkerError where the versions of a connected worker differ from the versions of this process."""
        try:
            by_worker = self._client.run(package_versions, backend, on_error="return")
        except Exception as error:
            raise WorkerError(f"{self._cluster} does not answer: {_error_line(error)}") from error
        problems = []
        for worker, remote in by_worker.items():
            if isinstance(remote, Exception):
                problems.append(
                    f"worker {worker} has no lookdev of this version: {_error_line(remote)}; install it in the "
                    "environment of all workers: pip install 'lookdev[farm]'"
                )
            elif problem := version_mismatch(package_versions(backend), remote, f"worker {worker}"):
                problems.append(problem)
        if problems:
            raise WorkerError("\n".join(problems))

    def _fit_workers(self) -> list[str]:
        """Return the workers that can render; raises WorkerError where the scheduler has gone."""
        if self._client.status != "running":
            raise WorkerError(
                f"the connection to {self._cluster} is lost; frames that are done are kept: run the same command again"
            )
        return [address for address in self._addresses() if address not in self._unfit]

    def _addresses(self) -> list[str]:
        """Return the addresses of all workers; raises WorkerError where the scheduler does not answer."""
        try:
            return list(self._client.nthreads())
        except Exception as error:
            raise WorkerError(
                f"{self._cluster} does not answer: {_error_line(error)}; run the same command again"
            ) from error

    @property
    def _cluster(self) -> str:
        """The name of the cluster in messages."""
        return f"the scheduler {self._address}" if self._address else "the cluster of Dask on this machine"

    def _on_event(self, event: tuple[float, WorkerEvent]) -> None:
        """Queue an event that a worker has logged while it renders; `event` is a time stamp and the worker's fields."""
        fields = event[1]
        task = self._task_of_digest.get(fields.get("digest", ""))
        if task is None:
            return
        if "started" in fields:
            self._started.add(task.digest)
            self._incoming.put(Started(task))
        elif "reason" in fields:
            self._incoming.put(Retried(task, fields["reason"], fields["attempt"], fields["attempts"]))
        else:
            samples, of, relmse = fields["samples"], fields["of"], fields["relmse"]
            progress = ProgressMessage(type="progress", digest=task.digest, samples=samples, of=of, relmse=relmse)
            self._incoming.put(Progressed(task, progress))

    def _cancel_chunks(self) -> None:
        """Cancel the chunks in flight; workers then stop their renderers."""
        futures = [chunk.future for chunk in self._in_flight]
        self._in_flight.clear()
        if futures:
            with suppress(Exception):
                self._client.cancel(futures, force=True)


async def _connect_once(address: str) -> None:
    """Raise ValueError where an address is malformed, and OSError where no scheduler answers at the address."""
    from distributed.comm import connect
    from distributed.security import Security

    comm = await connect(address, timeout=_CONNECT_TIMEOUT, **Security().get_connection_args("client"))
    await comm.close()


def _error_line(error: BaseException) -> str:
    """Return the type of an error and the first line of its message."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__
