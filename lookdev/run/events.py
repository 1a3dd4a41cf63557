"""What happens during a run, reported as it happens.

A frame has a name, ``look/ibl/turntable.0001``, and an id: its digest, in its plan, its worker's log and its EXR too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path


class LogFormat(StrEnum):
    """How a run writes what happens; as `OPENJD`, some lines are messages to a session of Open Job Description."""

    TEXT = "text"
    JSON = "json"
    OPENJD = "openjd"


@dataclass(frozen=True)
class Noted:
    """A note on the input for the user, such as repaired texels of a light."""

    text: str


@dataclass(frozen=True)
class RunJoined:
    """A run, by its id, has joined those of the output folder to render a plan, by its digest, or a chunk of it."""

    run: str
    chunk: str
    plan: str


@dataclass(frozen=True)
class RunEnded:
    """A run has ended: of `total` frames, `done` are on disk, `rendered` of them by it."""

    total: int
    done: int
    rendered: int
    failed: int
    missing: int
    interrupted: bool


@dataclass(frozen=True)
class RunStarted:
    """A run of `total` frames starts; `pending` of them are to be rendered."""

    total: int
    pending: int


@dataclass(frozen=True)
class FrameStarted:
    """A frame goes to the worker."""

    name: str
    id: str = ""


@dataclass(frozen=True)
class FrameProgressed:
    """`samples` of at most `of` per pixel are rendered; `relmse` is None until both halves have some."""

    name: str
    samples: int
    of: int
    relmse: float | None
    id: str = ""


@dataclass(frozen=True)
class FrameDone:
    """A frame is on disk. `seconds` of wall time, all its tries included."""

    name: str
    seconds: float
    samples: int
    relmse: float
    id: str = ""


@dataclass(frozen=True)
class FrameRetried:
    """A try of a frame failed; try number `attempt` (from 2) of at most `attempts` begins."""

    name: str
    reason: str
    attempt: int
    attempts: int
    id: str = ""


@dataclass(frozen=True)
class FrameFound:
    """A frame that was to be rendered is on disk: another run has rendered it."""

    name: str
    id: str = ""


@dataclass(frozen=True)
class FrameFailed:
    """A frame is given up; the rest of the batch goes on."""

    name: str
    reason: str
    id: str = ""


@dataclass(frozen=True)
class SheetWritten:
    """A contact sheet was made."""

    path: Path


Event = (
    Noted
    | RunJoined
    | RunStarted
    | RunEnded
    | FrameStarted
    | FrameProgressed
    | FrameDone
    | FrameFound
    | FrameRetried
    | FrameFailed
    | SheetWritten
)
Report = Callable[[Event], None]
