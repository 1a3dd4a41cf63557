"""Samples done during a render, from the text of Blender's render statistics."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from lookdev.rendering.frame import Progress

_SAMPLE = re.compile(r"\bSample (\d+)/\d+")


@contextmanager
def finer_progress(samples: int, report: Progress) -> Iterator[Progress]:
    """Return a `report` for `render_frame` of a frame of `samples`; `report` is also called between its calls.

    Cycles updates its statistics about every half minute, so that long frames report progress as often.
    """
    done, of, error = 0, samples, None

    def take(now_done: int, now_of: int, relmse: float | None) -> None:
        nonlocal done, of, error
        done, of, error = now_done, now_of, relmse
        report(done, of, error)

    def read(text: str, *_: Any) -> None:
        # Called by a thread of Cycles while the caller's thread waits for the render.
        if (found := _SAMPLE.search(text)) and 0 < (more := int(found[1])) < of - done:
            report(done + more, of, error)

    bpy.app.handlers.render_stats.append(read)
    try:
        yield take
    finally:
        bpy.app.handlers.render_stats.remove(read)
