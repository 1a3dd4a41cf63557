"""The door through which all images come that a user gives: textures and environment maps of any content.

An image is a regular file whose header is read first. Both its pixels and its bytes have a limit, before anything as
large as the image is held in memory: a small file can claim any number of pixels. All messages state the limit.
"""

from __future__ import annotations

import os
import re
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from lookdev.errors import LookdevError, OutputError

Floats = NDArray[np.float32]

PIXELS_VARIABLE = "LOOKDEV_IMAGE_PIXELS"
"""Environment variable: the largest number of pixels of an image."""

DEFAULT_PIXELS = 1 << 27
"""16384 x 8192."""

_BYTES = 32  # of a file, for each pixel of the limit: uncompressed, eight channels of floats
_STRIP = 1 << 20  # pixels read at once
_MEGABYTE = 1 << 20


def most_pixels() -> int:
    """Return the largest number of pixels of an image; raises OutputError where the variable has no such number."""
    given = os.environ.get(PIXELS_VARIABLE, str(DEFAULT_PIXELS))
    if not re.fullmatch(r"[1-9][0-9]{0,11}", given):
        raise OutputError(f"{PIXELS_VARIABLE} is {given[:40]!a}; a number of pixels from 1 to 10^12 is needed")
    return int(given)


def check_file(file: Path, error: type[LookdevError]) -> None:
    """Raise `error` unless an image may be read: a regular file, neither empty nor larger than the limit."""
    try:
        status = file.stat()
    except FileNotFoundError:
        raise error(f"{file}: no such image file") from None
    except OSError as failure:
        raise error(f"{file}: cannot be read: {failure.strerror}") from None
    if not stat.S_ISREG(status.st_mode):
        raise error(f"{file}: is not a regular file")
    if not status.st_size:
        raise error(f"{file}: cannot be read as an image: it is empty")
    most = _BYTES * most_pixels()
    if status.st_size > most:
        raise error(f"{file}: has {status.st_size} bytes; at most {most} are read, {_BYTES} for each of {_limit()}")


@contextmanager
def open_image(file: Path, error: type[LookdevError]) -> Iterator[oiio.ImageInput]:
    """Open an image whose file and header are checked, alpha as stored; raises `error` where it must not be read."""
    check_file(file, error)
    if _is_damaged_png(file, error):  # of which libpng tells stderr
        raise error(f"{file}: cannot be read as an image: the header of the PNG is damaged")
    # Some formats are decoded as they are opened. OpenImageIO refuses what is larger.
    oiio.attribute("limits:imagesize_MB", -(-_BYTES * most_pixels() // _MEGABYTE))
    as_stored = oiio.ImageSpec()
    as_stored["oiio:UnassociatedAlpha"] = 1
    image = oiio.ImageInput.open(str(file), as_stored)
    if image is None:
        raise error(f"{file}: cannot be read as an image: {_reason(oiio.geterror())}")
    try:
        check_size(file, image.spec(), error)
        yield image
    finally:
        image.close()


def check_size(file: Path, spec: oiio.ImageSpec, error: type[LookdevError]) -> None:
    """Raise `error` unless the pixels of an image, and those of its whole frame, are within the limit."""
    sizes = ((spec.width, spec.height), (spec.full_width, spec.full_height))
    width, height = max(sizes, key=lambda size: size[0] * size[1])
    if spec.depth > 1:
        raise error(f"{file}: is a volume of depth {spec.depth}; a flat image would be right")
    if width * height > most_pixels():
        raise error(f"{file}: is {width} x {height} pixels large; at most {_limit()} would be right")


def _limit() -> str:
    return f"{PIXELS_VARIABLE} = {most_pixels()} pixels"


def strips(
    image: oiio.ImageInput, file: Path, channels: range, error: type[LookdevError]
) -> Iterator[tuple[int, Floats]]:
    """Yield the first row of each part of an open image, within its pixels, and the part: (rows, width, channels).

    Raises `error` where the pixels cannot be read.
    """
    spec = image.spec()
    rows = max(1, _STRIP // spec.width)
    if spec.tile_height:
        rows = -(-rows // spec.tile_height) * spec.tile_height
    subimage = image.current_subimage()
    for first in range(0, spec.height, rows):
        begin, end = spec.y + first, spec.y + min(first + rows, spec.height)
        wanted = channels.start, channels.stop, oiio.FLOAT
        if spec.tile_width:
            right = spec.x + spec.width
            pixels = image.read_tiles(subimage, 0, spec.x, right, begin, end, spec.z, spec.z + 1, *wanted)
        else:
            pixels = image.read_scanlines(subimage, 0, begin, end, spec.z, *wanted)
        if pixels is None:
            raise error(f"{file}: cannot be read as an image: {_reason(image.geterror())}")
        yield first, pixels.reshape(end - begin, spec.width, len(channels))


def whole_image(image: oiio.ImageInput, file: Path, channels: range, error: type[LookdevError]) -> Floats:
    """Return the pixels of an open image (height, width, channels); raises `error` where they cannot be read."""
    spec = image.spec()
    pixels = np.empty((spec.height, spec.width, len(channels)), np.float32)
    for first, part in strips(image, file, channels, error):
        pixels[first : first + len(part)] = part
    return pixels


def _reason(text: str) -> str:
    """Return the start of what OpenImageIO says: the library of a format repeats an error in further lines."""
    first = text.strip().partition("\n")[0][:300]
    return "".join(each if each.isprintable() else "?" for each in first) or "no reader knows it"


def _is_damaged_png(file: Path, error: type[LookdevError]) -> bool:
    """Return whether the first chunk of a PNG is not whole (ISO/IEC 15948, 5.3 and 11.2.2)."""
    try:
        with file.open("rb") as stream:
            start = stream.read(33)
    except OSError as failure:
        raise error(f"{file}: cannot be read: {failure.strerror}") from failure
    whole = start[8:16] == b"\0\0\0\rIHDR" and zlib.crc32(start[12:29]).to_bytes(4, "big") == start[29:]
    return start[:8] == b"\x89PNG\r\n\x1a\n" and not whole
