"""The answers of a render worker, as its parent reads and checks them: messages, and the arrays of a frame.

`lookdev.rendering.answers` is the worker's side.
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
    type: Literal["ready"]
    blender: str


class ProgressMessage(BaseModel):
    type: Literal["progress"]
    digest: str
    samples: int
    of: int
    relmse: float | None


class ResultMessage(BaseModel):
    type: Literal["done"]
    digest: str
    arrays: Path
    samples: int
    seconds: float
    relmse: float
    memory: int
    notes: tuple[str, ...] = ()
    raw_relmse: float | None = None
    raw_seconds: float | None = None


class FailureMessage(BaseModel):
    type: Literal["failed"]
    digest: str
    message: str
    unwritable: bool = False


WorkerMessage = ReadyMessage | ProgressMessage | ResultMessage | FailureMessage
MESSAGES: TypeAdapter[WorkerMessage] = TypeAdapter(Annotated[WorkerMessage, Field(discriminator="type")])


@dataclass(frozen=True, eq=False, kw_only=True)
class WorkerFrame(RenderedFrame):
    """A frame of a worker."""

    blender: str
    memory: int  # peak of the worker so far, bytes
    notes: tuple[str, ...] = ()  # for the user


def load_result(done: ResultMessage, scene: SceneTask, blender: str) -> WorkerFrame:
    """Read a result and remove its file; raises WorkerError unless the arrays are finite and of the right shapes."""
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
    """Return the arrays of a result and the names in its mattes, and remove its file; raises as `load_result`."""
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
