"""Shows the progress of a run: a live display in a terminal, plain lines in a log file, or lines of JSON for programs.

A report is a function of an event (`lookdev.run.events`). A run calls it with each event.
"""

from __future__ import annotations

import json
import math
import os
import re
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import fields
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from lookdev.errors import replace_controls
from lookdev.run import events
from lookdev.run.events import Event, LogFormat, ReportEvent

if TYPE_CHECKING:
    from lookdev.fitting.picture.search import LossPoint

_MAX_BARS = 8  # the most frames with a bar of their own in the live display
_LEVELS: dict[type[Event], str] = {events.FrameFailed: "error", events.FrameRetried: "warning"}  # others are "info"


@contextmanager
def show_progress(stream: TextIO, log_format: LogFormat = LogFormat.TEXT) -> Iterator[ReportEvent]:
    """Yield a report that writes to a stream. Text is a live display in a terminal, and a line per event elsewhere."""
    if log_format is LogFormat.JSON:
        yield JsonReport(stream)
    elif log_format is LogFormat.OPENJD:
        yield _OpenJdReport(stream)
    elif stream.isatty():
        name, note = (TextColumn(text, markup=False) for text in ("{task.description}", "{task.fields[note]}"))
        with Progress(name, BarColumn(bar_width=30), note, console=Console(file=stream)) as display:
            yield _LiveReport(display)
    else:
        yield _PlainReport(stream)


@contextmanager
def show_fit(stream: TextIO) -> Iterator[Callable[[LossPoint], None]]:
    """Yield a report of the renders of a fit: a line that changes in a terminal, and nothing elsewhere."""
    counts: Counter[str] = Counter()
    with Console(file=stream).status("reading") if stream.isatty() else nullcontext() as status:

        def report(point: LossPoint) -> None:
            counts[point.stage] += 1
            if status is not None:
                renders = ", ".join(f"{count} {stage}" for stage, count in counts.items())
                status.update(f"difference {100.0 * max(point.loss, 0.0) ** 0.5:.3g} %  ({renders})")

        yield report


class Tally:
    """Counts frames from the events of a run, and writes a line of text for an event."""

    def __init__(self) -> None:
        self.total = 0  # frames in the plan
        self.pending = 0  # frames to render, when the run started
        self.settled = 0  # how many of `pending` are done or failed
        self._started = time.monotonic()

    def count(self, event: Event) -> str | None:
        """Count an event; return its line of text, or None for an event without one, such as progress of a frame."""
        match event:
            case events.Noted():
                return f"note: {event.text}"
            case events.RunStarted():
                self.total, self.pending = event.total, event.pending
                self._started = time.monotonic()
                return f"{event.total} frames, {event.pending} to render"
            case events.FrameDone():
                self.settled += 1
                left = f"  left {left}" if (left := self.time_left()) else ""
                figures = f"{event.seconds:.1f} s  {event.samples} samples  relMSE {event.relmse:.1e}"
                return f"{self._position()} {event.name}  {figures}{left}"
            case events.FrameFound():
                self.settled += 1
                return f"{self._position()} {event.name}  rendered by another run"
            case events.FrameRetried():
                return f"retry {event.attempt}/{event.attempts} {event.name}: {event.reason}"
            case events.FrameFailed():
                self.settled += 1
                return f"{self._position()} {event.name}  FAILED: {event.reason}"
            case events.SheetWritten():
                return f"sheet {event.path}"
            case _:
                return None

    def time_left(self) -> str:
        """Return an estimate of the time left, from the time so far; "" before the first frame and after the last."""
        waiting = self.pending - self.settled
        if not (self.settled and waiting):
            return ""
        return str(timedelta(seconds=round(waiting * (time.monotonic() - self._started) / self.settled)))

    def _position(self) -> str:
        """Return how many frames of the plan are done or failed, as "[3/24]"."""
        return f"[{self.total - self.pending + self.settled}/{self.total}]"


class JsonReport:
    """A report for programs that follow a run: writes each event as a line of JSON at once.

    A line is an object with ``time`` (UTC), ``level``, ``event`` (the name of the event's class in snake case),
    ``host``, ``process``, ``run``, ``chunk``, and the fields of the event. If it is an event of a frame, ``frame`` is
    the frame's name, and ``id`` is its digest, which the plan, the worker's log and the frame's EXR contain, too.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._context: dict[str, object] = {"host": socket.gethostname(), "process": os.getpid()}

    def __call__(self, event: Event) -> None:
        """Write an event as a line."""
        if isinstance(event, events.RunJoined):
            self._context |= {"run": event.run, **({"chunk": event.chunk} if event.chunk else {})}
        values = {("frame" if key.name == "name" else key.name): getattr(event, key.name) for key in fields(event)}
        line = {
            "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
            "level": _LEVELS.get(type(event), "info"),
            "event": re.sub(r"(?<!^)(?=[A-Z])", "_", type(event).__name__).lower(),
            **self._context,
            **values,
        }
        self._stream.write(json.dumps({key: _plain(value) for key, value in line.items()}) + "\n")
        self._stream.flush()


def _plain(value: Any) -> Any:
    """Return a value that JSON can have: None for nan and infinity, text for a path."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


class _PlainReport:
    """A report that writes a line of text for each event."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._tally = Tally()

    def __call__(self, event: Event) -> None:
        if (line := self._tally.count(event)) is not None:
            self._stream.write(replace_controls(line) + "\n")
            self._stream.flush()  # so that a user can follow the log file during the run


class _OpenJdReport(_PlainReport):
    """A plain report with messages of Open Job Description: percent of the frames, status and failures."""

    def __call__(self, event: Event) -> None:
        super().__call__(event)
        tally = self._tally
        if isinstance(event, events.FrameFailed):
            self._send("fail", f"{event.name}: {event.reason}")
        if isinstance(event, events.FrameStarted):
            self._send("status", f"rendering {event.name}, {tally.settled} of {tally.pending} frames are done")
        if isinstance(event, events.RunStarted | events.FrameDone | events.FrameFailed | events.FrameFound):
            self._send("progress", f"{100.0 * tally.settled / tally.pending if tally.pending else 100.0:.1f}")

    def _send(self, kind: str, text: str) -> None:
        """Write a message of Open Job Description, which is a line that begins with its kind."""
        self._stream.write(f"openjd_{kind}: {' '.join(replace_controls(text).split())}\n")
        self._stream.flush()


class _LiveReport:
    """A report as a live display: the lines of events, a bar for all frames, and a bar for each frame in work.

    The bar of a frame shows how many of its samples are rendered.
    """

    def __init__(self, display: Progress) -> None:
        self._display = display
        self._tally = Tally()
        self._frames = display.add_task("frames", total=None, note="")
        self._rendering: dict[str, TaskID] = {}  # the bar of each frame in work, by the frame's name

    def __call__(self, event: Event) -> None:
        tally = self._tally
        if (line := tally.count(event)) is not None:
            self._display.console.print(replace_controls(line), markup=False, highlight=False, soft_wrap=True)
        match event:
            case events.FrameStarted() if len(self._rendering) < _MAX_BARS:
                bar = self._display.add_task(replace_controls(event.name), total=None, note="starting")
                self._rendering[event.name] = bar
            case events.FrameProgressed() if (task := self._rendering.get(event.name)) is not None:
                error = "" if event.relmse is None else f"  relMSE {event.relmse:.1e}"
                note = f"{event.samples}/{event.of} samples{error}"
                self._display.update(task, completed=event.samples, total=event.of, note=note)
            case events.RunStarted() | events.FrameDone() | events.FrameFound() | events.FrameFailed():
                ended = tally.total - tally.pending + tally.settled
                left = tally.time_left()
                note = f"{ended}/{tally.total}" + (f"  left {left}" if left else "")
                self._display.update(self._frames, completed=ended, total=tally.total, note=note)
                if not isinstance(event, events.RunStarted) and event.name in self._rendering:
                    self._display.remove_task(self._rendering.pop(event.name))
