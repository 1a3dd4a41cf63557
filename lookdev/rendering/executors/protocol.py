"""The protocol of executors, and the events that they report while they render.

An executor renders the frames of a run on workers, which are processes on this machine or on others.
"""

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
"""The most tries of a frame whose worker dies, hangs or sends an invalid answer: a previous frame may be the cause."""

CLEAN_TRIES = 2
"""The most tries of a frame that a worker reports as failed. Most such errors recur, so more tries would not help."""


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
    """The figures of a frame whose file its worker has written; the fields are as in `WorkerFrame`."""

    samples: int
    relmse: float
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Finished:
    """A frame is rendered.

    `rendered` has the pixels of the frame, or its figures if the worker has written the file. `seconds` is the wall
    time since the frame first went to a worker.
    """

    task: FrameTask
    rendered: WorkerFrame | StoredFrame
    seconds: float


@dataclass(frozen=True)
class GivenUp:
    """A frame failed in all its tries. `log` is the file with the details; None if it is on another machine."""

    task: FrameTask
    reason: str
    log: Path | None


@dataclass(frozen=True)
class ExecutorNote:
    """A note for the user about the execution, such as the loss of a worker."""

    text: str


ExecutorEvent = Started | Progressed | Retried | Finished | GivenUp | ExecutorNote
FrameFilter = Callable[[FrameTask], bool]
"""Returns whether a frame is still to be rendered: another run may have rendered it meanwhile."""

StoreFrame = Callable[[FrameTask, WorkerFrame], StoredFrame]
"""Writes the files of a frame. The function is at the top level of a module, so that it can be pickled and sent."""


class Executor(AbstractContextManager["Executor"], Protocol):
    """Renders frames somewhere; the workers that it starts end with its context."""

    def launch(self) -> None:
        """Start workers without waiting for them. An executor that cannot do this does nothing."""

    def prepare(self, scene: SceneTask) -> None:
        """Prepare for a scene before its first frame, so that frames with the scene's looks start sooner.

        An executor that cannot do this does nothing.
        """

    def render(self, tasks: Sequence[FrameTask], is_needed: FrameFilter) -> Iterator[ExecutorEvent]:
        """Render tasks, all for the same backend, in any order, and yield events.

        `is_needed` is called in this thread just before a frame goes to a worker. A frame for which it returns false is
        left out. Ending the iteration early cancels the frames that are not finished.

        Raises WorkerError where no worker can render, OutputError where a worker cannot write.
        """


@dataclass(frozen=True)
class WorkerFiles:
    """The files of an executor on this machine, and the command and the timeout of its workers."""

    scratch: Path  # an existing folder for temporary files; the caller removes it
    log: Callable[[str], Path]  # returns the file of a worker's log, by the name of the log
    command: tuple[str, ...]  # the program of a worker and its arguments
    timeout: float = ANSWER_TIMEOUT  # seconds without an answer after which a worker counts as hung
