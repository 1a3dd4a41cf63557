"""The cores on which a render process may run: its CPU affinity, which all libraries in the process respect.

Cycles has an option that limits its own threads. That option does not limit the thread pool of TBB, whose idle threads
would then spin, each on a core.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


def usable_cores() -> int:
    """Return the number of cores that this thread, and the processes it starts, may run on."""
    return len(os.sched_getaffinity(0))


def share_of_cores(number: int, workers: int) -> frozenset[int]:
    """Return the cores for one of several workers on this machine: equal shares, at least one core each.

    number : the number of the worker, from 0; workers : how many workers there are.
    """
    usable = sorted(os.sched_getaffinity(0))
    if workers >= len(usable):
        return frozenset({usable[number % len(usable)]})
    return frozenset(usable[number * len(usable) // workers : (number + 1) * len(usable) // workers])


@contextmanager
def pin_to_cores(cores: frozenset[int]) -> Iterator[None]:
    """Restrict this thread, and the processes that it starts in the block, to some cores."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
