"""The cores of a render process, set by its CPU affinity, which all libraries in it respect.

A limit of Cycles' threads does not limit the pool of TBB, whose idle threads then spin on up to a core each.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


def cores() -> int:
    """Return the number of cores that this thread, and the processes it starts, may run on."""
    return len(os.sched_getaffinity(0))


def share_of_cores(number: int, workers: int) -> frozenset[int]:
    """Return the cores of worker `number` (from 0) of `workers` on this machine: equal shares, at least one."""
    allowed = sorted(os.sched_getaffinity(0))
    if workers >= len(allowed):
        return frozenset({allowed[number % len(allowed)]})
    return frozenset(allowed[number * len(allowed) // workers : (number + 1) * len(allowed) // workers])


@contextmanager
def pin_to_cores(allowed: frozenset[int]) -> Iterator[None]:
    """Restrict the processes that this thread starts in the block to the `allowed` cores."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, allowed)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
