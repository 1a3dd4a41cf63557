"""The cache of derived files, and atomic writing: a file is written whole or not at all.

The cache has two kinds of files. The folder ``content`` has files named by the SHA-256 of their bytes: `Content`. All
other folders have records, which are small JSON files. A record has the value that was stored for a key, and its
checksum; the value is numbers or names of content files. A parameter `room` is the name of a folder of records,
relative to the cache. Parameters `rooms`, of the two functions that digest code, are folders of the package instead.

Each file is checked when it is read, a content file once in a process unless it changes. A damaged file counts as
missing: the user gets a note, and the file is made again.
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
from lookdev.safe_text import has_text_path

_CODE_SUFFIXES = {".py", ".h", ".osl", ".csv", ".json"}  # suffixes of the files that `package_digest` covers
_notes: list[str] = []  # notes for the user on damaged files, until `take_notes`
_digests: dict[tuple[Path, int, int, int], str] = {}  # the SHA-256 of files, by `_file_state`


def cache_dir(*parts: str) -> Path:
    """Return a folder of the cache, ``$LOOKDEV_CACHE`` or else ``$XDG_CACHE_HOME/lookdev``; create it if it is missing.

    Raises OutputError where the folder cannot be created, or its path has characters that a shader cannot hold.
    """
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    root = os.environ.get("LOOKDEV_CACHE") or str(Path(base) / "lookdev")
    if '"' in root or "\\" in root or not root.isprintable():
        # Compiled shaders hold paths unescaped: with these characters, Cycles would render black without an error.
        raise OutputError(
            f"the cache folder {root!a} has a quotation mark, a backslash or a control character in its path; "
            "set LOOKDEV_CACHE to another"
        )
    folder = Path(root).joinpath(*parts)
    with _cache_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextmanager
def atomic_path(final: Path) -> Iterator[Path]:
    """Yield a temporary path beside `final`; on success it is renamed to `final`, on failure it is removed.

    The temporary name has the suffix of `final`, since writers choose a format by it. It starts with a dot, so that a
    file left by ``kill -9`` never counts as a frame. An OSError in the block gets the file name of `final`, unless it
    names another file; the error of a full disk always gets this name.
    """
    try:
        if not final.name or final.is_dir():
            raise OSError(errno.EISDIR, "is a folder", str(final))
        if not has_text_path(final):
            raise OSError(errno.EILSEQ, "its path is not UTF-8", str(final))
        final.parent.mkdir(parents=True, exist_ok=True)
        with _temporary_path(final) as temporary:
            yield temporary
            temporary.replace(final)
    except OSError as error:
        # On a full disk, the error of a copy names the source of the copy.
        if error.filename is None or error.errno == errno.ENOSPC:
            error.filename = str(final)
        raise


def write_file(file: Path, content: str | bytes) -> None:
    """Write a text as UTF-8, or bytes, complete or not at all; raises OSError."""
    with atomic_path(file) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def output_errors(path: Path, problem: str = "cannot be written", *, name_file: bool = False) -> Iterator[None]:
    """Turn an OSError of the block into an OutputError that states `path`, the problem and the reason.

    With `name_file`, it states the file that the OSError names, if it names one, instead of `path`.
    """
    try:
        yield
    except OSError as error:
        file = (name_file and error.filename) or path
        raise OutputError(f"{file}: {problem}: {error.strerror or error}") from error


@contextmanager
def memory_file(file: Path) -> Iterator[str]:
    """Yield the name of a file in memory, to which a library writes; then write its content to `file`.

    So a full disk raises an OSError. The image libraries and OSL's compiler, which do not report the data that they
    lose as they close a file, need not write to the disk themselves.
    """
    with os.fdopen(os.memfd_create("lookdev"), "rb") as memory:
        yield f"/proc/self/fd/{memory.fileno()}"
        with file.open("wb") as stream:
            shutil.copyfileobj(memory, stream, 1 << 20)


@contextmanager
def _temporary_path(final: Path) -> Iterator[Path]:
    """Yield a path beside `final` that no process uses; remove its file at the end, if it still exists."""
    temporary = final.with_name(f".{final.stem}.{process_name()}-{secrets.token_hex(4)}{final.suffix}")
    try:
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)


def process_name() -> str:
    """Return the name of this process for its temporary files, unique among the processes of all machines."""
    return _random_name(os.getpid())


@cache
def _random_name(process: int) -> str:
    """Return a random name for a process id: after a fork, the child gets a name of its own."""
    return secrets.token_hex(4)


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@cache
def code_digest(*rooms: str) -> str:
    """Return a digest of the code of the subpackages `rooms`, and of the versions of Python and NumPy.

    `rooms` are names of folders in the package lookdev; without any, the digest is of the whole package. The keys of
    derived files contain the digest, so that no version of the code loads the files of another.
    """
    import numpy as np

    return hashlib.sha256(f"{sys.version} {np.__version__} {package_digest(*rooms)}".encode()).hexdigest()


@cache
def package_digest(*rooms: str) -> str:
    """Return a digest of the code of the subpackages `rooms`, or of the whole package if there are none.

    The digest is equal on every machine.
    """
    digest = hashlib.sha256()
    package = Path(__file__).parent
    for folder in [package / room for room in rooms] or [package]:
        assert folder.is_dir(), f"lookdev has no room {folder.name}"
        for file in sorted(file for file in folder.rglob("*") if file.suffix in _CODE_SUFFIXES and file.is_file()):
            digest.update(f"\0{file.relative_to(package)}\0".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


def link_or_copy(source: Path, target: Path) -> None:
    """Link `target` to `source`, or copy it where the file system has no hard links; atomic in both cases."""
    with atomic_path(target) as temporary:
        try:
            os.link(source, temporary)
        except OSError:
            shutil.copy2(source, temporary)


@dataclass(frozen=True)
class Content:
    """A file named by its content: the SHA-256 of its bytes in hexadecimal, and its suffix.

    A `Content` means the same bytes on every machine. The file is in the folder ``content`` of the machine's cache,
    which is called the store below. A task that runs on another machine needs copies of its files in the store there.
    """

    digest: str
    suffix: str

    @classmethod
    def store_written(cls, suffix: str, write: Callable[[Path], object]) -> Self:
        """Store a new file: `write` gets a path, and writes the file there. Raises OutputError where that fails."""
        folder = cache_dir("content")
        with _cache_write_errors(folder), _temporary_path(folder / f"new{suffix}") as temporary:
            write(temporary)
            status = temporary.stat()
            content = cls(file_digest(temporary), suffix)
            if not content.is_whole():
                temporary.replace(content._stored_file)
                _digests[_file_state(content._stored_file, status)] = content.digest
        return content

    @classmethod
    def store_bytes(cls, data: bytes, suffix: str) -> Self:
        """Store a file with these bytes, unless the store has it; raises OutputError where that fails."""
        content = cls(hashlib.sha256(data).hexdigest(), suffix)
        return content if content.is_whole() else cls.store_written(suffix, lambda path: path.write_bytes(data))

    @classmethod
    def store_copy(cls, file: Path) -> Self:
        """Store a copy of a file, unless the store has it; raises OSError where the file cannot be read."""
        content = cls(file.stem, file.suffix)  # correct if the file is in the store
        is_stored = file == content._stored_file and content.is_whole()
        return content if is_stored else cls.store_bytes(file.read_bytes(), file.suffix)

    @property
    def path(self) -> Path:
        """The path of the file on this machine; raises ContentError where the store lacks the file or it is damaged."""
        if not self.is_whole():
            raise ContentError(
                f"{self._stored_file.parent} lacks the file {self._stored_file.name}, which a task names; if it was "
                "damaged, the same command makes it again"
            )
        return self._stored_file

    def is_whole(self) -> bool:
        """Return whether the store has the file, undamaged; a damaged file is removed, with a note."""
        return is_whole(self._stored_file, self.digest)

    @property
    def _stored_file(self) -> Path:
        return cache_dir("content") / f"{self.digest}{self.suffix}"


def is_whole(file: Path, digest: str) -> bool:
    """Return whether a file of the cache exists and has this SHA-256; a damaged file is removed, with a note."""
    try:
        status = file.stat()
        if stat.S_ISREG(status.st_mode):
            state = _file_state(file, status)
            if state not in _digests:
                _digests[state] = file_digest(file)
            if _digests[state] == digest:
                return True
    except FileNotFoundError:
        return False
    except OSError:  # a file that cannot be read counts as damaged
        pass
    _discard(file)
    return False


def cached_files(room: str, key: str, make: Callable[[], tuple[Content, ...]]) -> tuple[Content, ...]:
    """Return the files that are stored for a key in the folder `room`; if one is missing, make all of them by `make`.

    The key identifies everything on which the files depend. `make` stores the files and returns them. Raises
    OutputError where the record of the key cannot be written.
    """
    if (files := load_cached_files(room, key)) is not None:
        return files
    files = make()
    store_cached(room, key, [[file.digest, file.suffix] for file in files])
    return files


def cached_file(room: str, key: str, suffix: str, write: Callable[[Path], object]) -> Content:
    """Return the file that is stored for a key, as `cached_files` does; if it is missing, make it by `write`."""
    (file,) = cached_files(room, key, lambda: (Content.store_written(suffix, write),))
    return file


def load_cached_files(room: str, key: str) -> tuple[Content, ...] | None:
    """Return the files that `cached_files` has stored for a key; None without a record, or where a file is missing."""
    match load_cached(room, key):
        case [*names]:
            files = tuple(Content(digest, suffix) for digest, suffix in names)
            if all(file.is_whole() for file in files):
                return files
    return None


def store_cached(room: str, key: str, value: Any) -> None:
    """Store a JSON value for a key in the folder `room` of the cache; raises OutputError where that fails."""
    record = _record(room, key)
    with _cache_write_errors(record), atomic_path(record) as temporary:
        temporary.write_text(json.dumps({"value": value, "checksum": _checksum(room, key, value)}))


def load_cached(room: str, key: str) -> Any:
    """Return the value that is stored for a key; None where there is none, or its record is damaged."""
    record = _record(room, key)
    try:
        # A folder, a pipe or the like in place of the record is not read, and counts as damaged.
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
    """Return a note for the user on each damaged file since the last call, and forget these notes."""
    notes = tuple(dict.fromkeys(_notes))
    _notes.clear()
    return notes


def _record(room: str, key: str) -> Path:
    """Return the path of the record of a key; create its folder if it is missing."""
    return cache_dir(room) / f"{key}.json"


def _checksum(room: str, key: str, value: object) -> str:
    """Return the checksum of a record with a value."""
    return hashlib.sha256(json.dumps([room, key, value]).encode()).hexdigest()


def _discard(file: Path) -> None:
    """Remove a damaged file, so that it can be made again, and note that for the user."""
    _notes.append(f"{file}: was damaged, and is made again")
    with suppress(OSError):  # the next write reports it
        if file.is_dir() and not file.is_symlink():
            shutil.rmtree(file)
        else:
            file.unlink()


@contextmanager
def _cache_write_errors(path: Path) -> Iterator[None]:
    """Raise OutputError for an error in the block, which writes to a path of the cache."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # OpenEXR raises RuntimeError
        reason = error.strerror or error if isinstance(error, OSError) else error
        raise OutputError(
            f"the cache cannot be written: {path}: {reason}; make room there, or set LOOKDEV_CACHE to another folder"
        ) from error


def _file_state(file: Path, status: os.stat_result) -> tuple[Path, int, int, int]:
    """Return path, inode, size and modification time of a file, one of which differs after the file has changed."""
    return file, status.st_ino, status.st_size, status.st_mtime_ns
