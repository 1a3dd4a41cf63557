"""Tables of numbers that a model looks up, such as measured samples; code generation can trace the look-up.

Besides NumPy's functions, `look_up` is the only function that models call on arrays.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.vectors import Array


@dataclass(frozen=True, eq=False)
class NumberTable:
    """A table of numbers (rows, columns) or of colours (rows, columns, 3), which generated code stores in float32."""

    values: Floats

    @cached_property
    def digest(self) -> str:
        """The SHA-256 of the table's shape and numbers, in hexadecimal."""
        data = np.ascontiguousarray(self.values, np.float32)
        return hashlib.sha256(repr(data.shape).encode() + data.tobytes()).hexdigest()

    def __str__(self) -> str:
        return self.digest


def look_up(table: NumberTable, row: Array | float, column: Array | float) -> Array:
    """Return the numbers (...) or colours (..., 3) in cells of a table, given by whole numbers `row` and `column`."""
    for index in (row, column):
        if not isinstance(index, np.ndarray | np.generic | float):
            # Dispatch to symbolic arrays, as NumPy's own functions do (NEP 18).
            return index.__array_function__(look_up, (type(index),), (table, row, column), {})  # type: ignore[attr-defined,no-any-return]
    cells = table.values[np.asarray(row).astype(np.intp), np.asarray(column).astype(np.intp)]
    return np.asarray(cells, np.float64)
