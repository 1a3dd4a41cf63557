"""Checks that the file of a layer does not harm the process, before USD reads the file.

USD's text reader is recursive, so that a deeply nested file overflows the stack. USD also waits without end for a named
pipe. USD's binary reader trusts the table of sections in the file. Damage within a section is not checked here, and can
crash the reader.
"""

from __future__ import annotations

import re
import struct
import zipfile
from pathlib import Path
from typing import BinaryIO

import numpy as np

from lookdev.safe_text import environment_limit

BYTES_VARIABLE = "LOOKDEV_LAYER_BYTES"
"""Environment variable: the greatest size of a text layer in bytes. Binary layers, which USD maps, have no limit."""

DEFAULT_BYTES = 1 << 30
"""The greatest size of a text layer if the environment variable is not set."""

NOT_UTF8 = "holds text that is not UTF-8"
"""The problem of a file with text that is not UTF-8. A message of USD that quotes such text cannot be decoded."""

_MAX_DEPTH = 256  # levels of nested brackets in a text layer; USD's stack overflows at some ten thousand

# Matches text in which brackets have no meaning: strings, asset paths and comments. An unterminated string extends as
# far as possible, so that no text takes quadratic time.
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
# By byte: the change of the depth at an opening or a closing bracket. `_NO_BRACKETS` has all other bytes.
_DEPTH_STEPS = np.zeros(256, np.int8)
_DEPTH_STEPS[list(b"([{")] = 1
_DEPTH_STEPS[list(b")]}")] = -1
_NO_BRACKETS = bytes(np.flatnonzero(_DEPTH_STEPS == 0).astype(np.uint8))
# A binary layer (pxr/usd/sdf/crateFile.h) has the offset of a table of sections at its beginning. The table has the
# number of sections and, for each section, its name, start and size.
_MAGIC = b"PXR-USDC"
_CRATE_START, _COUNT, _SECTION = struct.Struct("<16xq64x"), struct.Struct("<Q"), struct.Struct("<16sqq")
_LOCAL_HEADER = struct.Struct("<26xHH")  # of a member of a package: the lengths of the name and of the extra field


def _layer_problem(stream: BinaryIO, begin: int, size: int) -> str:
    """Return why USD must not read a layer, which is the `size` bytes of a file from `begin`, or "" if it may."""
    stream.seek(begin)
    start = stream.read(min(len(_MAGIC), size))
    if start == _MAGIC:
        return "" if _is_whole(stream, begin, size) else "is damaged: a section of it is cut off"
    if not start.startswith((b"#usda", b"#sdf")):
        return ""  # neither the text reader nor the binary reader reads it
    if size > (limit := environment_limit(BYTES_VARIABLE, DEFAULT_BYTES, "bytes")):
        largest = f"at most {BYTES_VARIABLE} = {limit} bytes of text are read; a binary layer (.usdc) would be right"
        return f"has {size} bytes; {largest}"
    return _text_problem(start + stream.read(size - len(start)))


def _text_problem(text: bytes) -> str:
    """Return why USD must not read a text layer, or "" if it may."""
    if b"\0" in text:
        return "holds a character 0, which no text has"
    try:
        if not text.isascii():
            text.decode()
    except UnicodeDecodeError:
        return NOT_UTF8
    brackets = np.frombuffer(_QUOTED.sub(b"", text).translate(None, _NO_BRACKETS), np.uint8)
    depth = int(_DEPTH_STEPS[brackets].cumsum().max(initial=0))
    return f"is nested {depth} brackets deep; at most {_MAX_DEPTH} would be right" if depth > _MAX_DEPTH else ""


def _is_whole(stream: BinaryIO, begin: int, size: int) -> bool:
    """Return whether all sections of a binary layer lie within its `size` bytes from `begin`."""
    stream.seek(begin)
    start = stream.read(min(_CRATE_START.size, size))
    if len(start) < _CRATE_START.size:
        return False
    (table,) = _CRATE_START.unpack(start)
    if not _CRATE_START.size <= table <= size - _COUNT.size:
        return False
    stream.seek(begin + table)
    (count,) = _COUNT.unpack(stream.read(_COUNT.size))
    if count > (size - table) // _SECTION.size:
        return False
    sections = _SECTION.iter_unpack(stream.read(count * _SECTION.size))
    return all(first >= 0 <= length <= size - first for _, first, length in sections)


def _package_problem(stream: BinaryIO) -> str:
    """Return why USD must not read the layers in a package, a zip file, or "" if it may."""
    try:
        with zipfile.ZipFile(stream) as archive:
            for member in archive.infolist():
                stream.seek(member.header_offset)
                name_length, extra_length = _LOCAL_HEADER.unpack(stream.read(_LOCAL_HEADER.size))
                begin = member.header_offset + _LOCAL_HEADER.size + name_length + extra_length
                if problem := _layer_problem(stream, begin, member.compress_size):
                    return f"has a member {member.filename}, which {problem}"
    except (zipfile.BadZipFile, NotImplementedError, struct.error) as error:
        return f"is not a package that can be read: {error}"
    return ""


def layer_problem(layer: Path) -> str:
    """Return why USD must not read a file, as a predicate such as "is not a file", or "" if it may."""
    if not layer.is_file():
        return "is not a file"
    try:
        with layer.open("rb") as stream:
            if stream.read(2) == b"PK":
                return _package_problem(stream)
            return _layer_problem(stream, 0, layer.stat().st_size)
    except OSError as error:
        return f"cannot be read: {error.strerror}"
