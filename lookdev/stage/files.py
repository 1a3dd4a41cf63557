"""Files that USD can read without harm.

USD's reader of text recurses, so that a deeply nested file overflows its stack, and it waits for ever for a named pipe.
Its reader of binary layers trusts their table of sections. What is damaged within a section can still crash it.
"""

from __future__ import annotations

import re
import struct
import zipfile
from pathlib import Path
from typing import BinaryIO

import numpy as np

from lookdev.text import stated_limit

BYTES_VARIABLE = "LOOKDEV_LAYER_BYTES"
"""Environment variable: the largest number of bytes of a text layer. Binary layers, which USD maps, have no limit."""

DEFAULT_BYTES = 1 << 30

NOT_UTF8 = "holds text that is not UTF-8"
"""What is said of a file that USD quotes in vain."""

_DEEPEST = 256  # brackets inside each other in a text layer; USD's stack ends at some ten thousand

# Text in which a bracket has no meaning. An unterminated string is as long as possible: no text takes quadratic time.
_QUOTED = re.compile(
    rb'"""(?:[^"\\]++|\\.|"(?!""))*+(?:""")?+'
    rb"|'''(?:[^'\\]++|\\.|'(?!''))*+(?:''')?+"
    rb'|"(?:[^"\\\n]++|\\.)*+"?+'
    rb"|'(?:[^'\\\n]++|\\.)*+'?+"
    rb"|@@@(?:[^@]++|@(?!@@))*+(?:@@@)?+"
    rb"|@[^@\n]*+@?+"
    rb"|\#[^\n]*+",
    re.DOTALL,
)
_STEPS = np.zeros(256, np.int8)
_STEPS[list(b"([{")] = 1
_STEPS[list(b")]}")] = -1
_OTHERS = bytes(np.flatnonzero(_STEPS == 0).astype(np.uint8))
# Binary layers, by pxr/usd/sdf/crateFile.h: their start has the place of a table of sections: name, start and size.
_MAGIC = b"PXR-USDC"
_CRATE, _COUNT, _SECTION = struct.Struct("<16xq64x"), struct.Struct("<Q"), struct.Struct("<16sqq")
_LOCAL = struct.Struct("<26xHH")  # before a member of a package: the lengths of its name and of what else follows


def _problem(stream: BinaryIO, begin: int, size: int) -> str:
    """Return why USD must not read a layer, a part of a file; '' where it may."""
    stream.seek(begin)
    start = stream.read(min(len(_MAGIC), size))
    if start == _MAGIC:
        return "" if _is_whole(stream, begin, size) else "is damaged: a section of it is cut off"
    if not start.startswith((b"#usda", b"#sdf")):
        return ""
    if size > (most := stated_limit(BYTES_VARIABLE, DEFAULT_BYTES, "bytes")):
        largest = f"at most {BYTES_VARIABLE} = {most} bytes of text are read; a binary layer (.usdc) would be right"
        return f"has {size} bytes; {largest}"
    return _text_problem(start + stream.read(size - len(start)))


def _text_problem(text: bytes) -> str:
    if b"\0" in text:
        return "holds a character 0, which no text has"
    try:
        if not text.isascii():
            text.decode()
    except UnicodeDecodeError:
        return NOT_UTF8
    brackets = np.frombuffer(_QUOTED.sub(b"", text).translate(None, _OTHERS), np.uint8)
    depth = int(_STEPS[brackets].cumsum().max(initial=0))
    return f"is nested {depth} brackets deep; at most {_DEEPEST} would be right" if depth > _DEEPEST else ""


def _is_whole(stream: BinaryIO, begin: int, size: int) -> bool:
    """Return whether the sections of a binary layer in a file lie within it."""
    stream.seek(begin)
    start = stream.read(min(_CRATE.size, size))
    if len(start) < _CRATE.size:
        return False
    (table,) = _CRATE.unpack(start)
    if not _CRATE.size <= table <= size - _COUNT.size:
        return False
    stream.seek(begin + table)
    (count,) = _COUNT.unpack(stream.read(_COUNT.size))
    if count > (size - table) // _SECTION.size:
        return False
    sections = _SECTION.iter_unpack(stream.read(count * _SECTION.size))
    return all(first >= 0 <= length <= size - first for _, first, length in sections)


def _package_problem(stream: BinaryIO) -> str:
    """Return why USD must not read the layers in a package; '' where it may."""
    try:
        with zipfile.ZipFile(stream) as archive:
            for member in archive.infolist():
                stream.seek(member.header_offset)
                begin = member.header_offset + _LOCAL.size + sum(_LOCAL.unpack(stream.read(_LOCAL.size)))
                if problem := _problem(stream, begin, member.compress_size):
                    return f"has a member {member.filename}, which {problem}"
    except (zipfile.BadZipFile, NotImplementedError, struct.error) as error:
        return f"is no package that can be read: {error}"
    return ""


def layer_problem(layer: Path) -> str:
    """Return why USD must not read a file, as the end of a sentence about it; '' where it may."""
    if not layer.is_file():
        return "is not a file"
    try:
        with layer.open("rb") as stream:
            if stream.read(2) == b"PK":
                return _package_problem(stream)
            return _problem(stream, 0, layer.stat().st_size)
    except OSError as error:
        return f"cannot be read: {error.strerror}"
