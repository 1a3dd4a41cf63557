"""Check that the shaders of a scene fit Cycles' node machine (SVM), which only logs one that is too big."""

from __future__ import annotations

import ctypes
import os
import re
import sys
import tempfile
from collections.abc import Callable
from typing import Any

from lookdev.cycles import engine
from lookdev.errors import RenderError

_OVERFLOW = re.compile(r"out of SVM stack space, shader \"(?P<material>[^\"]*)\"", re.IGNORECASE)


def check_stack(scene: Any) -> None:
    """Compile the shaders of a scene.

    Raises
    ------
    RenderError
        A shader needs more stack than SVM has: parts of it would be missing.
    """
    log = _captured(lambda: engine.compile_shaders(scene))
    names = list(dict.fromkeys(found["material"] for found in _OVERFLOW.finditer(log)))
    if names:
        looks = ", ".join(f"'{name}'" for name in names)
        raise RenderError(
            f"look {looks}: its nodes need more numbers at once than Cycles' node machine has room for; "
            'give it fewer layers, masks or textures, or render it with backend = "exact"'
        )


def _captured(action: Callable[[], object]) -> str:
    """Return the text that an action writes to output and error stream, and write it to the error stream afterwards.

    Blender 4.5 logs to the error stream, 5.2 to the output.
    """
    with tempfile.TemporaryFile() as log:
        _flush()
        streams = {number: os.dup(number) for number in (1, 2)}
        for number in streams:
            os.dup2(log.fileno(), number)
        try:
            action()
        finally:
            _flush()
            for number, stream in streams.items():
                os.dup2(stream, number)
                os.close(stream)
            log.seek(0)
            text = log.read()
            os.write(2, text)
    return text.decode(errors="replace")


def _flush() -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL(None).fflush(None)
