"""The answers of a render worker to its parent: one JSON object per line on standard output.

`lookdev.rendering.results` reads them and defines their fields.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lookdev.arrays import Elements
from lookdev.cache import output_errors
from lookdev.errors import OutputError

if TYPE_CHECKING:
    from lookdev.rendering.frame import RenderedFrame


class AnswerStream:
    """Standard output, reserved for answers: from construction on, other output goes to standard error."""

    def __init__(self) -> None:
        self._channel = os.dup(1)
        os.dup2(2, 1)

    def send(self, **message: object) -> None:
        """Send one message."""
        os.write(self._channel, (json.dumps(message) + "\n").encode())

    def send_ready(self, renderer: str) -> None:
        """Report the name and version of the renderer, and that the worker takes tasks."""
        self.send(type="ready", blender=renderer)

    def send_progress(self, digest: str, samples: int, planned: int, relmse: float | None) -> None:
        """Report the samples rendered, the samples planned, and the relMSE so far of a frame, by its digest."""
        self.send(type="progress", digest=digest, samples=samples, of=planned, relmse=relmse)

    def send_frame(self, digest: str, frame: RenderedFrame, notes: Sequence[str] = ()) -> None:
        """Report a frame, with notes for the user; raises as `send_arrays`."""
        arrays: dict[str, Elements] = {"a": frame.a, "b": frame.b, "alpha": frame.alpha}
        arrays |= {f"pass {name}": pixels for name, pixels in frame.passes.items()}
        figures = {"samples": frame.samples, "seconds": frame.seconds, "relmse": frame.relmse, "notes": notes}
        if frame.raw is not None:
            arrays["raw"] = frame.raw
            figures |= {"raw_relmse": frame.raw_relmse, "raw_seconds": frame.raw_seconds}
        if frame.names:
            arrays["names"] = np.frombuffer(json.dumps(dict(frame.names)).encode(), np.uint8)
        self.send_arrays(digest, arrays, **figures)

    def send_arrays(self, digest: str, arrays: Mapping[str, Elements], **figures: object) -> None:
        """Save arrays in ``TMPDIR``, whose files the parent removes, and report them, figures, and the peak memory.

        Raises OutputError where the file cannot be written, and leaves no part of it.
        """
        self.send(type="done", digest=digest, arrays=save_arrays(arrays), memory=peak_memory(), **figures)

    def send_failure(self, digest: str, error: Exception) -> None:
        """Report why a frame cannot be rendered; an OutputError concerns all frames."""
        if isinstance(error, OutputError):
            self.send(type="failed", digest=digest, message=str(error), unwritable=True)
        else:
            self.send(type="failed", digest=digest, message=f"{type(error).__name__}: {error}")


def save_arrays(arrays: Mapping[str, Elements]) -> str:
    """Save arrays by name to a file in ``TMPDIR``, and return its path; raises as `AnswerStream.send_arrays`."""
    folder = os.environ.get("TMPDIR") or tempfile.gettempdir()
    with output_errors(Path(folder), "a rendered frame cannot be written"):
        handle, path = tempfile.mkstemp(prefix="lookdev-", suffix=".npz", dir=folder)
        try:
            with os.fdopen(handle, "wb") as stream:
                np.savez(stream, **arrays)
        except OSError:
            Path(path).unlink()
            raise
    return path


def peak_memory(process: str = "self") -> int:
    """Return the peak memory of a process (its number) in bytes; getrusage() would include the parent's."""
    status = Path(f"/proc/{process}/status").read_text()
    kilobytes = next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:"))
    return 1024 * int(kilobytes)
