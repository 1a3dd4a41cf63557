"""What a frozen kernel reads besides its arguments."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import ArrayLike

from lookdev.mitsuba.programs import Program


@contextmanager
def nothing_freed() -> Iterator[None]:
    """Let Python collect no garbage meanwhile: freeing memory that NumPy made ends a process that records a kernel."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def held(kind: Any, values: ArrayLike) -> Any:
    """Return numbers, flat, as an array of a kind, `mi.Float` or `mi.UInt32`, in memory of Dr.Jit's own.

    It takes NumPy's memory as it is, and gathers four numbers at once where that happens to be aligned: the kernel of
    a scene would be another one from time to time, and be compiled.
    """
    width = {dr.VarType.Float32: np.float32, dr.VarType.UInt32: np.uint32}[dr.type_v(kind)]
    given = kind(np.ascontiguousarray(values, width).ravel())
    own = dr.empty(kind, len(given))
    dr.scatter(own, given, dr.arange(dr.uint32_array_t(kind), len(given)))
    dr.eval(own)
    return own


def held_arrays(root: object) -> list[Any]:
    """Return the arrays of Dr.Jit and the scenes of Mitsuba that the objects of this package hold, each once."""
    found: list[Any] = []
    seen: set[int] = set()
    left = [root]
    while left:
        value = left.pop()
        if id(value) in seen:
            continue
        seen.add(id(value))
        if dr.is_array_v(value) or type(value).__name__ == "Scene":
            found.append(value)
        elif isinstance(value, Program):
            left += (*value.constants, *value.tables)  # its operations are thousands
        elif isinstance(value, list | tuple | set):
            left += value
        elif isinstance(value, Mapping):
            left += value.values()
        elif type(value).__module__.startswith("lookdev.mitsuba") and hasattr(value, "__dict__"):
            left += vars(value).values()
    return found
