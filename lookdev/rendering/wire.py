"""The input of a worker process: tasks as lines of JSON, which the parent writes to the worker's standard input.

All workers take frames. Some workers also take pictures with derivatives, or scenes: a scene is sent before its first
frame, so that the worker can prepare the scene.
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
"""The start of a line that cancels a frame. The digest of the frame follows."""

_MAX_WAIT = 1.0  # seconds of a wait for a line, see `TaskQueue.next`

_TASK_NAMES = {SceneTask: "scene task", DerivativeTask: "picture with derivatives"}


def encode_task(task: WorkerTask) -> str:
    """Return a task as one line of JSON, without a newline; floats are read back exactly."""
    return _TASK.dump_json(task).decode()


def decode_frame_task(line: str) -> FrameTask:
    """Return the frame task that `encode_task` has written to a line.

    Raises WorkerError as `decode_task`, and where the line has another kind of task.
    """
    task = decode_task(line)
    if not isinstance(task, FrameTask):
        raise WorkerError(
            f"the line is a {_TASK_NAMES[type(task)]}, not a frame task; this worker takes only frame tasks"
        )
    return task


def decode_task(line: str) -> WorkerTask:
    """Return the task that `encode_task` has written to a line.

    For other lines, raises WorkerError, whose message lists the wrong fields.
    """
    try:
        return _TASK.validate_json(line)
    except ValidationError as error:
        raise WorkerError(
            f"the line is not a frame task, a scene task or a picture with derivatives: {error}"
        ) from error


class FrameCancelled(RenderError):
    """The frame was cancelled."""


def encode_cancel(digest: str) -> bytes:
    """Return the line that cancels a frame, by its digest."""
    return f"{_CANCEL}{digest}\n".encode()


class TaskQueue:
    """The lines of a worker's input: a queue of tasks, and the latest frame to cancel.

    A line that cancels a frame does not wait in the queue: it has an effect while the frame is rendered.
    """

    def __init__(self) -> None:
        self._tasks: queue.Queue[str] = queue.Queue()
        self._cancelled = ""

    @classmethod
    def from_input(cls) -> TaskQueue:
        """Return the queue of standard input, which a thread reads. When the input ends, the process ends at once."""
        requests = cls()

        def read() -> None:
            requests.read_lines(sys.stdin)
            # The parent has ended, so a render in progress is useless. A regular exit could hang in Blender.
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
        """Wait for the next task and return it; raises as `decode_task`."""
        # A signal that arrives just before a wait is handled only after that wait. Each wait is therefore short.
        while True:
            with suppress(queue.Empty):
                return decode_task(self._tasks.get(timeout=_MAX_WAIT))

    def check_cancelled(self, digest: str) -> None:
        """Raise FrameCancelled if the frame with this digest is cancelled."""
        if digest == self._cancelled:
            raise FrameCancelled("cancelled")
