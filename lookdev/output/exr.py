"""The writer and the reader of frames as EXR: float32 R, G, B, A, and a header that states how the frame was rendered.

A file has one part, in scanlines. Header entries are string attributes named ``lookdev:<key>``. Numbers are strings,
too, because OpenEXR's numbers of 32 bits cannot store a 64-bit seed or an error estimate exactly. ``lookdev:checksum``
is a CRC-32 of all bytes of the file except its own 8 digits. To verify it takes a twentieth of the time that it takes
to decode the pixels.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

import numpy as np
import OpenEXR
from numpy.typing import ArrayLike

from lookdev.arrays import Floats32
from lookdev.cache import atomic_path, memory_file, output_errors
from lookdev.errors import OutputError
from lookdev.images import open_image, whole_image
from lookdev.space import CHROMATICITIES, INTEROP_IDS, OCIO_NAMES, REC709, Space, to_rec709

PREFIX = "lookdev:"
"""The beginning of the names of attributes that are header entries."""

MAX_PIXELS = 1 << 28
"""Largest number of pixels of a frame: 16384 x 16384."""

_BLOCK_ROWS = 16  # rows that ZIP_COMPRESSION compresses together, as a block
_CHECKSUM = (PREFIX + "checksum").encode()
_NO_CHECKSUM = b"00000000"  # the digits that the checksum replaces when the file is written
_STRIP_BYTES = 1 << 20  # number of bytes to read at once
_MAGIC = b"\x76\x2f\x31\x01"  # the first bytes of an EXR
_HEADER_BYTES = 1 << 14  # number of bytes within which a header usually ends

Attributes = dict[bytes, tuple[bytes, int, bytes]]
"""The attributes of an EXR by name: for each, the type of its value, the value's offset in the file, and its bytes."""


def write_frame(
    path: Path,
    beauty: ArrayLike,
    alpha: ArrayLike,
    header: Mapping[str, str | float | int],
    layers: Mapping[str, ArrayLike] | None = None,
    *,
    planes: Mapping[str, ArrayLike] = MappingProxyType({}),
    attributes: Mapping[str, str] = MappingProxyType({}),
    space: Space = REC709,
) -> None:
    """Write a frame, complete or not at all, and make its folders.

    beauty, layers
        Premultiplied radiance in `space`, (H, W, 3); `layers` has further pictures of this kind by name.
    alpha
        Coverage in [0, 1], (H, W).
    header
        The header entries by key; `read_header` returns their values as strings.
    planes
        Further channels by name, (H, W).
    attributes
        Attributes of the EXR, written under their own names, without `PREFIX`.

    Raises OutputError where the shapes differ or the file cannot be written.
    """
    rgb, coverage = np.asarray(beauty, np.float32), np.asarray(alpha, np.float32)
    if rgb.shape != (*coverage.shape, 3) or coverage.ndim != 2:
        raise OutputError(f"{path}: beauty {rgb.shape} and alpha {coverage.shape} must be (H, W, 3) and (H, W)")
    pictures = {"": rgb, **{f"{name}.": np.asarray(layer, np.float32) for name, layer in (layers or {}).items()}}
    channels = {
        f"{prefix}{name}": np.ascontiguousarray(picture[..., index])
        for prefix, picture in pictures.items()
        for index, name in enumerate("RGB")
    }
    channels["A"] = np.ascontiguousarray(coverage)
    channels |= {name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()}
    entries: dict[str, object] = {PREFIX + key: str(value) for key, value in header.items()}
    entries |= attributes
    if space != REC709:  # an EXR without the attribute has primaries of Rec.709
        entries |= {"chromaticities": CHROMATICITIES[space], "colorInteropID": INTEROP_IDS[space]}
    entries |= {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    entries[_CHECKSUM.decode()] = _NO_CHECKSUM.decode()
    with output_errors(path, "cannot write the frame"), atomic_path(path) as temporary, memory_file(temporary) as name:
        with OpenEXR.File(entries, channels) as exr:
            exr.write(name)
        with Path(name).open("r+b") as stream:
            _, offset, _ = _read_attributes(stream)[0][_CHECKSUM]
            checksum = _checksum(stream, offset)
            stream.seek(offset)
            stream.write(checksum)


def read_frame(path: Path) -> tuple[Floats32, Floats32]:
    """Return beauty (H, W, 3) and alpha (H, W) of a frame, as `write_frame` got them.

    Raises OutputError where the file is damaged.
    """
    try:
        with open_image(path, OutputError, MAX_PIXELS) as image:
            names = list(image.spec().channelnames)
            if not {*"RGBA"} <= set(names):
                raise OutputError(f"{path}: has channels {', '.join(names[:20])}")
            pixels = whole_image(image, path, range(len(names)), OutputError)
        with path.open("rb") as stream:
            _verify_checksum(path, stream, _read_attributes(stream)[0])
    except (OutputError, OSError, ValueError, struct.error) as error:
        reason = str(error).removeprefix(f"{path}: ")
        raise OutputError(f"{path}: not a whole frame with channels R, G, B, A: {reason}") from error
    beauty = [names.index(name) for name in "RGB"]
    return np.ascontiguousarray(pixels[..., beauty]), np.ascontiguousarray(pixels[..., names.index("A")])


def read_rec709(path: Path) -> tuple[Floats32, Floats32]:
    """Return beauty (H, W, 3), converted to linear Rec.709, and alpha (H, W) of a frame; raises as `read_frame`."""
    beauty, alpha = read_frame(path)
    return light_in_rec709(beauty, frame_space(path)), alpha


def light_in_rec709(light: Floats32, space: Space) -> Floats32:
    """Convert light (H, W, 3) from `space` to linear Rec.709."""
    return light if space == REC709 else to_rec709(light, space).astype(np.float32)


def frame_space(path: Path) -> Space:
    """Return the colour space of a frame that `read_frame` has read; raises OutputError where it is not known."""
    with open_image(path, OutputError, MAX_PIXELS) as image:
        name = image.spec().get_string_attribute(PREFIX + "space") or REC709
    if name not in OCIO_NAMES:
        raise OutputError(f"{path}: is in the space '{name}'; one of {', '.join(OCIO_NAMES)} would be right")
    return name


def read_layer(path: Path, name: str) -> Floats32 | None:
    """Return a layer (H, W, 3) of a frame as it was given to `write_frame`, or None if the frame has no such layer.

    The checksum is not verified: `read_frame` must have read the file before. Raises OutputError where the layer cannot
    be read.
    """
    with open_image(path, OutputError, MAX_PIXELS) as image:
        names = list(image.spec().channelnames)
        channels = [f"{name}.{channel}" for channel in "RGB"]
        if not {*channels} <= {*names}:
            return None
        pixels = whole_image(image, path, range(len(names)), OutputError)
    return np.ascontiguousarray(pixels[..., [names.index(channel) for channel in channels]])


def read_header(path: Path, *, check: bool = True) -> dict[str, str]:
    """Return the header that `write_frame` got, as strings; the header of another program's EXR is empty.

    No pixels are decoded. The key ``resolution`` is added: "width x height" in pixels. Raises OutputError if the header
    cannot be read, or if `check` is set and the file was changed since it was written.
    """
    try:
        if not path.is_file():
            raise ValueError("not a file")
        with path.open("rb") as stream:
            attributes, end = _read_attributes(stream)
            entries = {
                name.decode().removeprefix(PREFIX): value.decode()
                for name, (kind, _, value) in attributes.items()
                if kind == b"string" and name.startswith(PREFIX.encode())
            }
            if entries:
                left, top, right, bottom = struct.unpack("<4i", attributes[b"dataWindow"][2])
                width, height = right - left + 1, bottom - top + 1
                if check:
                    if not _has_all_rows(stream, end, height):
                        raise ValueError("its pixels are cut off")
                    _verify_checksum(path, stream, attributes)
                entries.pop("checksum", None)
                entries["resolution"] = f"{width} x {height}"
    except (ValueError, KeyError, OSError, struct.error) as error:
        raise OutputError(f"{path}: no readable EXR header: {error}") from error
    return entries


def _read_attributes(stream: BinaryIO) -> tuple[Attributes, int]:
    """Return the attributes in the first header of an EXR by name, and the offset of its end.

    Source: "OpenEXR File Layout". Raises ValueError or struct.error where it is not an EXR or its header is cut off.
    """
    size = _HEADER_BYTES  # read more bytes until they contain the whole header
    while True:
        stream.seek(0)
        data = stream.read(size)
        try:
            return _parse_attributes(data)
        except (ValueError, struct.error):
            if len(data) < size:
                raise
        size *= 4


def _parse_attributes(data: bytes) -> tuple[Attributes, int]:
    """Return what `_read_attributes` returns, from the first bytes of a file."""
    if data[:4] != _MAGIC:
        raise ValueError("not an EXR")
    attributes: Attributes = {}
    start = 8  # after the magic number and the version
    while data[start : start + 1] != b"\0":
        name_end = data.index(b"\0", start)
        kind_end = data.index(b"\0", name_end + 1)
        (size,) = struct.unpack_from("<I", data, kind_end + 1)
        name, kind, offset = data[start:name_end], data[name_end + 1 : kind_end], kind_end + 5
        start = offset + size
        attributes[name] = kind, offset, data[offset:start]
        if start >= len(data):
            raise ValueError("its header is cut off")
    return attributes, start + 1


def _has_all_rows(stream: BinaryIO, end: int, height: int) -> bool:
    """Return whether a file by `write_frame` has its last block of rows; `end` is the offset of the header's end."""
    blocks = -(-height // _BLOCK_ROWS)
    # The header is followed by the offset of each block, 8 bytes. A block begins with its row and its size.
    stream.seek(end)
    start = max(struct.unpack(f"<{blocks}Q", stream.read(8 * blocks)))
    stream.seek(start)
    _, size = struct.unpack("<iI", stream.read(8))
    return bool(start) and start + 8 + size <= os.fstat(stream.fileno()).st_size


def _verify_checksum(path: Path, stream: BinaryIO, attributes: Attributes) -> None:
    """Raise OutputError where a file was changed since it was written; nothing is checked without a checksum."""
    if _CHECKSUM in attributes:
        _, offset, checksum = attributes[_CHECKSUM]
        if checksum != _checksum(stream, offset):
            raise OutputError(f"{path}: it was changed since it was written: its checksum differs")


def _checksum(stream: BinaryIO, offset: int) -> bytes:
    """Return the checksum of a file as 8 digits; it is over all bytes but the stored checksum's digits at `offset`."""
    stream.seek(0)
    checksum = zlib.crc32(stream.read(offset))
    stream.seek(len(_NO_CHECKSUM), os.SEEK_CUR)
    while strip := stream.read(_STRIP_BYTES):
        checksum = zlib.crc32(strip, checksum)
    return b"%08x" % checksum
