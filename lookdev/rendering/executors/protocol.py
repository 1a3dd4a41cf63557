"""What an executor is: it renders frame tasks somewhere, and reports what happens to each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from lookdev.rendering.results import Progress, Rendered
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.rendering.worker import PATIENCE

CRASH_TRIES = 3
"""Tries of a frame whose worker dies, hangs or sends no valid answer: the frame before may be the cause."""

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
    progress: Progress


@dataclass(frozen=True)
class Retried:
    """A try of a frame failed; try number `attempt` (from 2) of at most `attempts` begins."""

    task: FrameTask
    reason: str
    attempt: int
    attempts: int


@dataclass(frozen=True)
class Stored:
    """What is known of a frame whose file its worker has written."""

    samples: int
    relmse: float
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Finished:
    """A frame is rendered, `seconds` of wall time after it first went to a worker: pixels, or what is known of them."""

    task: FrameTask
    rendered: Rendered | Stored
    seconds: float


@dataclass(frozen=True)
class GivenUp:
    """A frame failed in all its tries; `log` has the details, if there is one on this machine."""

    task: FrameTask
    reason: str
    log: Path | None


@dataclass(frozen=True)
class Remarked:
    """A note on the execution for the user, as on a worker that was lost."""

    text: str


Happening = Started | Progressed | Retried | Finished | GivenUp | Remarked
Wanted = Callable[[FrameTask], bool]
Store = Callable[[FrameTask, Rendered], Stored]
"""Writes the file of a frame; a function of a module, so that other machines find it."""


class Executor(AbstractContextManager["Executor"], Protocol):
    """Renders frames somewhere; what it started ends with its context."""

    def launch(self) -> None:
        """Start what renders, if that serves, without waiting for it."""

    def prepare(self, scene: SceneTask) -> None:
        """Take a scene ahead of its frames, if that serves, so that frames of its looks start sooner."""

    def render(self, tasks: Sequence[FrameTask], wanted: Wanted) -> Iterator[Happening]:
        """Render tasks, of one backend, in an order of its own, and yield what happens.

        `wanted` is asked in this thread just before a frame is given away; one that is not wanted any more is left
        out. Ending the iteration early cancels what is not finished.

        Raises WorkerError where nothing renders, OutputError where a worker cannot write.
        """


@dataclass(frozen=True)
class Place:
    """Where an executor keeps its files on this machine, and what describes its workers."""

    scratch: Path  # an existing folder, which the caller removes
    log: Callable[[str], Path]  # the file of a log, by the name of what it is of
    command: tuple[str, ...]
    patience: float = PATIENCE
