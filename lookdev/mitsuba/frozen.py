"""Arrays for frozen kernels: kernels that Dr.Jit records once and replays with other arguments (`dr.freeze`).

A frozen kernel also reads arrays that are not among its arguments, such as textures. Dr.Jit needs a list of these
arrays, which `collect_arrays` returns.
"""

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
    """Pause garbage collection in the block.

    Freeing NumPy's memory while a kernel is recorded would end the process.
    """
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def device_array(kind: type[_Array], values: ArrayLike) -> _Array:
    """Return numbers as a flat array of type `kind`, `mi.Float` or `mi.UInt32`, in memory that Dr.Jit allocates.

    A conversion alone would use NumPy's memory. Dr.Jit gathers four numbers at once where memory is aligned, and the
    alignment of NumPy's memory varies from run to run. The kernel of a scene would therefore vary, too, and be compiled
    again.
    """
    width = {dr.VarType.Float32: np.float32, dr.VarType.UInt32: np.uint32}[dr.type_v(kind)]
    source = kind(np.ascontiguousarray(values, width).ravel())
    copy = dr.empty(kind, len(source))
    dr.scatter(copy, source, dr.arange(dr.uint32_array_t(kind), len(source)))
    dr.eval(copy)
    return copy


def collect_arrays(root: object) -> list[object]:
    """Return all arrays of Dr.Jit and scenes of Mitsuba that can be reached from an object, each once.

    The search follows containers, and attributes of objects of this package.
    """
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
            pending += (*value.constants, *value.tables)  # its thousands of operations have no arrays
        elif isinstance(value, list | tuple | set):
            pending += value
        elif isinstance(value, Mapping):
            pending += value.values()
        elif type(value).__module__.startswith("lookdev.mitsuba") and hasattr(value, "__dict__"):
            pending += vars(value).values()
    return arrays
