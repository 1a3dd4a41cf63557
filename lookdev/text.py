"""Text files of any content: read whole or refused, and parsed to data whose nesting is bounded.

A named pipe or a device would be waited for without end, a sparse file fills the memory, and deep nesting ends Python's
stack. Each is a `TextError` that says so.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from lookdev.errors import Fault, FaultsError, OutputError

LARGEST = 64 << 20
"""Bytes of a text file that are read, unless its kind has a limit of its own."""

DEEPEST = 32
"""Tables, objects and lists inside each other."""

# A key of as many parts as are too deep, where a key may stand: the parser takes time and memory by their square.
_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_DEEP_KEY = re.compile(rf"(?:^|[\[{{,])[ \t]*(?:{_PART}[ \t]*\.[ \t]*){{{DEEPEST}}}", re.MULTILINE)

_HINT = "a plain file with text would be right"


class TextError(FaultsError):
    """A text file cannot be read, or does not hold what it should."""


def stated_limit(variable: str, default: int, unit: str) -> int:
    """Return a limit, which an environment variable may state; raises OutputError where it states no such number."""
    given = os.environ.get(variable, str(default))
    if not re.fullmatch(r"[1-9][0-9]{0,11}", given):
        raise OutputError(f"{variable} is {given[:40]!a}; a number of {unit} from 1 to 10^12 is needed")
    return int(given)


def has_text_path(file: Path) -> bool:
    """Return whether the path of a file is UTF-8: neither USD nor the libraries of images can open another."""
    try:
        str(file).encode()
    except UnicodeEncodeError:
        return False
    return True


def read_bytes(file: Path, largest: int = LARGEST) -> bytes:
    """Return the content of a regular file of at most `largest` bytes; raises TextError."""
    try:
        if file.exists() and not file.is_file():
            raise _refused(file, "is a folder" if file.is_dir() else "is a pipe, a socket or a device", _HINT)
        if (size := file.stat().st_size) > largest:
            raise _refused(file, f"has {size} bytes", f"at most {largest} are read")
        return file.read_bytes()
    except OSError as error:
        raise _refused(file, f"cannot be read: {error.strerror}") from None


def read_text(file: Path, largest: int = LARGEST) -> str:
    """Return the text of a file as `read_bytes`; raises TextError where it is not UTF-8."""
    return decode(read_bytes(file, largest), file)


def decode(data: bytes, file: object) -> str:
    """Return the UTF-8 text of `file`, with or without a mark at its start; raises TextError with line and column."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, column = data.count(b"\n", 0, error.start) + 1, error.start - data.rfind(b"\n", 0, error.start)
        where = f"line {line}, column {column}"
        raise TextError([Fault(str(file), where, "not UTF-8 text", "save it as UTF-8")]) from None


def parse_toml(text: str, file: object) -> dict[str, Any]:
    """Return the tables of a TOML text; raises TextError with line and column."""
    if _DEEP_KEY.search(text):
        raise _too_deep(file)
    return dict(_parsed(tomllib.loads, text, file, "TOML"))


def parse_json(text: str | bytes, file: object) -> Any:
    """Return the value of a JSON text; raises TextError with line and column."""
    return _parsed(json.loads, text, file, "JSON")


def _parsed(parse: Callable[[Any], Any], text: str | bytes, file: object, language: str) -> Any:
    try:
        data = parse(text)
    except RecursionError:
        data = None
    except ValueError as error:  # also of an integer with too many digits
        what, _, where = str(error).removesuffix(")").partition(" (at ")
        if isinstance(error, json.JSONDecodeError):
            what, where = error.msg, f"line {error.lineno}, column {error.colno}"
        what = what.partition("; use sys.")[0]
        raise TextError([Fault(str(file), where, f"not {language}: {what}")]) from None
    else:
        if not _is_deep(data):
            return data
    raise _too_deep(file)


def _too_deep(file: object) -> TextError:
    return _refused(file, f"has tables or lists more than {DEEPEST} deep", "flatten it")


def _is_deep(data: object) -> bool:
    level = [data]
    for _ in range(DEEPEST + 1):
        parts = [each for each in level if isinstance(each, Mapping | list)]
        level = [inner for each in parts for inner in (each.values() if isinstance(each, Mapping) else each)]
        if not level:
            return False
    return True


def _refused(file: object, what: str, hint: str = "") -> TextError:
    return TextError([Fault(str(file), "", what, hint)])
