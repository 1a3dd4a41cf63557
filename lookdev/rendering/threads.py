"""The cores of a render process, set by its CPU affinity, which all libraries in it respect.

Cycles has a limit of its own threads, but that does not limit TBB's pool: its idle threads then spin, each on a core.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


def usable_cores() -> int:
    """Return the number of cores that this thread, and the processes it starts, may run on."""
    return len(os.sched_getaffinity(0))


def share_of_cores(number: int, workers: int) -> frozenset[int]:
    """Return the cores of worker `number` (from 0) of `workers` on this machine: equal shares, at least one."""
    usable = sorted(os.sched_getaffinity(0))
    if workers >= len(usable):
        return frozenset({usable[number % len(usable)]})
    return frozenset(usable[number * len(usable) // workers : (number + 1) * len(usable) // workers])


@contextmanager
def pin_to_cores(cores: frozenset[int]) -> Iterator[None]:
    """Restrict the processes that this thread starts in the block to the `allowed` cores."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
