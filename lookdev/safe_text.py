"""The reader of text files that a user gives, and parsers of TOML and JSON; also the format of tables as text.

The content of such files is not trusted. Reading a named pipe or a device could wait without end, a sparse file could
fill the memory, and deep nesting could overflow Python's stack. Each of these raises a `TextError` that states the
reason.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from lookdev.errors import FaultsError, OutputError

MAX_BYTES = 64 << 20
"""The largest size of a text file in bytes, unless a caller states another limit."""

MAX_DEPTH = 32
"""The largest depth of nested tables, objects and lists."""

# A dotted TOML key (a.b.c) with more than MAX_DEPTH parts: the time and memory of Python's parser grow with the square
# of their number.
_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_DEEP_KEY = re.compile(rf"(?:^|[\[{{,])[ \t]*(?:{_PART}[ \t]*\.[ \t]*){{{MAX_DEPTH}}}", re.MULTILINE)

_HINT = "a plain file with text would be right"


class TextError(FaultsError):
    """A text file cannot be read, or its content is not what it should be."""


def environment_limit(variable: str, default: int, unit: str) -> int:
    """Return the limit in an environment variable, or `default` if it is not set.

    Raises OutputError where the value is not a number of `unit`, from 1 to 10^12.
    """
    text = os.environ.get(variable, str(default))
    if not re.fullmatch(r"[1-9][0-9]{0,11}", text):
        raise OutputError(f"{variable} is {text[:40]!a}; a number of {unit} from 1 to 10^12 is needed")
    return int(text)


def has_text_path(file: Path) -> bool:
    """Return whether the path of a file is text in UTF-8; USD and the image libraries cannot open other paths."""
    try:
        str(file).encode()
    except UnicodeEncodeError:
        return False
    return True


def read_bytes(file: Path, largest: int = MAX_BYTES) -> bytes:
    """Return the content of a regular file of at most `largest` bytes; raises TextError."""
    try:
        if file.exists() and not file.is_file():
            raise TextError.at(file, "", "is a folder" if file.is_dir() else "is a pipe, a socket or a device", _HINT)
        if (size := file.stat().st_size) > largest:
            raise TextError.at(file, "", f"has {size} bytes", f"at most {largest} are read")
        return file.read_bytes()
    except OSError as error:
        raise TextError.at(file, "", f"cannot be read: {error.strerror}") from None


def read_text(file: Path, largest: int = MAX_BYTES) -> str:
    """Return the text of a file of at most `largest` bytes; raises TextError, also where it is not UTF-8."""
    return decode(read_bytes(file, largest), file)


def decode(data: bytes, file: object) -> str:
    """Return UTF-8 `data` as text, without a byte order mark; raises TextError with line and column.

    `file` names the source of the data in messages, here and below.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, column = data.count(b"\n", 0, error.start) + 1, error.start - data.rfind(b"\n", 0, error.start)
        raise TextError.at(file, f"line {line}, column {column}", "not UTF-8 text", "save it as UTF-8") from None


def parse_toml(text: str, file: object) -> dict[str, Any]:
    """Return the tables of a TOML text; raises TextError with line and column."""
    if _DEEP_KEY.search(text):
        raise _depth_error(file)
    return dict(_parse(tomllib.loads, text, file, "TOML"))


def parse_json(text: str | bytes, file: object) -> Any:
    """Return the value of a JSON text; raises TextError with line and column."""
    return _parse(json.loads, text, file, "JSON")


def align_columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the rows of a table as lines of text with aligned columns.

    Rows may have fewer cells than others. Columns without text are left out.
    """
    widths = [max(map(len, column)) for column in zip_longest(*rows, fillvalue="")]
    return [
        "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=False) if width).rstrip()
        for row in rows
    ]


def read_json_object(file: Path, largest: int = MAX_BYTES) -> dict[str, Any]:
    """Return the JSON object in a file of at most `largest` bytes; empty where the file is missing or damaged."""
    try:
        data = parse_json(read_text(file, largest), file)
    except TextError:
        return {}
    return data if isinstance(data, dict) else {}


def _parse(parse: Callable[[Any], Any], text: str | bytes, file: object, language: str) -> Any:
    """Return the result of a parser, unless it is nested too deep; turn the parser's errors into TextError."""
    try:
        data = parse(text)
    except RecursionError:
        data = None
    except ValueError as error:  # Python also raises it for an integer with too many digits
        message, _, where = str(error).removesuffix(")").partition(" (at ")
        if isinstance(error, json.JSONDecodeError):
            message, where = error.msg, f"line {error.lineno}, column {error.colno}"
        message = message.partition("; use sys.")[0]
        raise TextError.at(file, where, f"not {language}: {message}") from None
    else:
        if not _is_deep(data):
            return data
    raise _depth_error(file)


def _depth_error(file: object) -> TextError:
    return TextError.at(file, "", f"has tables or lists more than {MAX_DEPTH} deep", "flatten it")


def _is_deep(data: object) -> bool:
    """Return whether tables and lists in parsed data are nested more than `MAX_DEPTH` deep."""
    level = [data]
    for _ in range(MAX_DEPTH + 1):
        nested = [value for value in level if isinstance(value, Mapping | list)]
        level = [item for value in nested for item in (value.values() if isinstance(value, Mapping) else value)]
        if not level:
            return False
    return True
