"""Tasks as lines of JSON, the input of a worker process: frames, and scenes ahead of their frames."""

from __future__ import annotations

from pydantic import TypeAdapter, ValidationError

from lookdev.errors import WorkerError
from lookdev.render.task import FrameTask, SceneTask

Task = FrameTask | SceneTask
_TASK: TypeAdapter[Task] = TypeAdapter(Task)


def encode(task: Task) -> str:
    """Return a task as one line of JSON, without the line's end; floats survive exactly."""
    return _TASK.dump_json(task).decode()


def decode(line: str) -> Task:
    """Return the task of a line that `encode` made; raises WorkerError with every wrong field of another line."""
    try:
        return _TASK.validate_json(line)
    except ValidationError as error:
        raise WorkerError(f"the line is neither a frame task nor a scene task: {error}") from error
