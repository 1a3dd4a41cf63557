"""Executors, which render the frames of a run on this machine or on others; the frames are the same, bit for bit."""

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
