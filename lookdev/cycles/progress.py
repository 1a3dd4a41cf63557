"""Samples done while a render is still going on: Blender says them in the text of its render statistics."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from lookdev.cycles.render import Progress

_SAMPLE = re.compile(r"\bSample (\d+)/\d+")


@contextmanager
def finer_progress(samples: int, tell: Progress) -> Iterator[Progress]:
    """Give what `render_frame` is to tell of a frame of `samples`; `tell` hears of samples between its calls too.

    Cycles speaks up every half minute or so: a frame that takes many is told of, and never silent for long.
    """
    done, of, error = 0, samples, None

    def take(now_done: int, now_of: int, relmse: float | None) -> None:
        nonlocal done, of, error
        done, of, error = now_done, now_of, relmse
        tell(done, of, error)

    def overhear(text: str, *_: Any) -> None:
        # Called by a thread of Cycles, while the caller's waits for the render.
        if (found := _SAMPLE.search(text)) and 0 < (more := int(found[1])) < of - done:
            tell(done + more, of, error)

    bpy.app.handlers.render_stats.append(overhear)
    try:
        yield take
    finally:
        bpy.app.handlers.render_stats.remove(overhear)
