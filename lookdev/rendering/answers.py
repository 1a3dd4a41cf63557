"""The worker's side of its answers: a render worker writes one JSON object per line to standard output.

The worker's parent process reads the answers by `lookdev.rendering.results`, which also defines their fields. The
pixels of a frame go to a file; the answer has the file's path.
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
    """Standard output, reserved for answers.

    Once an object of this class exists, everything else that this process writes to standard output goes to standard
    error.
    """

    def __init__(self) -> None:
        self._channel = os.dup(1)
        os.dup2(2, 1)

    def send(self, **message: object) -> None:
        """Send one message."""
        os.write(self._channel, (json.dumps(message) + "\n").encode())

    def send_ready(self, renderer: str) -> None:
        """Report that the worker takes tasks; `renderer` is Blender's version, or ``"mitsuba"`` and its version."""
        self.send(type="ready", blender=renderer)

    def send_progress(self, digest: str, samples: int, planned: int, relmse: float | None) -> None:
        """Report the progress of a frame: the samples rendered, the samples planned, and the relMSE so far."""
        self.send(type="progress", digest=digest, samples=samples, of=planned, relmse=relmse)

    def send_frame(self, digest: str, frame: RenderedFrame, notes: Sequence[str] = ()) -> None:
        """Save the pixels of a frame and report it, with notes for the user; raises as `send_arrays`."""
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
        """Save arrays by name to a file in ``TMPDIR``, and report the file's path, the figures and the peak memory.

        The parent removes the file. If the file cannot be written, raises OutputError, and leaves no part of the file.
        """
        self.send(type="done", digest=digest, arrays=save_arrays(arrays), memory=peak_memory(), **figures)

    def send_failure(self, digest: str, error: Exception) -> None:
        """Report why a frame cannot be rendered.

        An OutputError, for example because of a full disk, is marked as `unwritable`: it would also stop all other
        frames.
        """
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
    """Return the peak resident memory of a process in bytes. (getrusage() would include the parent's memory.)

    `process` is the id of the process.
    """
    status = Path(f"/proc/{process}/status").read_text()
    kilobytes = next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:"))
    return 1024 * int(kilobytes)
