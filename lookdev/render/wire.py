"""Tasks as lines of JSON, the input of a worker process: frames, and to some workers scenes ahead of their frames, or
pictures with derivatives."""

from __future__ import annotations

from pydantic import TypeAdapter, ValidationError

from lookdev.errors import WorkerError
from lookdev.render.slopes import SlopeTask
from lookdev.render.task import FrameTask, SceneTask

Request = FrameTask | SceneTask | SlopeTask

_REQUEST: TypeAdapter[Request] = TypeAdapter(Request)


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
