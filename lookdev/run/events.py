"""The events of a run, reported while it runs.

A frame has a name, ``look/ibl/turntable.0001``, and an id: its digest, as in its plan, its worker's log and its EXR.
The log in JSON names an event by its class: `lookdev.run.progress.JsonReport`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path


class LogFormat(StrEnum):
    """The format in which a run writes its events; `OPENJD` adds messages to a session of Open Job Description."""

    TEXT = "text"
    JSON = "json"
    OPENJD = "openjd"


@dataclass(frozen=True)
class Noted:
    """A note on the input for the user, such as repaired texels of a light."""

    text: str


@dataclass(frozen=True)
class RunJoined:
    """A run joins the runs of an output folder. `run` is its id, `plan` its plan's digest, `chunk` "" or as 2/8."""

    run: str
    chunk: str
    plan: str


@dataclass(frozen=True)
class RunEnded:
    """A run ended: of `total` frames, `done` are on disk; the run `rendered` some of them."""

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
class FrameEvent:
    """An event of a frame."""

    name: str
    id: str = field(default="", kw_only=True)


@dataclass(frozen=True)
class FrameStarted(FrameEvent):
    """A frame goes to the worker."""


@dataclass(frozen=True)
class FrameProgressed(FrameEvent):
    """`samples` of at most `of` per pixel are rendered; `relmse` is None until both halves have samples."""

    samples: int
    of: int
    relmse: float | None


@dataclass(frozen=True)
class FrameDone(FrameEvent):
    """A frame is on disk. `seconds` are its wall time, including all its tries."""

    seconds: float
    samples: int
    relmse: float


@dataclass(frozen=True)
class FrameRetried(FrameEvent):
    """A try of a frame failed; try number `attempt` (from 2) of at most `attempts` begins."""

    reason: str
    attempt: int
    attempts: int


@dataclass(frozen=True)
class FrameFound(FrameEvent):
    """A frame of this run is on disk: another run has rendered it."""


@dataclass(frozen=True)
class FrameFailed(FrameEvent):
    """A frame failed in its last try; the run goes on with the others."""

    reason: str


@dataclass(frozen=True)
class SheetWritten:
    """A contact sheet, or another file of several frames, is on disk."""

    path: Path


Event = Noted | RunJoined | RunStarted | RunEnded | FrameEvent | SheetWritten
ReportEvent = Callable[[Event], None]
