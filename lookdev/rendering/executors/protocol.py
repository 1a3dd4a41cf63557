"""The protocol of executors, which render frame tasks somewhere, and the events that they report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from lookdev.rendering.results import ProgressMessage, WorkerFrame
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.rendering.worker import ANSWER_TIMEOUT

CRASH_TRIES = 3
"""Tries of a frame whose worker dies, hangs or sends an invalid answer: the previous frame may be the cause."""

CLEAN_TRIES = 2
"""Tries of a frame that the worker reports as failed: most such errors recur."""


@dataclass(frozen=True)
class Started:
    """A frame goes to a worker."""

    task: FrameTask


@dataclass(frozen=True)
class Progressed:
    """A worker reports samples of a frame."""

    task: FrameTask
    progress: ProgressMessage


@dataclass(frozen=True)
class Retried:
    """A try of a frame failed; try number `attempt` (from 2) of at most `attempts` begins."""

    task: FrameTask
    reason: str
    attempt: int
    attempts: int


@dataclass(frozen=True)
class StoredFrame:
    """The figures of a frame whose file its worker has written."""

    samples: int
    relmse: float
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Finished:
    """A frame is rendered.

    `rendered` has its pixels, or the figures of its file; `seconds` is the wall time since it first went to a worker.
    """

    task: FrameTask
    rendered: WorkerFrame | StoredFrame
    seconds: float


@dataclass(frozen=True)
class GivenUp:
    """A frame failed in all its tries; `log` is the file with the details, if it is on this machine."""

    task: FrameTask
    reason: str
    log: Path | None


@dataclass(frozen=True)
class ExecutorNote:
    """A note for the user on the execution, such as the loss of a worker."""

    text: str


ExecutorEvent = Started | Progressed | Retried | Finished | GivenUp | ExecutorNote
FrameFilter = Callable[[FrameTask], bool]
StoreFrame = Callable[[FrameTask, WorkerFrame], StoredFrame]
"""Writes the file of a frame. A function of a module, so that it can be pickled to other machines."""


class Executor(AbstractContextManager["Executor"], Protocol):
    """Renders frames somewhere; the workers that it starts end with its context."""

    def launch(self) -> None:
        """Start workers without waiting for them, if the executor can."""

    def prepare(self, scene: SceneTask) -> None:
        """Take a scene ahead of its frames, so that frames of its looks start sooner, if the executor can."""

    def render(self, tasks: Sequence[FrameTask], is_needed: FrameFilter) -> Iterator[ExecutorEvent]:
        """Render tasks of one backend, in any order, and yield events.

        `is_needed` is called in this thread just before a frame goes to a worker; a frame for which it returns false is
        left out. Ending the iteration early cancels the frames that are not finished.

        Raises WorkerError where no worker can render, OutputError where a worker cannot write.
        """


@dataclass(frozen=True)
class WorkerFiles:
    """The files of an executor on this machine, and the command and the timeout of its workers."""

    scratch: Path  # an existing folder; the caller removes it
    log: Callable[[str], Path]  # returns the file of a log, by its name
    command: tuple[str, ...]
    timeout: float = ANSWER_TIMEOUT
