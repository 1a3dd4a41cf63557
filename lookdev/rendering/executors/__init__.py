"""Who renders the frames of a run: workers of this machine, or of a distributed engine; the same frames bit for bit."""

from lookdev.rendering.executors.local import LocalExecutor
from lookdev.rendering.executors.protocol import (
    Executor,
    Finished,
    GivenUp,
    Happening,
    Place,
    Progressed,
    Remarked,
    Retried,
    Started,
    Store,
    Stored,
    Wanted,
)

__all__ = [
    "Executor",
    "Finished",
    "GivenUp",
    "Happening",
    "LocalExecutor",
    "Place",
    "Progressed",
    "Remarked",
    "Retried",
    "Started",
    "Store",
    "Stored",
    "Wanted",
]
