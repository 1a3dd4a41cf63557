"""Arrays for the viewport in the browser, named by a digest of their content.

The browser caches them by name: an array that has not changed is not sent again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from lookdev.arrays import Elements

# The internal format of a WebGL texture, by the type of its texels and the number of their channels.
_FORMATS = {("float32", 1): "R32F", ("float32", 4): "RGBA32F", ("float16", 4): "RGBA16F", ("int32", 1): "R32I"}


@dataclass
class Buffers:
    """The bytes of arrays, little-endian, by the digest of the bytes."""

    content: dict[str, bytes] = field(default_factory=dict)

    def texture(self, texels: Elements) -> Mapping[str, str | int]:
        """Add a texture (H, W) or (H, W, 4); return its digest ``buffer``, its size, and WebGL's name of its format."""
        channels = 1 if texels.ndim == 2 else texels.shape[2]
        height, width = texels.shape[:2]
        return {
            "buffer": self.array(texels),
            "format": _FORMATS[texels.dtype.name, channels],
            "width": width,
            "height": height,
        }

    def array(self, values: Elements) -> str:
        """Add an array; return its digest."""
        data = np.ascontiguousarray(values).tobytes()
        name = hashlib.sha256(data).hexdigest()[:32]
        self.content[name] = data
        return name

    def rows(self, numbers: Elements, width: int) -> Mapping[str, str | int]:
        """Add numbers (n,), or texels (n, 4), as a texture with rows of `width` texels, padded with zeros.

        Returns the record that `texture` returns.
        """
        padded = np.pad(numbers, ((0, -len(numbers) % width), *[(0, 0)] * (numbers.ndim - 1)))
        return self.texture(padded.reshape(-1, width, *numbers.shape[1:]))
