"""Which cores a render process computes on: by its affinity, which all libraries in it go by.

A limit of Cycles' threads is none of TBB's pool: a thread of it that may not work yields for ever, at up to a core.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


def cores() -> int:
    """Return the cores that this thread, and what it starts, may run on."""
    return len(os.sched_getaffinity(0))


def share_of_cores(number: int, of: int) -> frozenset[int]:
    """Return the cores of worker `number`, from 0, `of` so many on this machine: like parts, of at least one core."""
    each = sorted(os.sched_getaffinity(0))
    if of >= len(each):
        return frozenset({each[number % len(each)]})
    return frozenset(each[number * len(each) // of : (number + 1) * len(each) // of])


@contextmanager
def on_cores(chosen: frozenset[int]) -> Iterator[None]:
    """Let processes that this thread starts in the block run on some cores only."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, chosen)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
