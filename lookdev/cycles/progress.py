"""The number of samples done during a render, from the text of Blender's render statistics."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from lookdev.rendering.frame import ReportSamples

_SAMPLE = re.compile(r"\bSample (\d+)/\d+")


@contextmanager
def refine_progress(samples: int, report: ReportSamples) -> Iterator[ReportSamples]:
    """Yield a progress function for `render_frame` of `samples`; `report` gets its calls and others in between.

    Those in between come from Cycles, which updates its statistics about every half minute, so long frames report
    progress that often.
    """
    done, total, error = 0, samples, None

    def update(now_done: int, now_total: int, relmse: float | None) -> None:
        nonlocal done, total, error
        done, total, error = now_done, now_total, relmse
        report(done, total, error)

    def read(text: str, *_: object) -> None:
        # Called by a thread of Cycles while the caller's thread waits for the render.
        if (match := _SAMPLE.search(text)) and 0 < (rendered := int(match[1])) < total - done:
            report(done + rendered, total, error)

    bpy.app.handlers.render_stats.append(read)
    try:
        yield update
    finally:
        bpy.app.handlers.render_stats.remove(read)
