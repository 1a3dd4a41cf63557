"""How many threads a render process has: by `THREADS_VARIABLE`, for all that computes in it."""

from __future__ import annotations

import os

THREADS_VARIABLE = "LOOKDEV_THREADS"
"""Environment variable: threads of a render process; without it, one for each core."""


def cores() -> int:
    """Return the cores that this process may run on."""
    return len(os.sched_getaffinity(0))


def given_threads() -> int | None:
    """Return the threads that this process is given; None: as many as there are cores."""
    text = os.environ.get(THREADS_VARIABLE, "")
    return int(text) if text.isdecimal() and int(text) else None
