"""Frame tasks as lines of JSON, the input of a worker process."""

from __future__ import annotations

from pydantic import TypeAdapter, ValidationError

from lookdev.errors import WorkerError
from lookdev.render.task import FrameTask

_FRAME_TASK = TypeAdapter(FrameTask)


def encode(task: FrameTask) -> str:
    """Return a task as one line of JSON, without the line's end; floats survive exactly."""
    return _FRAME_TASK.dump_json(task).decode()


def decode(line: str) -> FrameTask:
    """Return the task of a line that `encode` made; raises WorkerError with every wrong field of another line."""
    try:
        return _FRAME_TASK.validate_json(line)
    except ValidationError as error:
        raise WorkerError(f"the line is not a frame task: {error}") from error
