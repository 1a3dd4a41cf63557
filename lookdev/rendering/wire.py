"""The input of a worker process: tasks as lines of JSON.

All workers take frames; some take scenes ahead of their frames, or pictures with derivatives.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
from collections.abc import Iterable
from contextlib import suppress

from pydantic import TypeAdapter, ValidationError

from lookdev.errors import RenderError, WorkerError
from lookdev.rendering.derivatives import DerivativeTask
from lookdev.rendering.task import FrameTask, SceneTask

WorkerTask = FrameTask | SceneTask | DerivativeTask

_TASK: TypeAdapter[WorkerTask] = TypeAdapter(WorkerTask)


_CANCEL = "cancel "
"""Begins a line that is not a task: the digest of the frame to cancel follows."""

_MAX_WAIT = 1.0  # seconds

_TASK_NAMES = {SceneTask: "scene task", DerivativeTask: "picture with derivatives"}


def encode_task(task: WorkerTask) -> str:
    """Return a task as one line of JSON, without the line's end; floats survive exactly."""
    return _TASK.dump_json(task).decode()


def decode_frame_task(line: str) -> FrameTask:
    """Return the frame task of a line of `encode_task`; raises WorkerError as `decode_task`, and for another task."""
    task = decode_task(line)
    if not isinstance(task, FrameTask):
        raise WorkerError(
            f"the line is a {_TASK_NAMES[type(task)]}, not a frame task: the worker's backend is not sent any"
        )
    return task


def decode_task(line: str) -> WorkerTask:
    """Return the task of a line of `encode_task`; raises WorkerError, which lists the wrong fields, for other lines."""
    try:
        return _TASK.validate_json(line)
    except ValidationError as error:
        raise WorkerError(f"the line is neither a frame task nor a scene task: {error}") from error


class FrameCancelled(RenderError):
    """The frame was cancelled."""


def encode_cancel(digest: str) -> bytes:
    """Return the line that cancels a frame, by its digest."""
    return f"{_CANCEL}{digest}\n".encode()


class TaskQueue:
    """The lines of a worker's input: a queue of tasks, and the frame to cancel, which is known at once."""

    def __init__(self) -> None:
        self._tasks: queue.Queue[str] = queue.Queue()
        self._cancelled = ""

    @classmethod
    def from_input(cls) -> TaskQueue:
        """Return the requests of standard input, which a thread reads. The process ends at once when the input ends."""
        requests = cls()

        def read() -> None:
            requests.read_lines(sys.stdin)
            # There is no parent: a render in progress is dropped. Blender's own exit can hang.
            os._exit(0)

        threading.Thread(target=read, daemon=True).start()
        return requests

    def read_lines(self, lines: Iterable[str]) -> None:
        """Read all lines; runs in a thread of its own."""
        for line in lines:
            if line.startswith(_CANCEL):
                self._cancelled = line.removeprefix(_CANCEL).strip()
            else:
                self._tasks.put(line)

    def next(self) -> WorkerTask:
        """Return the next task, after waiting for it; raises as `decode_task`."""
        # A signal that arrives just before a wait is handled only after it: so each wait is short.
        while True:
            with suppress(queue.Empty):
                return decode_task(self._tasks.get(timeout=_MAX_WAIT))

    def check_cancelled(self, digest: str) -> None:
        """Raise Cancelled if the frame of a digest was cancelled."""
        if digest == self._cancelled:
            raise FrameCancelled("cancelled")
