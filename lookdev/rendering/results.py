"""The parent's side of a render worker's answers: reads and checks messages, and the arrays of a frame.

A message is a line of JSON. `lookdev.rendering.answers` is the worker's side. In all messages, `digest` identifies the
frame.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter

from lookdev.arrays import Floats32
from lookdev.errors import WorkerError
from lookdev.rendering.frame import RenderedFrame
from lookdev.rendering.task import SceneTask


class ReadyMessage(BaseModel):
    """The worker takes tasks."""

    type: Literal["ready"]
    blender: str  # the version of Blender, or "mitsuba" and its version


class ProgressMessage(BaseModel):
    """Some samples of a frame are rendered."""

    type: Literal["progress"]
    digest: str
    samples: int  # rendered so far, per pixel
    of: int  # the most samples that the frame may take
    relmse: float | None  # estimated so far; None before the first estimate


class ResultMessage(BaseModel):
    """A frame is rendered. Fields without a comment are as in `RenderedFrame`."""

    type: Literal["done"]
    digest: str
    arrays: Path  # an .npz file, which the parent removes
    samples: int
    seconds: float
    relmse: float
    memory: int  # peak memory of the worker so far, in bytes
    notes: tuple[str, ...] = ()  # for the user
    raw_relmse: float | None = None
    raw_seconds: float | None = None


class FailureMessage(BaseModel):
    """A frame cannot be rendered."""

    type: Literal["failed"]
    digest: str
    message: str
    unwritable: bool = False  # whether a file could not be written; this would also stop all other frames


WorkerMessage = ReadyMessage | ProgressMessage | ResultMessage | FailureMessage
MESSAGES: TypeAdapter[WorkerMessage] = TypeAdapter(Annotated[WorkerMessage, Field(discriminator="type")])


@dataclass(frozen=True, eq=False, kw_only=True)
class WorkerFrame(RenderedFrame):
    """A rendered frame, as a worker has sent it."""

    blender: str  # as in `ReadyMessage`
    memory: int  # peak memory of the worker so far, in bytes
    notes: tuple[str, ...] = ()  # for the user


def load_result(done: ResultMessage, scene: SceneTask, blender: str) -> WorkerFrame:
    """Return the frame of a result, and remove the result's file.

    `blender` is the version in the worker's `ReadyMessage`. Raises WorkerError unless all arrays are finite and have
    the right shapes.
    """
    width, height = scene.resolution
    shapes = {"a": (height, width, 3), "b": (height, width, 3), "alpha": (height, width)}
    shapes |= {"raw": (height, width, 3)} if done.raw_relmse is not None else {}
    passes = scene.channels_by_array
    shapes |= {f"pass {name}": (height, width, len(channels)) for name, channels in passes.items()}
    arrays, names = load_arrays(done, shapes)
    pass_arrays = {name: arrays.pop(f"pass {name}") for name in passes}
    figures: dict[str, Any] = {**arrays, **done.model_dump(exclude={"type", "digest", "arrays"})}
    return WorkerFrame(
        **figures,
        passes=pass_arrays,
        names={matte: tuple(listed) for matte, listed in names.items()},
        blender=blender,
    )


def load_arrays(
    done: ResultMessage, shapes: Mapping[str, tuple[int, ...]]
) -> tuple[dict[str, Floats32], dict[str, list[str]]]:
    """Return the arrays of a result, by name, and remove the result's file.

    The second member of the tuple has the names of the objects in each cryptomatte, by the name of the matte. `shapes`
    has the right shape of each array, by its name. Raises as `load_result`.
    """
    try:
        with done.arrays.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in shapes}
            names = json.loads(stored["names"].tobytes()) if "names" in stored else {}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise WorkerError(f"the render worker's result cannot be read: {error}") from error
    done.arrays.unlink(missing_ok=True)
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise WorkerError(f"the render worker's array '{name}' is {arrays[name].shape}, should be {shape}")
        if not np.isfinite(arrays[name]).all():
            raise WorkerError(f"the render worker's array '{name}' has pixels that are not finite")
    return {name: array.astype(np.float32, copy=False) for name, array in arrays.items()}, names
