"""Reads images and tables into arrays of a Mitsuba variant. All scenes in memory share the array of a file."""

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
    """The numbers of a file as a flat array, and the shape that they have in the file, such as (H, W, 4)."""

    array: AnyArray
    shape: tuple[int, ...]


# The arrays that some scene refers to, by type and file.
_arrays: WeakValueDictionary[tuple[type, Content], FileArray] = WeakValueDictionary()


def file_array(array_type: type[AnyArray], file: Content, read: Callable[[Path], Elements]) -> FileArray:
    """Return the numbers of a file as an array of a type. `read` is called only if no scene in memory has the array."""
    stored = _arrays.get((array_type, file))
    if stored is None:
        numbers = read(file.path)
        stored = _arrays[array_type, file] = FileArray(device_array(array_type, numbers), numbers.shape)
    return stored


def read_image(path: Path) -> Floats32:
    """Return a linear image as RGBA (H, W, 4), row 0 at the top.

    The file is a texture that `lookdev.material.textures` has written, or the RGB texture of a light.
    """
    import OpenImageIO as oiio  # imported here, so that looks without textures start sooner

    image = oiio.ImageInput.open(str(path))
    if image is None:
        raise RenderError(f"{path}: cannot be read: {oiio.geterror()}")
    try:
        pixels = np.asarray(image.read_image(format=oiio.FLOAT), np.float32)
    finally:
        image.close()
    return pad_to_rgba(pixels)


def pad_to_rgba(pixels: Floats32) -> Floats32:
    """Return pixels (H, W, 4), from RGB or RGBA: Dr.Jit gathers four channels at once. Added alpha is 1."""
    if pixels.shape[2] == 4:
        return pixels
    rgba = np.ones((*pixels.shape[:2], 4), np.float32)
    rgba[..., :3] = pixels
    return rgba
