"""Tasks as lines of JSON, the input of a worker process: frames, and to some workers scenes ahead of their frames, or
pictures with derivatives."""

from __future__ import annotations

import queue
from collections.abc import Iterable
from contextlib import suppress

from pydantic import TypeAdapter, ValidationError

from lookdev.errors import RenderError, WorkerError
from lookdev.rendering.slopes import SlopeTask
from lookdev.rendering.task import FrameTask, SceneTask

Request = FrameTask | SceneTask | SlopeTask

_REQUEST: TypeAdapter[Request] = TypeAdapter(Request)


_CANCEL = "cancel "
"""Begins a line that is no task: the digest of the frame that is to end follows."""

_LONGEST_WAIT = 1.0  # seconds

_KINDS = {SceneTask: "scene task", SlopeTask: "picture with derivatives"}


def encode(task: Request) -> str:
    """Return a task as one line of JSON, without the line's end; floats survive exactly."""
    return _REQUEST.dump_json(task).decode()


def decode(line: str) -> FrameTask:
    """Return the frame task of a line that `encode` made; WorkerError as `decode_request`, and for another task."""
    task = decode_request(line)
    if not isinstance(task, FrameTask):
        raise WorkerError(f"the line is a {_KINDS[type(task)]}, not a frame task: the worker's backend is not sent any")
    return task


def decode_request(line: str) -> Request:
    """Return the task of a line that `encode` made; raises WorkerError with every wrong field of another line."""
    try:
        return _REQUEST.validate_json(line)
    except ValidationError as error:
        raise WorkerError(f"the line is neither a frame task nor a scene task: {error}") from error


class Cancelled(RenderError):
    """The frame is not wanted any more."""


def encode_cancel(digest: str) -> bytes:
    """Return the line that ends a frame."""
    return f"{_CANCEL}{digest}\n".encode()


class Requests:
    """The lines of a worker's input: tasks in their order, and which frame is to end, known at once."""

    def __init__(self) -> None:
        self._tasks: queue.Queue[str] = queue.Queue()
        self._cancelled = ""

    def read(self, lines: Iterable[str]) -> None:
        """Take all lines, in a thread of its own."""
        for line in lines:
            if line.startswith(_CANCEL):
                self._cancelled = line.removeprefix(_CANCEL).strip()
            else:
                self._tasks.put(line)

    def next(self) -> Request:
        """Wait for the next task; errors as `decode_request`."""
        # A signal that comes just before a wait does not end it, and is seen only after it: so no wait is long.
        while True:
            with suppress(queue.Empty):
                return decode_request(self._tasks.get(timeout=_LONGEST_WAIT))

    def check(self, digest: str) -> None:
        """Raise Cancelled where the frame of a digest is to end."""
        if digest == self._cancelled:
            raise Cancelled("cancelled")
