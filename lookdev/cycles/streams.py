"""The text that Blender and its libraries print, which is the only sign of some errors."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

Result = TypeVar("Result")


def capture_output(action: Callable[[], Result]) -> tuple[Result, str]:
    """Run an action; return its result and the text that it writes to standard output and standard error.

    The text is then written to standard error. Blender 4.5 logs to standard error, 5.2 to standard output.
    """
    with os.fdopen(os.memfd_create("log"), "w+b") as log:
        _flush()
        streams = {number: os.dup(number) for number in (1, 2)}
        for number in streams:
            os.dup2(log.fileno(), number)
        try:
            result = action()
        finally:
            _flush()
            for number, stream in streams.items():
                os.dup2(stream, number)
                os.close(stream)
            log.seek(0)
            text = log.read()
            with suppress(OSError):  # the log is on a full disk
                os.write(2, text)
    return result, text.decode(errors="replace")


def _flush() -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL(None).fflush(None)
