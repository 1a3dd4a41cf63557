"""Binary messages (packets) from the server to a page: a header in JSON, followed by arrays of float32."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np

from lookdev.arrays import Elements

_FLOAT32_MAX = float(np.finfo(np.float32).max)


def encode_packet(header: Mapping[str, object], arrays: Mapping[str, Elements]) -> bytes:
    """Return a header and arrays, by their names, as one message, little-endian.

    The message begins with the length of the padded header in bytes, as uint32. The header follows, as JSON padded with
    spaces to a multiple of 4 bytes. Then follow the arrays, in C order, without gaps. The header's key ``arrays`` lists
    ``[name, shape]`` of each array. A number beyond the range of float32 becomes the largest float32 of its sign.
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
