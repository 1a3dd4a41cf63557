"""Reads the text that Blender and its libraries print. It is the only sign of some errors."""

from __future__ import annotations

import ctypes
import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

import bpy

from lookdev.cycles import engine
from lookdev.errors import RenderError

Result = TypeVar("Result")

# Cycles logs this message for a shader that is too large for the stack of SVM, its virtual machine for shader nodes.
_OVERFLOW = re.compile(r"out of SVM stack space, shader \"(?P<material>[^\"]*)\"", re.IGNORECASE)


def capture_output(action: Callable[[], Result]) -> tuple[Result, str]:
    """Run an action; return its result, and the text that it writes to standard output and standard error.

    Both are captured, because Blender 4.5 logs to standard error, and Blender 5.2 logs to standard output. Afterwards,
    the text is written to standard error.
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


def check_svm_stack(scene: bpy.types.Scene) -> None:
    """Compile the shaders of a scene, and check that each fits into the stack of SVM, Cycles' machine for shader nodes.

    Cycles itself only logs a message for a shader that does not fit.

    Raises
    ------
    RenderError
        A shader needs more stack than SVM has, so that parts of it would be missing.
    """
    _, log = capture_output(lambda: engine.compile_shaders(scene))
    names = list(dict.fromkeys(match["material"] for match in _OVERFLOW.finditer(log)))
    if names:
        looks = ", ".join(f"'{name}'" for name in names)
        raise RenderError(
            f"look {looks}: its nodes need more numbers at once than Cycles' node machine has room for; "
            'give it fewer layers, masks or textures, or render it with backend = "exact"'
        )


def _flush() -> None:
    """Write the buffers of the streams of Python and C."""
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL(None).fflush(None)
