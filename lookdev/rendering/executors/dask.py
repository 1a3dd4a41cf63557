"""Workers of a Dask cluster: one of this machine, or of a scheduler that the user runs.

- Rocklin 2015, "Dask: Parallel Computation with Blocked algorithms and Task Scheduling"; https://distributed.dask.org

A task of Dask is a chunk: frames of one scene, for about 15 seconds (`shares`). Each worker is given two, of the scene
that it renders; so an adaptive scheduler sees more work than it has workers for, and adds some. Chunks of workers
that are lost go to others. Files go to a worker that lacks them, once.
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
from typing import Any

from lookdev.cache import Content
from lookdev.errors import LookdevError, OutputError, WorkerError
from lookdev.rendering.executors.capacity import free_memory
from lookdev.rendering.executors.dask_worker import (
    Answers,
    Lacks,
    Order,
    Unfit,
    Unwritable,
    receive,
    render_order,
    worker_versions,
)
from lookdev.rendering.executors.protocol import (
    CRASH_TRIES,
    Finished,
    GivenUp,
    Happening,
    Place,
    Progressed,
    Remarked,
    Retried,
    Started,
    Store,
    Wanted,
)
from lookdev.rendering.executors.shares import ChunkShares
from lookdev.rendering.executors.versions import mismatch, versions
from lookdev.rendering.results import Progress
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.rendering.threads import cores

_CONNECT = 10.0  # seconds
_PIECE = 32 << 20  # bytes of a file in a message
_AHEAD = 2  # chunks of a worker: it renders one while the other is on its way
_LOOK = 1.0  # seconds between looks at the cluster
_LONELY = 15.0  # seconds without a worker until the user is told
_EACH = 4  # cores for a worker of a cluster of this machine
_MEMORY = 2 << 30  # bytes for one


@dataclass(eq=False)
class _Chunk:
    """Frames that were given to Dask together, and whose future that is."""

    tasks: list[FrameTask]
    worker: str = ""  # that it was given to
    future: Any = None
    losses: int = 0  # of workers that rendered it
    sent: set[str] = field(default_factory=set)  # workers that were sent its files


class DaskExecutor:
    """Workers of Dask, on a cluster that is started here, or at the address of its scheduler.

    Parameters
    ----------
    place
        Of scratch in the output folder, and the patience of workers. Its command counts for `command`.
    address
        Of the scheduler; "": a cluster of this machine.
    workers
        Of the cluster of this machine; None: one for each `_EACH` cores, as memory allows.
    store
        Has workers write frames; None: frames are written by who asks for them.
    command
        That of workers, instead of their backend's.
    """

    def __init__(
        self,
        place: Place,
        address: str = "",
        workers: int | None = None,
        store: Store | None = None,
        command: tuple[str, ...] | None = None,
    ) -> None:
        self._place, self._address, self._count = place, address, workers
        self._store, self._command = store, command
        self._run = secrets.token_hex(4)
        self._stack = ExitStack()
        self._arrived: queue.SimpleQueue[_Chunk | Happening] = queue.SimpleQueue()
        self._by_digest: dict[str, FrameTask] = {}
        self._started: set[str] = set()  # digests of frames that went to a renderer
        self._in_flight: set[_Chunk] = set()
        self._unfit: dict[str, str] = {}
        self._sharing = 1  # workers that share the cores of this machine
        self._known: set[str] = set()
        self._number = 0

    def __enter__(self) -> DaskExecutor:
        try:
            from distributed import Client, LocalCluster
        except ImportError:
            raise LookdevError("executor 'dask' needs Dask's distributed: pip install 'lookdev[farm]'") from None

        for name in ("distributed", "tornado.application", "bokeh"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what it reports of lost workers is reported here
        with ExitStack() as stack, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of versions, which are compared here, and of ports
            target: Any = self._address
            if not self._address:
                count = self._count or max(min(cores() // _EACH, free_memory() // _MEMORY), 1)
                self._sharing = count
                cluster = LocalCluster(
                    n_workers=count,
                    threads_per_worker=1,
                    dashboard_address="127.0.0.1:0",
                    memory_limit=0,
                    host="127.0.0.1",
                )
                target = stack.enter_context(cluster)
            try:
                # A client that fails to connect is closed when it is collected, which waits for ever where another
                # one starts meanwhile.
                if self._address:
                    asyncio.run(_reach(self._address))
                client = Client(target, timeout=_CONNECT, set_as_default=False, name="lookdev")
            except ValueError as error:
                raise LookdevError(
                    f"--executor: '{self._address}' is no address of a scheduler of Dask ({error}): write "
                    "dask:tcp://HOST:8786"
                ) from None
            except OSError as error:
                raise WorkerError(
                    f"no scheduler of Dask answers at {self._address}: {_brief(error)}; start one with 'dask scheduler'"
                    ", and workers with 'dask worker ADDRESS --nthreads 1', or check address and firewall"
                ) from None
            self._client = stack.enter_context(client)
            self._client.subscribe_topic(self._topic, self._heard)
            stack.callback(self._cancel)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        with suppress(Exception):  # the cluster may be gone
            self._stack.close()

    def launch(self) -> None:
        """Do nothing: workers start with their first chunk."""

    def prepare(self, scene: SceneTask) -> None:
        """Do nothing: no worker is known to render the scene."""

    def render(self, tasks: Sequence[FrameTask], wanted: Wanted) -> Iterator[Happening]:
        """Render tasks, as the protocol has it."""
        backend = tasks[0].scene.backend
        self._check_versions(backend)
        self._waiting = ChunkShares(tasks, wanted, answered=self._store is None)
        self._by_digest.update({task.digest: task for task in tasks})
        self._order = Order(
            b"",
            backend,
            versions(backend),
            self._topic,
            self._place.patience,
            self._store,
            self._shared_mark(),
            self._command,
            self._sharing,
        )
        met, looked = time.monotonic(), -math.inf
        while True:
            if time.monotonic() > looked + _LOOK:
                looked = time.monotonic()
                crowd = self._crowd()
                met = looked if crowd else met
                if looked > met + _LONELY:
                    met = looked
                    yield Remarked(f"{self._where} has no worker: frames wait for one")
                gone, self._known = self._known - set(crowd), set(crowd)
                for worker in gone:
                    self._waiting.leave(worker)
                # By itself the scheduler keeps them for a worker of the same address, if no other is there.
                for chunk in [each for each in self._in_flight if each.worker in gone]:
                    self._in_flight.discard(chunk)
                    chunk.future.cancel(force=True)
                    yield from self._rendered_again(chunk, f"worker {chunk.worker} was lost")
            self._feed(crowd)
            if not self._in_flight:
                return
            try:
                arrived = self._arrived.get(timeout=_LOOK)
            except queue.Empty:
                continue
            if not isinstance(arrived, _Chunk):
                yield arrived
            elif arrived in self._in_flight:
                self._in_flight.discard(arrived)
                yield from self._take(arrived)

    def _feed(self, crowd: Sequence[str]) -> None:
        """Give each worker chunks until it has enough; without a worker, let one wait for the first."""
        given = Counter(chunk.worker for chunk in self._in_flight)
        for worker in crowd:
            while given[worker] < _AHEAD and (frames := self._waiting.chunk(worker, len(crowd))):
                self._submit(_Chunk(frames, worker))
                given[worker] += 1
        if not crowd and not self._in_flight and (frames := self._waiting.chunk("", 1)):
            self._waiting.leave("")
            self._submit(_Chunk(frames))

    @property
    def _topic(self) -> str:
        return f"lookdev-{self._run}"

    def _shared_mark(self) -> Path | None:
        """Return a file in the output folder, by which workers know that they have the same."""
        if self._store is None:
            return None
        mark = self._place.scratch / f"shared-{self._run}"
        mark.touch()
        return mark

    def _submit(self, chunk: _Chunk) -> None:
        self._number += 1
        chunk.future = self._client.submit(
            render_order,
            replace(self._order, frames=pickle.dumps(chunk.tasks)),
            key=f"lookdev-{self._run}-{self._number}",
            workers=[chunk.worker] if chunk.worker else None,
            priority=-self._number,
            pure=False,
        )
        self._in_flight.add(chunk)
        chunk.future.add_done_callback(lambda _: self._arrived.put(chunk))

    def _take(self, chunk: _Chunk) -> Iterator[Happening]:
        """Take what came of a chunk."""
        if chunk.future.status in ("cancelled", "lost"):
            raise WorkerError(f"{self._where} has dropped the run; run the same command again to continue")
        result: Any
        try:
            result = self._result_of(chunk)
        except Exception as error:  # noqa: BLE001  whatever the worker raised, or Dask of lost workers
            yield from self._rendered_again(chunk, _brief(error))
            return
        match result:
            case Lacks(worker, files):
                if worker in chunk.sent:
                    raise WorkerError(f"worker {worker} lacks {files[0].digest}{files[0].suffix}, which it was sent")
                self._send(worker, files)
                chunk.sent.add(worker)
                chunk.worker = worker
                self._submit(chunk)
            case Unfit(worker, reason):
                yield from self._leave_out(worker, reason)
                fit = sorted(set(self._addresses()) - self._unfit.keys())
                if not fit:
                    raise WorkerError(f"no worker of {self._where} can render: {reason}")
                chunk.worker = fit[self._number % len(fit)]
                self._submit(chunk)
            case Unwritable(reason):
                raise OutputError(reason)
            case Answers(worker, answers):
                self._feed(sorted(self._known - self._unfit.keys()))
                for answer in answers:
                    task = chunk.tasks[answer.number]
                    if isinstance(answer.made, str):
                        yield GivenUp(task, answer.made, None)
                    else:
                        self._waiting.measured(task, answer.seconds, worker)
                        yield Finished(task, answer.made, answer.seconds)

    def _result_of(self, chunk: _Chunk) -> Any:
        """Return the result of a chunk; raises TimeoutError where it does not come, soon where its worker is lost."""
        deadline = time.monotonic() + _CONNECT
        while True:
            try:
                return chunk.future.result(timeout=_LOOK)
            except TimeoutError:
                # Where Dask chose the worker, nobody here knows which.
                if chunk.worker and chunk.worker not in self._addresses():
                    raise TimeoutError(f"worker {chunk.worker} was lost with its result") from None
                if time.monotonic() > deadline:
                    raise TimeoutError(f"{chunk.worker or self._where} does not send a result") from None

    def _rendered_again(self, chunk: _Chunk, reason: str) -> Iterator[Happening]:
        """Render the frames of a chunk that was lost, each by itself if one was at work; give up those lost often."""
        at_work = any(task.digest in self._started for task in chunk.tasks)
        yield Remarked(f"{len(chunk.tasks)} frames go to another worker: {reason}")
        apart = [[task] for task in chunk.tasks] if at_work else [chunk.tasks]
        for tasks in apart:
            losses = chunk.losses + any(task.digest in self._started for task in tasks)
            self._started.difference_update(task.digest for task in tasks)
            if losses >= CRASH_TRIES:
                yield GivenUp(tasks[0], f"{reason}, {losses} times", None)
            else:
                self._submit(_Chunk(tasks, losses=losses))

    def _leave_out(self, worker: str, reason: str) -> Iterator[Happening]:
        """Give nothing more to a worker."""
        if worker not in self._unfit:
            self._unfit[worker] = reason
            yield Remarked(f"left out: {reason}")

    def _send(self, worker: str, files: Sequence[Content]) -> None:
        """Send files to the content store of a worker, in pieces; raises OutputError where it cannot keep them."""
        for file in files:
            size = file.path.stat().st_size
            with file.path.open("rb") as stream:
                for offset in range(0, max(size, 1), _PIECE):
                    piece, last = stream.read(_PIECE), offset + _PIECE >= size
                    name = f"{file.digest}{file.suffix}"
                    answers = self._client.run(receive, name, file.digest, offset, piece, last, workers=[worker])
                    if any(answers.values()):
                        raise OutputError(f"worker {worker} cannot keep a file: {answers[worker]}")

    def _check_versions(self, backend: str) -> None:
        """Raise WorkerError where workers that are there have other versions than this process."""
        try:
            found = self._client.run(worker_versions, backend, on_error="return")
        except Exception as error:
            raise WorkerError(f"{self._where} does not answer: {_brief(error)}") from error
        problems = []
        for worker, theirs in found.items():
            if isinstance(theirs, Exception):
                problems.append(
                    f"worker {worker} has no lookdev of this version: {_brief(theirs)}; install it in the environment "
                    "of all workers: pip install 'lookdev[farm]'"
                )
            elif problem := mismatch(versions(backend), theirs, f"worker {worker}"):
                problems.append(problem)
        if problems:
            raise WorkerError("\n".join(problems))

    def _crowd(self) -> list[str]:
        """Return the workers that are fit; raises WorkerError where the scheduler has gone."""
        if self._client.status != "running":
            raise WorkerError(
                f"the connection to {self._where} is lost; frames that are done are kept: run the same command again"
            )
        return [address for address in self._addresses() if address not in self._unfit]

    def _addresses(self) -> list[str]:
        try:
            return list(self._client.nthreads())
        except Exception as error:
            raise WorkerError(f"{self._where} does not answer: {_brief(error)}; run the same command again") from error

    @property
    def _where(self) -> str:
        return f"the scheduler {self._address}" if self._address else "the cluster of Dask on this machine"

    def _heard(self, event: tuple[float, Any]) -> None:
        """Take an event that a worker sends while it renders."""
        what = {key: value for key, value in event[1].items() if key != "worker"}  # which Dask adds
        task = self._by_digest.get(what.pop("digest", ""))
        if task is None:
            return
        if "started" in what:
            self._started.add(task.digest)
            self._arrived.put(Started(task))
        elif "reason" in what:
            self._arrived.put(Retried(task, **what))
        else:
            self._arrived.put(Progressed(task, Progress(type="progress", digest=task.digest, **what)))

    def _cancel(self) -> None:
        """Cancel what is in flight: workers stop their renderers when they see it."""
        futures = [chunk.future for chunk in self._in_flight]
        self._in_flight.clear()
        if futures:
            with suppress(Exception):
                self._client.cancel(futures, force=True)


async def _reach(address: str) -> None:
    """Raise ValueError where an address is malformed, OSError where no scheduler answers there."""
    from distributed.comm import connect
    from distributed.security import Security

    comm = await connect(address, timeout=_CONNECT, **Security().get_connection_args("client"))
    await comm.close()


def _brief(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__
