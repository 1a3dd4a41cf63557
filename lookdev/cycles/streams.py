"""What Blender and its libraries print, which is all that they tell of some errors."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

Result = TypeVar("Result")


def captured(action: Callable[[], Result]) -> tuple[Result, str]:
    """Return the result of an action, and the text that it writes to output and error stream.

    The text is written to the error stream afterwards. Blender 4.5 logs to the error stream, 5.2 to the output.
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
