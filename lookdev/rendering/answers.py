"""The answers of a render worker to its parent: one JSON object per line on standard output.

`lookdev.rendering.results` reads them and defines their fields.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from lookdev.arrays import Array, Floats32
from lookdev.cache import output_errors
from lookdev.errors import OutputError

if TYPE_CHECKING:
    from lookdev.rendering.frame import RenderedFrame


class Answers:
    """Standard output, reserved for answers: from construction on, other output goes to standard error."""

    def __init__(self) -> None:
        self._channel = os.dup(1)
        os.dup2(2, 1)

    def send(self, **message: object) -> None:
        """Send one message."""
        os.write(self._channel, (json.dumps(message) + "\n").encode())

    def ready(self, renderer: str) -> None:
        """Report the name and version of the renderer, and that the worker takes tasks."""
        self.send(type="ready", blender=renderer)

    def progress(self, digest: str, samples: int, planned: int, relmse: float | None) -> None:
        """Report the samples rendered, the samples planned, and the relMSE so far of a frame, by its digest."""
        self.send(type="progress", digest=digest, samples=samples, of=planned, relmse=relmse)

    def done(
        self,
        digest: str,
        arrays: str,
        *,
        samples: int,
        seconds: float,
        relmse: float,
        raw_relmse: float | None = None,
        raw_seconds: float | None = None,
        notes: Sequence[str] = (),
    ) -> None:
        """Report a rendered frame, notes for the user, and the peak memory of this process.

        `arrays` is the path that `save_arrays` returns; `samples` and `seconds` are over both halves; `relmse` is the
        estimate, or nan. Of a denoised frame, `raw_relmse` is the relMSE of the raw picture, and `raw_seconds` the time
        without denoising.
        """
        if (raw_relmse is None) != (raw_seconds is None):
            raise ValueError("a denoised frame has the error and the seconds of its raw picture")
        figures = {"samples": samples, "seconds": seconds, "relmse": relmse, "memory": peak_memory()}
        raw = {"raw_relmse": raw_relmse, "raw_seconds": raw_seconds}
        figures |= {name: value for name, value in raw.items() if value is not None}
        self.send(type="done", digest=digest, arrays=arrays, notes=notes, **figures)

    def rendered(self, digest: str, frame: RenderedFrame, notes: Sequence[str] = ()) -> None:
        """Save the arrays of a rendered frame, and report it; raises as `save_arrays`."""
        self.done(
            digest,
            save_arrays(frame.a, frame.b, frame.alpha, frame.raw, frame.passes, frame.names),
            samples=frame.samples,
            seconds=frame.seconds,
            relmse=frame.relmse,
            raw_relmse=frame.raw_relmse,
            raw_seconds=frame.raw_seconds,
            notes=notes,
        )

    def failed(self, digest: str, error: Exception) -> None:
        """Report why a frame cannot be rendered; an OutputError concerns all frames."""
        if isinstance(error, OutputError):
            self.send(type="failed", digest=digest, message=str(error), unwritable=True)
        else:
            self.send(type="failed", digest=digest, message=f"{type(error).__name__}: {error}")


def save_arrays(
    a: Floats32,
    b: Floats32,
    alpha: Floats32,
    raw: Floats32 | None = None,
    passes: Mapping[str, Floats32] = MappingProxyType({}),
    names: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> str:
    """Save halves (H, W, 3) and coverage (H, W) to a file in ``TMPDIR``, which the parent removes; return its path.

    Of a denoised frame, `raw` (H, W, 3) is the picture before denoising. `passes` and `names` are those of
    `RenderedFrame`.

    Raises OutputError where the file cannot be written, and leaves no part of it.
    """
    arrays = {"a": a, "b": b, "alpha": alpha, **({} if raw is None else {"raw": raw})}
    arrays |= {f"pass {name}": pixels for name, pixels in passes.items()}
    texts = {"names": np.frombuffer(json.dumps(dict(names)).encode(), np.uint8)} if names else {}
    return save_named({**arrays, **texts})


def save_named(arrays: Mapping[str, Array]) -> str:
    """Save arrays by name to a file, and return its path, as `save_arrays` does."""
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
