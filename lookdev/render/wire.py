"""Tasks as lines of JSON, the input of a worker process: frames, and to some workers scenes ahead of their frames."""

from __future__ import annotations

from pydantic import TypeAdapter, ValidationError

from lookdev.errors import WorkerError
from lookdev.render.task import FrameTask, SceneTask

Request = FrameTask | SceneTask

_REQUEST: TypeAdapter[Request] = TypeAdapter(Request)


def encode(task: Request) -> str:
    """Return a task as one line of JSON, without the line's end; floats survive exactly."""
    return _REQUEST.dump_json(task).decode()


def decode(line: str) -> FrameTask:
    """Return the frame task of a line that `encode` made; raises WorkerError as `decode_request`, and for a scene."""
    task = decode_request(line)
    if isinstance(task, SceneTask):
        raise WorkerError("the line is a scene task, not a frame task: the worker's backend is not sent any")
    return task


def decode_request(line: str) -> Request:
    """Return the task of a line that `encode` made; raises WorkerError with every wrong field of another line."""
    try:
        return _REQUEST.validate_json(line)
    except ValidationError as error:
        raise WorkerError(f"the line is neither a frame task nor a scene task: {error}") from error
