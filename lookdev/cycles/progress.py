"""Reports the progress within a render of Cycles, by the text of Blender's render statistics."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from lookdev.rendering.frame import ReportSamples

_SAMPLE = re.compile(r"\bSample (\d+)/\d+")  # in the text of the statistics, as "Sample 16/64"


@contextmanager
def refine_progress(samples: int, report: ReportSamples) -> Iterator[ReportSamples]:
    """Yield a function that `render_frame` calls with its progress, in a frame of at most `samples` samples.

    The function passes its calls on to `report`. In between, `report` is called with the samples that Cycles states in
    its statistics. Cycles updates these about every half minute, so long renders report progress that often.
    """
    done, total, error = 0, samples, None  # the arguments of the latest call of the yielded function

    def update(now_done: int, now_total: int, relmse: float | None) -> None:
        nonlocal done, total, error
        done, total, error = now_done, now_total, relmse
        report(done, total, error)

    def read(text: str, *_: object) -> None:
        """Report the samples that a text of statistics states; called by a thread of Cycles during a render."""
        if (match := _SAMPLE.search(text)) and 0 < (rendered := int(match[1])) < total - done:
            report(done + rendered, total, error)

    bpy.app.handlers.render_stats.append(read)
    try:
        yield update
    finally:
        bpy.app.handlers.render_stats.remove(read)
