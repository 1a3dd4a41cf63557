"""Numbers for a page: a header in JSON and arrays of float32, in one binary message."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_LARGEST = float(np.finfo(np.float32).max)


def packet(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return the length of the header as uint32, the header, padded to 4 bytes, and the arrays, all little-endian.

    ``arrays`` of the header has their names and shapes. Numbers beyond float32 become its largest.
    """
    shapes = [[name, list(np.shape(each))] for name, each in arrays.items()]
    text = json.dumps({**header, "arrays": shapes}, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    parts: list[Any] = [len(text).to_bytes(4, "little"), text]
    for each in arrays.values():
        with np.errstate(over="ignore"):
            array = np.ascontiguousarray(each, "<f4")
        if not np.isfinite(array).all():
            array = np.clip(array, -_LARGEST, _LARGEST).astype("<f4")
        parts.append(array.data)
    return b"".join(parts)
