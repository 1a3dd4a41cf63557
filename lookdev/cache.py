"""Where derived files live, how any file is written, whole or not at all, and how the cache is checked as it is read.

The cache has two kinds of files. In ``content`` are files named by the SHA-256 of their bytes: `Content`. Everywhere
else are small records: what was made for a key, numbers or the names of such files, with a checksum. What is read is
checked, once in a process unless it changes. What is damaged counts as missing, with a note for the user: it is made
again.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Self

from lookdev.errors import ContentError, OutputError
from lookdev.text import has_text_path

_CODE = {".py", ".h", ".osl", ".csv", ".json"}
_notes: list[str] = []
_digests: dict[tuple[Path, int, int, int], str] = {}  # of files as they were when they were read


def cache_dir(*parts: str) -> Path:
    """Return (and make) a folder of the cache: ``$LOOKDEV_CACHE``, else ``$XDG_CACHE_HOME/lookdev``.

    Raises OutputError where it cannot be made, or its path has characters that a shader cannot hold.
    """
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    root = os.environ.get("LOOKDEV_CACHE") or str(Path(base) / "lookdev")
    if '"' in root or "\\" in root or not root.isprintable():
        # Compiled shaders hold paths, unescaped: Cycles would render black without an error.
        raise OutputError(
            f"the cache folder {root!a} has a quotation mark, a backslash or a control character in its path; "
            "set LOOKDEV_CACHE to another"
        )
    folder = Path(root).joinpath(*parts)
    with _reported(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextmanager
def atomic_path(final: Path) -> Iterator[Path]:
    """Yield a temporary path beside `final`; on success it is renamed to `final`, on failure it is removed.

    The temporary name keeps the suffix, by which writers choose a format, and starts with a dot, so that a file left
    by ``kill -9`` never counts as a frame. An OSError in the block names a file.
    """
    try:
        if not final.name or final.is_dir():
            raise OSError(errno.EISDIR, "is a folder", str(final))
        if not has_text_path(final):
            raise OSError(errno.EILSEQ, "its path is not UTF-8", str(final))
        final.parent.mkdir(parents=True, exist_ok=True)
        with _temporary(final) as temporary:
            yield temporary
            temporary.replace(final)
    except OSError as error:
        if error.filename is None or error.errno == errno.ENOSPC:  # that of a copy names what is copied
            error.filename = str(final)
        raise


@contextmanager
def from_memory(file: Path) -> Iterator[str]:
    """Yield the name of a file in memory, for a library to write to, and write its content to `file`.

    So a full disk is an OSError: the libraries of images and OSL's compiler do not report what is lost as they close.
    """
    with os.fdopen(os.memfd_create("lookdev"), "rb") as memory:
        yield f"/proc/self/fd/{memory.fileno()}"
        with file.open("wb") as stream:
            shutil.copyfileobj(memory, stream, 1 << 20)


@contextmanager
def _temporary(final: Path) -> Iterator[Path]:
    temporary = final.with_name(f".{final.stem}.{process_name()}-{secrets.token_hex(4)}{final.suffix}")
    try:
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)


def process_name() -> str:
    """Return the name of this process in the names of its temporary files, unlike that of any other on any machine."""
    return _name_of(os.getpid())


@cache
def _name_of(process: int) -> str:
    return secrets.token_hex(4)


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@cache
def code_digest(*rooms: str) -> str:
    """Return a digest of the code of some rooms of the package, by default of all, and of Python and NumPy.

    It is part of the key of what code makes, so that a version of it finds nothing of another.
    """
    import numpy as np

    return hashlib.sha256(f"{sys.version} {np.__version__} {package_digest(*rooms)}".encode()).hexdigest()


@cache
def package_digest(*rooms: str) -> str:
    """Return a digest of the code of some rooms of the package, by default of all: the same on every machine."""
    digest = hashlib.sha256()
    package = Path(__file__).parent
    for folder in [package / room for room in rooms] or [package]:
        assert folder.is_dir(), f"lookdev has no room {folder.name}"
        for file in sorted(file for file in folder.rglob("*") if file.suffix in _CODE and file.is_file()):
            digest.update(f"\0{file.relative_to(package)}\0".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


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
    def written(cls, suffix: str, write: Callable[[Path], object]) -> Self:
        """Put a file into the store that a function writes to a path; raises OutputError where that fails."""
        folder = cache_dir("content")
        with _reported(folder), _temporary(folder / f"new{suffix}") as temporary:
            write(temporary)
            status = temporary.stat()
            content = cls(file_digest(temporary), suffix)
            if not content.is_whole():
                temporary.replace(content._place)
                _digests[_state(content._place, status)] = content.digest
        return content

    @classmethod
    def holding(cls, data: bytes, suffix: str) -> Self:
        """Put data into the store, unless they are there; raises OutputError where that fails."""
        content = cls(hashlib.sha256(data).hexdigest(), suffix)
        return content if content.is_whole() else cls.written(suffix, lambda path: path.write_bytes(data))

    @classmethod
    def of(cls, file: Path) -> Self:
        """Put a copy of a file into the store, unless it is there; raises OSError where it cannot be read."""
        named = cls(file.stem, file.suffix)
        return named if file == named._place and named.is_whole() else cls.holding(file.read_bytes(), file.suffix)

    @property
    def path(self) -> Path:
        """Where the file is on this machine; raises ContentError where the store lacks it, or has another."""
        if not self.is_whole():
            raise ContentError(
                f"{self._place.parent} lacks the file {self._place.name}, which a task names; if it was damaged, the "
                "same command makes it again"
            )
        return self._place

    def is_whole(self) -> bool:
        """Return whether the store has the file; one that is damaged is removed, with a note."""
        return is_whole(self._place, self.digest)

    @property
    def _place(self) -> Path:
        return cache_dir("content") / f"{self.digest}{self.suffix}"


def is_whole(file: Path, digest: str) -> bool:
    """Return whether there is a file of the cache with this SHA-256; one that is damaged is removed, with a note."""
    try:
        status = file.stat()
        if stat.S_ISREG(status.st_mode):
            state = _state(file, status)
            if state not in _digests:
                _digests[state] = file_digest(file)
            if _digests[state] == digest:
                return True
    except FileNotFoundError:
        return False
    except OSError:  # as unreadable as what is damaged
        pass
    _discard(file)
    return False


def cached_files(room: str, key: str, make: Callable[[], tuple[Content, ...]]) -> tuple[Content, ...]:
    """Return what was made for a key, in a folder `room` of the cache; make it where a file of it is missing.

    The key names all that it depends on. `make` puts it into the store. Raises OutputError where it cannot be kept.
    """
    if (found := load_cached_files(room, key)) is not None:
        return found
    made = make()
    store_cached(room, key, [[content.digest, content.suffix] for content in made])
    return made


def load_cached_files(room: str, key: str) -> tuple[Content, ...] | None:
    """Return what `cached_files` has made for a key; None where there is nothing, or a file of it is missing."""
    match load_cached(room, key):
        case [*names]:
            found = tuple(Content(digest, suffix) for digest, suffix in names)
            if all(content.is_whole() for content in found):
                return found
    return None


def store_cached(room: str, key: str, value: Any) -> None:
    """Keep a value that JSON holds for a key, in a folder `room` of the cache; raises OutputError where that fails."""
    record = _record(room, key)
    with _reported(record), atomic_path(record) as temporary:
        temporary.write_text(json.dumps({"value": value, "checksum": _checksum(room, key, value)}))


def load_cached(room: str, key: str) -> Any:
    """Return the value that was kept for a key; None where there is none, or it is damaged."""
    record = _record(room, key)
    try:
        match json.loads(record.read_bytes()) if record.is_file() or not record.exists() else None:
            case {"value": value, "checksum": checksum} if checksum == _checksum(room, key, value):
                return value
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError):
        pass
    _discard(record)
    return None


def take_notes() -> tuple[str, ...]:
    """Return what was found damaged since the last call, for the user."""
    taken = tuple(dict.fromkeys(_notes))
    _notes.clear()
    return taken


def _record(room: str, key: str) -> Path:
    return cache_dir(room) / f"{key}.json"


def _checksum(room: str, key: str, value: object) -> str:
    return hashlib.sha256(json.dumps([room, key, value]).encode()).hexdigest()


def _discard(file: Path) -> None:
    """Remove what is damaged, so that it can be made again."""
    _notes.append(f"{file}: was damaged, and is made again")
    with suppress(OSError):  # writing reports it
        if file.is_dir() and not file.is_symlink():
            shutil.rmtree(file)
        else:
            file.unlink()


@contextmanager
def _reported(place: Path) -> Iterator[None]:
    """Report what fails in writing to a place in the cache."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # OpenEXR raises the second
        what = error.strerror or error if isinstance(error, OSError) else error
        raise OutputError(
            f"the cache cannot be written: {place}: {what}; make room there, or set LOOKDEV_CACHE to another folder"
        ) from error


def _state(file: Path, status: os.stat_result) -> tuple[Path, int, int, int]:
    """Return what differs where a file was changed or replaced."""
    return file, status.st_ino, status.st_size, status.st_mtime_ns
