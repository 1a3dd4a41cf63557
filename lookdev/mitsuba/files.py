"""Files in a variant's arrays: each is read once for all scenes that are held, as the next one is while it is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from lookdev.cache import Content
from lookdev.errors import RenderError
from lookdev.mitsuba.frozen import held


@dataclass(frozen=True, eq=False)
class FileArray:
    """The numbers of a file, flat, and their shape."""

    array: Any
    shape: tuple[int, ...]


_read: WeakValueDictionary[tuple[type, Content], FileArray] = WeakValueDictionary()


def file_array(kind: Any, file: Content, read: Callable[[Path], NDArray[Any]]) -> FileArray:
    """Return the numbers of a file as an array of a kind, which `read` returns unless some scene holds them."""
    found = _read.get((kind, file))
    if found is None:
        numbers = read(file.path)
        found = _read[kind, file] = FileArray(held(kind, numbers), numbers.shape)
    return found


def read_image(path: Path) -> NDArray[np.float32]:
    """Read the linear RGBA of `lookdev.material.textures`, or the RGB of a light's texture, row 0 at the top."""
    import OpenImageIO as oiio  # not at the top: looks without textures start sooner

    image = oiio.ImageInput.open(str(path))
    if image is None:
        raise RenderError(f"{path}: cannot be read: {oiio.geterror()}")
    try:
        pixels = np.asarray(image.read_image(format=oiio.FLOAT), np.float32)
    finally:
        image.close()
    return padded(pixels)


def padded(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return pixels of four channels, which are gathered at once."""
    if pixels.shape[2] == 4:
        return pixels
    wide = np.ones((*pixels.shape[:2], 4), np.float32)
    wide[..., :3] = pixels
    return wide
