"""Binary messages for a page: a header in JSON, followed by arrays of float32."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np

from lookdev.arrays import Elements

_FLOAT32_MAX = float(np.finfo(np.float32).max)


def encode_packet(header: Mapping[str, object], arrays: Mapping[str, Elements]) -> bytes:
    """Return a message of a header and arrays, little-endian.

    The message is the length of the header as uint32, the header, padded to 4 bytes, and the arrays. ``arrays`` in the
    header lists their names and shapes. Numbers beyond the range of float32 become its largest number.
    """
    shapes = [[name, list(np.shape(values))] for name, values in arrays.items()]
    header_bytes = json.dumps({**header, "arrays": shapes}, separators=(",", ":")).encode()
    header_bytes += b" " * (-len(header_bytes) % 4)
    parts: list[bytes | memoryview] = [len(header_bytes).to_bytes(4, "little"), header_bytes]
    for values in arrays.values():
        with np.errstate(over="ignore"):
            array = np.ascontiguousarray(values, "<f4")
        if not np.isfinite(array).all():
            array = np.clip(array, -_FLOAT32_MAX, _FLOAT32_MAX).astype("<f4")
        parts.append(array.data)
    return b"".join(parts)
