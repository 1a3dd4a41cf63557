"""Files as arrays of a Mitsuba variant: scenes in memory, and one that is being built, share the array of a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakValueDictionary

import numpy as np

from lookdev.arrays import Elements, Floats32
from lookdev.cache import Content
from lookdev.errors import RenderError
from lookdev.mitsuba.frozen import device_array
from lookdev.mitsuba.types import AnyArray


@dataclass(frozen=True, eq=False)
class FileArray:
    """The numbers of a file, as a flat array, and their shape."""

    array: AnyArray
    shape: tuple[int, ...]


_arrays: WeakValueDictionary[tuple[type, Content], FileArray] = WeakValueDictionary()


def file_array(array_type: type[AnyArray], file: Content, read: Callable[[Path], Elements]) -> FileArray:
    """Return the numbers of a file as an array of a kind; calls `read` unless a scene in memory has the array."""
    stored = _arrays.get((array_type, file))
    if stored is None:
        numbers = read(file.path)
        stored = _arrays[array_type, file] = FileArray(device_array(array_type, numbers), numbers.shape)
    return stored


def read_image(path: Path) -> Floats32:
    """Read the linear RGBA of `lookdev.material.textures`, or the RGB of a light's texture, row 0 at the top."""
    import OpenImageIO as oiio  # imported here, as looks without textures start sooner

    image = oiio.ImageInput.open(str(path))
    if image is None:
        raise RenderError(f"{path}: cannot be read: {oiio.geterror()}")
    try:
        pixels = np.asarray(image.read_image(format=oiio.FLOAT), np.float32)
    finally:
        image.close()
    return pad_to_rgba(pixels)


def pad_to_rgba(pixels: Floats32) -> Floats32:
    """Return pixels with four channels, which Dr.Jit gathers at once."""
    if pixels.shape[2] == 4:
        return pixels
    rgba = np.ones((*pixels.shape[:2], 4), np.float32)
    rgba[..., :3] = pixels
    return rgba
