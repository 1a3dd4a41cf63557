"""Where derived files live, and how any file is written: whole or not at all."""

from __future__ import annotations

import hashlib
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lookdev.errors import OutputError


def cache_dir(*parts: str) -> Path:
    """Return (and make) a folder of the cache: ``$LOOKDEV_CACHE``, else ``$XDG_CACHE_HOME/lookdev``.

    Raises
    ------
    OutputError
        Its path has a quotation mark, which compiled shaders cannot carry.
    """
    root = os.environ.get("LOOKDEV_CACHE")
    if not root:
        base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
        root = str(Path(base) / "lookdev")
    if '"' in root:
        # Compiled shaders hold their own path, unescaped: Cycles would not load them and render black, without a word.
        raise OutputError(f"the cache folder {root} has a quotation mark in its path; set LOOKDEV_CACHE to another")
    folder = Path(root).joinpath(*parts)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextmanager
def atomic_path(final: Path) -> Iterator[Path]:
    """Give a temporary path beside `final`; on success it is renamed to `final`, on failure it is removed.

    The temporary name keeps the suffix (writers choose a format by it) and starts with a dot, so that a file
    left by ``kill -9`` is never taken for a frame.
    """
    final.parent.mkdir(parents=True, exist_ok=True)
    temporary = final.with_name(f".{final.stem}.{os.getpid()}-{secrets.token_hex(4)}{final.suffix}")
    try:
        yield temporary
        temporary.replace(final)
    finally:
        temporary.unlink(missing_ok=True)


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
