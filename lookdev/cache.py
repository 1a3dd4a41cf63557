"""Where derived files live, and how any file is written: whole or not at all."""

from __future__ import annotations

import hashlib
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Self

from lookdev.errors import ContentError, OutputError


def cache_dir(*parts: str) -> Path:
    """Return (and make) a folder of the cache: ``$LOOKDEV_CACHE``, else ``$XDG_CACHE_HOME/lookdev``.

    Raises OutputError where its path has a quotation mark.
    """
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    root = os.environ.get("LOOKDEV_CACHE") or str(Path(base) / "lookdev")
    if '"' in root:
        # Compiled shaders hold their own path, unescaped: Cycles would render black without an error.
        raise OutputError(f"the cache folder {root} has a quotation mark in its path; set LOOKDEV_CACHE to another")
    folder = Path(root).joinpath(*parts)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextmanager
def atomic_path(final: Path) -> Iterator[Path]:
    """Yield a temporary path beside `final`; on success it is renamed to `final`, on failure it is removed.

    The temporary name keeps the suffix, by which writers choose a format, and starts with a dot, so that a file left
    by ``kill -9`` never counts as a frame.
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


def share(source: Path, target: Path) -> None:
    """Make `target` the same file as `source`, or a copy where the file system has no hard links; atomic."""
    with atomic_path(target) as temporary:
        try:
            os.link(source, temporary)
        except OSError:
            shutil.copy2(source, temporary)


@dataclass(frozen=True)
class Content:
    """A file named by its content: the SHA-256 of its bytes in hexadecimal, and its suffix.

    It names the same file on every machine. The bytes are in the folder ``content`` of the cache; to run a task on
    another machine, copy its files to that folder there.
    """

    digest: str
    suffix: str

    @classmethod
    def of(cls, file: Path) -> Self:
        """Put a file into the store, unless it is there, and return its name; raises OSError where that fails.

        Files of the cache are never edited in place, so the store links to them; of others it keeps a copy.
        """
        if file.is_relative_to(cache_dir()):
            status = file.stat()
            content = cls(_digest_of_version(file, status.st_ino, status.st_size, status.st_mtime_ns), file.suffix)
            if not content._place.exists():
                share(file, content._place)
            return content
        data = file.read_bytes()
        content = cls(hashlib.sha256(data).hexdigest(), file.suffix)
        if not content._place.exists():
            with atomic_path(content._place) as temporary:
                temporary.write_bytes(data)
        return content

    @property
    def path(self) -> Path:
        """Where the file is on this machine; raises ContentError where the store lacks it."""
        if not self._place.is_file():
            raise ContentError(f"{self._place.parent} lacks the file {self._place.name}, which a task names")
        return self._place

    @property
    def _place(self) -> Path:
        return cache_dir("content") / f"{self.digest}{self.suffix}"


@lru_cache(maxsize=4096)
def _digest_of_version(file: Path, inode: int, size: int, changed: int) -> str:
    return file_digest(file)
