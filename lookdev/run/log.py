"""Events as lines of JSON, for programs that follow a run.

Each line is an object with ``time`` (UTC), ``level``, ``event``, ``host``, ``process``, the ``run`` and its ``chunk``.
The event of a frame has its name, ``frame``, and its ``id``: the digest of the frame, as in its plan, its worker's log
and its EXR.
"""

from __future__ import annotations

import json
import math
import os
import re
import socket
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TextIO

from lookdev.run.events import Event, FrameFailed, FrameRetried, RunJoined

_LEVELS: dict[type[Event], str] = {FrameFailed: "error", FrameRetried: "warning"}


class JsonReport:
    """A report that writes each event to a stream, at once."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._context: dict[str, object] = {"host": socket.gethostname(), "process": os.getpid()}

    def __call__(self, event: Event) -> None:
        """Write an event as a line."""
        if isinstance(event, RunJoined):
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
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
