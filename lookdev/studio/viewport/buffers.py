"""Arrays for the browser, by a digest of their content: an array that has not changed is not sent again."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from lookdev.arrays import Elements

_FORMATS = {("float32", 1): "R32F", ("float32", 4): "RGBA32F", ("float16", 4): "RGBA16F", ("int32", 1): "R32I"}


@dataclass
class Buffers:
    """The bytes of arrays, little-endian, by the digest of their content."""

    content: dict[str, bytes] = field(default_factory=dict)

    def texture(self, texels: Elements) -> Mapping[str, str | int]:
        """Add a texture (H, W) or (H, W, 4); return its digest, its format by WebGL's name, and its size."""
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
        """Add numbers (n,), or texels (n, 4), as a texture with rows of `width` texels; return what `texture` does."""
        padded = np.pad(numbers, ((0, -len(numbers) % width), *[(0, 0)] * (numbers.ndim - 1)))
        return self.texture(padded.reshape(-1, width, *numbers.shape[1:]))
