"""The reader of all images that a user gives, such as textures and environment maps; their content is not trusted.

An image is a regular file, whose header is read first. The numbers of its pixels and of its bytes are limited. Both are
checked before the pixels are read into memory, since a small file can claim any number of pixels. All messages state
the limit. The parameter `error` of functions is the class of the errors that they raise.
"""

from __future__ import annotations

import os
import stat
import struct
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lookdev.arrays import Floats32
from lookdev.errors import LookdevError
from lookdev.safe_text import environment_limit
from lookdev.sandbox import report_reading

if TYPE_CHECKING:  # the render worker, which does not read images here, starts sooner
    import OpenImageIO as oiio


PIXELS_VARIABLE = "LOOKDEV_IMAGE_PIXELS"
"""Environment variable: the largest number of pixels of an image."""

DEFAULT_PIXELS = 1 << 27
"""The default of `PIXELS_VARIABLE`: 16384 x 8192 pixels."""

# A file may have this number of bytes for each pixel that an image may have: eight channels of uncompressed float32.
_BYTES_PER_PIXEL = 32
_STRIP = 1 << 20  # pixels read at once
_MEGABYTE = 1 << 20
_dwa_lock, _dwa_decoded = threading.Lock(), False  # see `_decode_first_dwa`
_PNG_SIDE = 1_000_000  # largest side of a PNG in pixels: libpng's limit
# By the colour type of a PNG: the bits of a sample, and the samples of a pixel.
_PNG_DEPTHS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}


def default_pixel_limit() -> int:
    """Return the limit of an image's pixels in `PIXELS_VARIABLE`, or the default; raises OutputError if it is wrong."""
    return environment_limit(PIXELS_VARIABLE, DEFAULT_PIXELS, "pixels")


def check_file(file: Path, error: type[LookdevError], most: int | None = None) -> None:
    """Raise `error` unless a file may be read as an image: a regular file, not empty, and not too large.

    Its size is limited to `_BYTES_PER_PIXEL` for each of `most` pixels, by default `default_pixel_limit`.
    """
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
    pixels, limit = _pixel_limit(most)
    if status.st_size > _BYTES_PER_PIXEL * pixels:
        largest = f"at most {_BYTES_PER_PIXEL * pixels} are read, {_BYTES_PER_PIXEL} for each of {limit}"
        raise error(f"{file}: has {status.st_size} bytes; {largest}")


@contextmanager
def open_image(file: Path, error: type[LookdevError], most: int | None = None) -> Iterator[oiio.ImageInput]:
    """Open an image after a check of its file and header; its alpha is read as stored.

    `most` is the largest number of pixels, as for `check_file`. Raises `error` where the image must not be read.
    """
    import OpenImageIO as oiio

    check_file(file, error, most)
    _check_png(file, error, whole=False)
    # OpenImageIO decodes images of some formats as it opens them. It must refuse too large ones itself.
    oiio.attribute("limits:imagesize_MB", -(-_BYTES_PER_PIXEL * _pixel_limit(most)[0] // _MEGABYTE))
    # Select the newer of OpenImageIO's two EXR readers: the other one writes the faults of an image to stderr.
    oiio.attribute("openexr:core", 1)
    as_stored = oiio.ImageSpec()
    as_stored["oiio:UnassociatedAlpha"] = 1
    with report_reading(file):
        image = oiio.ImageInput.open(str(file), as_stored)
        if image is None:
            raise error(f"{file}: cannot be read as an image: {_error_reason(oiio.geterror)}")
        try:
            check_size(file, image.spec(), error, most)
            yield image
        finally:
            image.close()


def check_size(file: Path, spec: oiio.ImageSpec, error: type[LookdevError], most: int | None = None) -> None:
    """Raise `error` unless an image is flat, has pixels, and has at most `most` pixels in data and display window."""
    sizes = ((spec.width, spec.height), (spec.full_width, spec.full_height))
    if min(spec.nchannels, *sizes[0], *sizes[1]) < 1:
        raise error(f"{file}: has no pixels: it is {spec.width} x {spec.height}, of {spec.nchannels} channels")
    width, height = max(sizes, key=lambda size: size[0] * size[1])
    if spec.depth > 1:
        raise error(f"{file}: is a volume of depth {spec.depth}; a flat image would be right")
    pixels, limit = _pixel_limit(most)
    if width * height > pixels:
        raise error(f"{file}: is {width} x {height} pixels large; at most {limit} would be right")


def _check_jpeg(file: Path, error: type[LookdevError]) -> None:
    """Raise `error` for a JPEG without end marker (ITU-T T.81, B.1.1.3): the JPEG reader fills in missing pixels."""
    data = file.read_bytes()
    start = 2  # the offset of a segment: the first follows the marker of the image's start
    # Skip all segments before the segment of the scan, 0xda: a thumbnail in them may contain an end marker.
    while data[start : start + 1] == b"\xff" and data[start + 1 : start + 2] != b"\xda":
        start += 2 + int.from_bytes(data[start + 2 : start + 4], "big")
    if data.find(b"\xff\xd9", start) < 0:
        raise error(f"{file}: cannot be read as an image: the JPEG is cut off")


def _check_png(file: Path, error: type[LookdevError], *, whole: bool) -> None:
    """Raise `error` for a damaged PNG; its pixels are checked only with `whole`."""
    try:
        fault = _png_fault(file, whole=whole)
    except OSError as failure:
        raise error(f"{file}: cannot be read: {failure.strerror}") from failure
    if fault:
        raise error(f"{file}: cannot be read as an image: {fault}")


def _pixel_limit(most: int | None) -> tuple[int, str]:
    """Return the largest number of pixels, and its description for a message."""
    if most is not None:
        return most, f"{most} pixels"
    return default_pixel_limit(), f"{PIXELS_VARIABLE} = {default_pixel_limit()} pixels"


def read_strips(
    image: oiio.ImageInput, file: Path, channels: range, error: type[LookdevError]
) -> Iterator[tuple[int, Floats32]]:
    """Yield an open image in strips: the index of a strip's first row, and its pixels (rows, width, channels).

    `channels` is the range of channels to read. Raises `error` where the pixels cannot be read.
    """
    import OpenImageIO as oiio

    spec = image.spec()
    _check_png(file, error, whole=True)
    if image.format_name() == "jpeg":
        _check_jpeg(file, error)
    rows = max(1, _STRIP // spec.width)
    if spec.tile_height:  # round up to whole tiles
        rows = -(-rows // spec.tile_height) * spec.tile_height
    subimage = image.current_subimage()

    def read_rows(begin: int, end: int, right: int) -> Floats32:
        """Return the pixels of the rows from `begin` to before `end`; of a tiled image, only columns before `right`."""
        selection = channels.start, channels.stop, oiio.FLOAT
        if spec.tile_width:
            pixels = image.read_tiles(subimage, 0, spec.x, right, begin, end, spec.z, spec.z + 1, *selection)
        else:
            pixels = image.read_scanlines(subimage, 0, begin, end, spec.z, *selection)
        if pixels is None or image.has_error:  # for missing rows of a TIFF, only the error is set
            raise error(f"{file}: cannot be read as an image: {_error_reason(image.geterror)}")
        return pixels

    if spec.get_string_attribute("compression").startswith("dwa"):
        height, width = min(spec.tile_height or 1, spec.height), min(spec.tile_width or spec.width, spec.width)
        _decode_first_dwa(lambda: read_rows(spec.y, spec.y + height, spec.x + width))
    for first in range(0, spec.height, rows):
        begin, end = spec.y + first, spec.y + min(first + rows, spec.height)
        pixels = read_rows(begin, end, spec.x + spec.width)
        yield first, pixels.reshape(end - begin, spec.width, len(channels))


def _decode_first_dwa(decode_one: Callable[[], object]) -> None:
    """Decode the first block of DWA images of this process in one thread.

    While OpenEXR decodes its first block, it chooses the decoder for this processor. Other threads would meanwhile
    decode with a decoder that rounds differently (docs/notebook/first-dwa-block.md).
    """
    global _dwa_decoded
    with _dwa_lock:
        if not _dwa_decoded:
            decode_one()
            _dwa_decoded = True


def whole_image(image: oiio.ImageInput, file: Path, channels: range, error: type[LookdevError]) -> Floats32:
    """Return the pixels of an open image (height, width, channels); raises `error` where they cannot be read."""
    spec = image.spec()
    pixels = np.empty((spec.height, spec.width, len(channels)), np.float32)
    for first, part in read_strips(image, file, channels, error):
        pixels[first : first + len(part)] = part
    return pixels


def _error_reason(error: Callable[[], str]) -> str:
    """Return the first line of OpenImageIO's error: the library of a format repeats the error in further lines."""
    try:
        first = error().strip().partition("\n")[0][:300]
    except UnicodeDecodeError:  # the error quotes the file
        first = "it is damaged"
    return "".join(character if character.isprintable() else "?" for character in first) or "no reader knows it"


def _png_fault(file: Path, *, whole: bool) -> str:
    """Return the fault of a PNG's chunks (ISO/IEC 15948, 5 and 11.2); '' without fault, and for other formats.

    libpng would write the fault to stderr. The pixels are checked only with `whole`.
    """
    with file.open("rb") as stream:
        if stream.read(8) != b"\x89PNG\r\n\x1a\n":
            return ""
        size = os.fstat(stream.fileno()).st_size
        # The type of the newest chunk, and the bytes of pixels that are still to come; -1 before the header.
        decompressor, kind, left = zlib.decompressobj(), b"", -1
        while kind != b"IEND":
            start = stream.read(8)
            length, kind = int.from_bytes(start[:4], "big"), start[4:]
            if len(start) < 8 or length > size - stream.tell() - 4:
                return "the PNG is cut off"
            if (kind == b"IHDR") != (left < 0):
                return "the header of the PNG is damaged"
            if kind == b"IDAT" and not whole:
                return ""
            data, checksum = stream.read(length), stream.read(4)
            if zlib.crc32(kind + data).to_bytes(4, "big") != checksum:
                return "the header of the PNG is damaged" if kind == b"IHDR" else "the PNG is damaged"
            if kind == b"IHDR":
                left = _min_png_bytes(data)
                if not left:
                    return "the header of the PNG is damaged"
                width, height = struct.unpack(">II", data[:8])
                if max(width, height) > _PNG_SIDE:
                    return f"it is {width} x {height} pixels large; a side has at most {_PNG_SIDE}"
            elif kind == b"IDAT":
                try:
                    while data and left:
                        left = max(left - len(decompressor.decompress(data, _MEGABYTE)), 0)
                        data = decompressor.unconsumed_tail
                except zlib.error:
                    return "the PNG is damaged"
        return "the PNG is cut off" if whole and left else ""


def _min_png_bytes(header: bytes) -> int:
    """Return a lower bound of the bytes of a PNG's pixels before compression; 0 for a damaged header."""
    if len(header) != 13:
        return 0
    width, height, depth, color, method, filtering, interlaced = struct.unpack(">IIBBBBB", header)
    valid = depth in _PNG_DEPTHS.get(color, ()) and not method and not filtering and interlaced < 2
    if not valid or not 0 < width < 1 << 31 or not 0 < height < 1 << 31:
        return 0
    # A row has a filter byte and its pixels. The seven passes of an interlaced PNG have at least `height` rows in all,
    # each with a filter byte.
    return int(height * (1 + -(-width * depth * _PNG_CHANNELS[color] // 8)) if not interlaced else height)
