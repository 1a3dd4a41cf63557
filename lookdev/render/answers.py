"""The answering side of a render worker: what it tells its parent, one JSON object a line on standard output.

`lookdev.render.worker` is the other side, and says what each answer must have.
"""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Answers:
    """Standard output, kept for answers: whatever else prints there goes to standard error from now on.

    Make it before anything that prints is loaded.
    """

    def __init__(self) -> None:
        self._channel = os.dup(1)
        os.dup2(2, 1)

    def tell(self, **message: Any) -> None:
        """Send one message."""
        os.write(self._channel, (json.dumps(message) + "\n").encode())

    def ready(self, renderer: str) -> None:
        """Say that frames can be asked for, and what will render them."""
        self.tell(type="ready", blender=renderer)

    def progress(self, digest: str, samples: int, of: int, relmse: float | None) -> None:
        """Say how far the frame of a digest is: samples done, samples planned, and the relMSE so far."""
        self.tell(type="progress", digest=digest, samples=samples, of=of, relmse=relmse)

    def done(self, digest: str, arrays: str, *, samples: int, seconds: float, relmse: float) -> None:
        """Hand over a frame, with the most memory that this process has held.

        Parameters
        ----------
        digest
            The task's.
        arrays
            What `save_arrays` returned.
        samples, seconds, relmse
            Over both halves; the frame's own estimate, or nan.
        """
        self.tell(
            type="done",
            digest=digest,
            arrays=arrays,
            samples=samples,
            seconds=seconds,
            relmse=relmse,
            memory=_most_memory(),
        )

    def failed(self, digest: str, error: Exception) -> None:
        """Say why there is no frame."""
        self.tell(type="failed", digest=digest, message=f"{type(error).__name__}: {error}")


def save_arrays(a: NDArray[np.float32], b: NDArray[np.float32], alpha: NDArray[np.float32]) -> str:
    """Save halves (H, W, 3) and coverage (H, W) to a file in ``TMPDIR``, the parent's to remove; return its path.

    Raises
    ------
    OSError
        It cannot be written.
    """
    handle, path = tempfile.mkstemp(prefix="lookdev-", suffix=".npz", dir=os.environ.get("TMPDIR"))
    with os.fdopen(handle, "wb") as stream:
        np.savez(stream, a=a, b=b, alpha=alpha)
    return path


def _most_memory() -> int:
    """Return the most bytes that this process has held; what getrusage() tells begins with the parent's."""
    status = Path("/proc/self/status").read_text()
    kilobytes = next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:"))
    return 1024 * int(kilobytes)
