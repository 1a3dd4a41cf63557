"""The events that a run reports to its caller while it renders, such as a finished frame.

`lookdev.run.progress` shows or logs them. A frame has a name, such as ``look/ibl/turntable.0001``, and an id. The id is
the frame's digest, which the plan, the worker's log and the frame's EXR contain, too. In a JSON log, an event has the
name of its class, so renaming a class changes the log.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path


class LogFormat(StrEnum):
    """The format in which a run writes its events. `OPENJD` is text with the messages of Open Job Description."""

    TEXT = "text"
    JSON = "json"
    OPENJD = "openjd"


@dataclass(frozen=True)
class Noted:
    """A note for the user, for example about repaired texels of a light."""

    text: str


@dataclass(frozen=True)
class RunJoined:
    """A run joins the runs that render to an output folder."""

    run: str  # the id of the run
    chunk: str  # the chunk that it renders, such as "2/8"; "" for all frames
    plan: str  # the digest of its plan


@dataclass(frozen=True)
class RunEnded:
    """A run ended. All numbers count frames."""

    total: int  # in the run's plan
    done: int  # on disk
    rendered: int  # by this run
    failed: int
    missing: int  # not found on disk, by a run that renders nothing
    interrupted: bool  # by Ctrl-C


@dataclass(frozen=True)
class RunStarted:
    """A run starts. Its plan has `total` frames, of which `pending` are to be rendered."""

    total: int
    pending: int


@dataclass(frozen=True)
class FrameEvent:
    """An event of the frame with this name and id."""

    name: str
    id: str = field(default="", kw_only=True)


@dataclass(frozen=True)
class FrameStarted(FrameEvent):
    """A frame goes to a worker."""


@dataclass(frozen=True)
class FrameProgressed(FrameEvent):
    """Further samples of a frame are rendered."""

    samples: int  # per pixel, so far
    of: int  # the most samples per pixel that the frame may take
    relmse: float | None  # the estimated error; None until both halves of the frame have samples


@dataclass(frozen=True)
class FrameDone(FrameEvent):
    """A frame of this run is rendered and on disk. `seconds` is its wall time, including all tries."""

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
    """A frame that this run was to render is on disk, because another run has rendered it."""


@dataclass(frozen=True)
class FrameFailed(FrameEvent):
    """A frame failed in its last try. The run continues with the other frames."""

    reason: str


@dataclass(frozen=True)
class SheetWritten:
    """A contact sheet, or another file of several frames, is on disk."""

    path: Path


Event = Noted | RunJoined | RunStarted | RunEnded | FrameEvent | SheetWritten
ReportEvent = Callable[[Event], None]
"""A function that is called with each event of a run."""
