"""Whether Cycles' node machine can hold the shaders of a scene: a line of its log is all it says of one too big."""

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
# Blender renders nothing smaller.
_SIDE = 4


def check_stack(scene: Any) -> None:
    """Render next to nothing of a scene, to compile its shaders; persistent data keeps what that takes for the frames.

    Raises
    ------
    RenderError
        A shader needs more numbers at once than the machine has room for: parts of it would be missing.
    """
    render = scene.render
    size = render.resolution_x, render.resolution_y
    render.resolution_x = render.resolution_y = _SIDE
    try:
        said = _captured(lambda: engine.render_whole(scene, samples=1))
    finally:
        render.resolution_x, render.resolution_y = size
    names = list(dict.fromkeys(found["material"] for found in _OVERFLOW.finditer(said)))
    if names:
        looks = ", ".join(f"'{name}'" for name in names)
        raise RenderError(
            f"look {looks}: its nodes need more numbers at once than Cycles' node machine has room for; "
            'give it fewer layers, masks or textures, or render it with backend = "exact"'
        )


def _captured(action: Callable[[], object]) -> str:
    """Return what an action writes to output and error stream; the latter gets it afterwards.

    Blender 4.5 complains on the error stream, 5.2 on the output.
    """
    with tempfile.TemporaryFile() as heard:
        _flush()
        streams = {number: os.dup(number) for number in (1, 2)}
        for number in streams:
            os.dup2(heard.fileno(), number)
        try:
            action()
        finally:
            _flush()
            for number, stream in streams.items():
                os.dup2(stream, number)
                os.close(stream)
            heard.seek(0)
            said = heard.read()
            os.write(2, said)
    return said.decode(errors="replace")


def _flush() -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL(None).fflush(None)
