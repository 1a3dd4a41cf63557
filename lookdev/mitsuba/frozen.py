"""The arrays that a frozen kernel reads besides its arguments."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TypeVar

import drjit as dr
import numpy as np
from numpy.typing import ArrayLike

from lookdev.mitsuba.programs import Program
from lookdev.mitsuba.types import AnyArray

_Array = TypeVar("_Array", bound=AnyArray)


@contextmanager
def pause_garbage_collection() -> Iterator[None]:
    """Pause garbage collection in the block: freeing NumPy's memory while a kernel is recorded ends the process."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def device_array(kind: type[_Array], values: ArrayLike) -> _Array:
    """Return numbers as a flat array of a kind, `mi.Float` or `mi.UInt32`, in memory that Dr.Jit allocates.

    Otherwise Dr.Jit uses NumPy's memory, and gathers four numbers at once where that happens to be aligned: the kernel
    of a scene would vary from run to run, and be compiled again.
    """
    width = {dr.VarType.Float32: np.float32, dr.VarType.UInt32: np.uint32}[dr.type_v(kind)]
    source = kind(np.ascontiguousarray(values, width).ravel())
    copy = dr.empty(kind, len(source))
    dr.scatter(copy, source, dr.arange(dr.uint32_array_t(kind), len(source)))
    dr.eval(copy)
    return copy


def collect_arrays(root: object) -> list[object]:
    """Return the arrays of Dr.Jit and the scenes of Mitsuba that objects of this package refer to, each once."""
    arrays: list[object] = []
    visited: set[int] = set()
    pending = [root]
    while pending:
        value = pending.pop()
        if id(value) in visited:
            continue
        visited.add(id(value))
        if dr.is_array_v(value) or type(value).__name__ == "Scene":
            arrays.append(value)
        elif isinstance(value, Program):
            pending += (*value.constants, *value.tables)  # without its thousands of operations
        elif isinstance(value, list | tuple | set):
            pending += value
        elif isinstance(value, Mapping):
            pending += value.values()
        elif type(value).__module__.startswith("lookdev.mitsuba") and hasattr(value, "__dict__"):
            pending += vars(value).values()
    return arrays
