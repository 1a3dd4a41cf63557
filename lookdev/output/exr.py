"""Frames as EXR: one part, scanlines, float32 R, G, B, A, and a header with the origin of the frame.

Header entries are string attributes named ``lookdev:<key>``. Numbers are strings too, because OpenEXR's numbers of 32
bits cannot hold a 64-bit seed or an error estimate exactly. ``lookdev:checksum`` is a CRC-32 of the file as it is on
disk, but for these 8 digits: it takes a twentieth of the time of decoding the pixels.
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
from numpy.typing import ArrayLike, NDArray

from lookdev.cache import atomic_path, from_memory
from lookdev.errors import OutputError
from lookdev.images import open_image, whole_image
from lookdev.space import CHROMATICITIES, INTEROP_IDS, OCIO_NAMES, REC709, Space, to_rec709

Floats = NDArray[np.float32]

PREFIX = "lookdev:"

LARGEST = 1 << 28
"""Pixels of a frame: 16384 x 16384."""

_ROWS_OF_A_BLOCK = 16  # of ZIP_COMPRESSION
_CHECKSUM = PREFIX + "checksum"
_NO_CHECKSUM = b"00000000"
_STRIP = 1 << 20  # bytes read at once


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
    """Write a frame, whole or not at all; makes folders.

    `beauty` is premultiplied radiance of a `space`, (H, W, 3), as are the other `layers` by their names; `alpha` is
    coverage in [0, 1], (H, W). `planes` (H, W) are further channels by their names, `attributes` entries of the
    header as they are. `read_header` returns `header` as strings. Raises OutputError where the shapes differ or
    the file cannot be written.
    """
    rgb, coverage = np.asarray(beauty, np.float32), np.asarray(alpha, np.float32)
    if rgb.shape != (*coverage.shape, 3) or coverage.ndim != 2:
        raise OutputError(f"{path}: beauty {rgb.shape} and alpha {coverage.shape} must be (H, W, 3) and (H, W)")
    pictures = {"": rgb, **{f"{name}.": np.asarray(each, np.float32) for name, each in (layers or {}).items()}}
    written = {
        f"{k}{name}": np.ascontiguousarray(p[..., i]) for k, p in pictures.items() for i, name in enumerate("RGB")
    }
    written["A"] = np.ascontiguousarray(coverage)
    written |= {name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()}
    entries: dict[str, object] = {PREFIX + key: str(value) for key, value in header.items()}
    entries |= attributes
    if space != REC709:  # that of an EXR without the attribute
        entries |= {"chromaticities": CHROMATICITIES[space], "colorInteropID": INTEROP_IDS[space]}
    entries |= {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    entries[_CHECKSUM] = _NO_CHECKSUM.decode()
    try:
        with atomic_path(path) as temporary, from_memory(temporary) as name:
            with OpenEXR.File(entries, written) as exr:
                exr.write(name)
            with Path(name).open("r+b") as stream:
                place = _attributes(stream)[_CHECKSUM.encode()]
                checksum = _checksum(stream, place)
                stream.seek(place)
                stream.write(checksum)
    except OSError as error:
        raise OutputError(f"{path}: cannot write the frame: {error.strerror}") from error


def read_frame(path: Path) -> tuple[Floats, Floats]:
    """Return beauty (H, W, 3) and alpha (H, W) of a frame as written; raises OutputError where it is damaged."""
    try:
        with open_image(path, OutputError, LARGEST) as image:
            names = list(image.spec().channelnames)
            if not {*"RGBA"} <= set(names):
                raise OutputError(f"{path}: has channels {', '.join(names[:20])}")
            pixels = whole_image(image, path, range(len(names)), OutputError)
        with path.open("rb") as stream:
            _check(path, stream, _attributes(stream))
    except (OutputError, OSError, struct.error) as error:
        reason = str(error).removeprefix(f"{path}: ")
        raise OutputError(f"{path}: not a whole frame with channels R, G, B, A: {reason}") from error
    beauty = [names.index(name) for name in "RGB"]
    return np.ascontiguousarray(pixels[..., beauty]), np.ascontiguousarray(pixels[..., names.index("A")])


def read_shown(path: Path) -> tuple[Floats, Floats]:
    """Return beauty and alpha as `read_frame`, the light in linear Rec.709, in which views and pages take it."""
    beauty, alpha = read_frame(path)
    space = space_of(path)
    return (beauty if space == REC709 else to_rec709(beauty, space).astype(np.float32)), alpha


def space_of(path: Path) -> Space:
    """Return the space of a frame that `read_frame` has read; raises OutputError for one that is not known."""
    with open_image(path, OutputError, LARGEST) as image:
        name = image.spec().get_string_attribute(PREFIX + "space") or REC709
    if name not in OCIO_NAMES:
        raise OutputError(f"{path}: is in the space '{name}'; one of {', '.join(OCIO_NAMES)} would be right")
    return name


def read_layer(path: Path, name: str) -> Floats | None:
    """Return a layer (H, W, 3) of a frame, as given to `write_frame`; None where it has none of this name.

    Only for a frame that `read_frame` has read: nothing is checked again. Raises OutputError where it cannot be read.
    """
    with open_image(path, OutputError, LARGEST) as image:
        names = list(image.spec().channelnames)
        wanted = [f"{name}.{channel}" for channel in "RGB"]
        if not {*wanted} <= {*names}:
            return None
        pixels = whole_image(image, path, range(len(names)), OutputError)
    return np.ascontiguousarray(pixels[..., [names.index(each) for each in wanted]])


def read_header(path: Path) -> dict[str, str]:
    """Return the header given to `write_frame`, as strings, without decoding pixels; empty for another EXR.

    It has the ``resolution`` of the pixels, "width x height", too. Raises OutputError where the header cannot be read,
    or the file was changed since it was written.
    """
    try:
        if not path.is_file():
            raise ValueError("not a file")
        with OpenEXR.File(str(path), header_only=True) as exr:
            entries = dict(exr.header())
        own = {key.removeprefix(PREFIX): str(value) for key, value in entries.items() if key.startswith(PREFIX)}
        if own:
            (left, top), (right, bottom) = (corner.tolist() for corner in entries["dataWindow"])
            width, height = right - left + 1, bottom - top + 1
            with path.open("rb") as stream:
                places = _attributes(stream)
                if not _has_all_rows(stream, height):
                    raise ValueError("its pixels are cut off")
                _check(path, stream, places)
            own.pop("checksum", None)
            own["resolution"] = f"{width} x {height}"
    except (RuntimeError, ValueError, KeyError, OSError, struct.error) as error:
        raise OutputError(f"{path}: no readable EXR header: {error}") from error
    return own


def _attributes(stream: BinaryIO) -> dict[bytes, int]:
    """Return where the value of each attribute is in an EXR, and go to what follows the last.

    Source: "OpenEXR File Layout". Raises struct.error where the header is cut off.
    """
    places = {}
    stream.seek(8)
    while name := _text(stream):
        _text(stream)  # its type
        (size,) = struct.unpack("<I", stream.read(4))
        places[name] = stream.tell()
        stream.seek(size, os.SEEK_CUR)
    return places


def _has_all_rows(stream: BinaryIO, height: int) -> bool:
    """Return whether a file that `write_frame` wrote has its last block of rows; the stream is behind its header."""
    blocks = -(-height // _ROWS_OF_A_BLOCK)
    start = max(struct.unpack(f"<{blocks}Q", stream.read(8 * blocks)))
    stream.seek(start)
    _, size = struct.unpack("<iI", stream.read(8))
    return bool(start) and start + 8 + size <= os.fstat(stream.fileno()).st_size


def _check(path: Path, stream: BinaryIO, places: Mapping[bytes, int]) -> None:
    """Raise OutputError where a file differs from what was written; one of an earlier version has no checksum."""
    place = places.get(_CHECKSUM.encode())
    if place is not None:
        expected = _checksum(stream, place)
        stream.seek(place)
        if stream.read(len(expected)) != expected:
            raise OutputError(f"{path}: it was changed since it was written: its checksum differs")


def _checksum(stream: BinaryIO, place: int) -> bytes:
    """Return the checksum of a file, but for what is at the place of the checksum itself, as 8 digits."""
    stream.seek(0)
    checksum = zlib.crc32(stream.read(place))
    stream.seek(len(_NO_CHECKSUM), os.SEEK_CUR)
    while part := stream.read(_STRIP):
        checksum = zlib.crc32(part, checksum)
    return b"%08x" % checksum


def _text(stream: BinaryIO) -> bytes:
    """Return what a stream has before the next byte 0."""
    text = bytearray()
    while (byte := stream.read(1)) not in (b"\0", b""):
        text += byte
    return bytes(text)
