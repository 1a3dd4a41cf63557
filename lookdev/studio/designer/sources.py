"""The files of edited looks: what they had when they were read, what an edit makes of them, and what is on disk now."""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from lookdev.cache import atomic_path
from lookdev.errors import LookdevError
from lookdev.material import Look
from lookdev.material.library.edit import reported_for
from lookdev.material.library.masks import IMAGES
from lookdev.material.library.stack import Outline, outline_of
from lookdev.material.usd import read_look

LARGEST = 64 << 20
"""Bytes of a file whose looks are edited."""


_MOST_IMAGES = 500
_LONGEST_EDIT = 600  # seconds


class ConflictError(LookdevError):
    """A file has been changed on disk since it was read or saved: what is in it would be lost."""

    def __init__(self, files: list[Path]) -> None:
        self.files = files
        super().__init__(f"{', '.join(map(str, files))}: changed on disk since the Designer read it")


@dataclass(frozen=True)
class Place:
    """Where a look is: a file, a prim, and the variants in which the job wears it."""

    file: Path
    prim: str
    variants: Mapping[str, str] = field(default_factory=dict)

    @property
    def key(self) -> str:
        return f"{self.file}<{self.prim}>"


@dataclass(frozen=True)
class Opened:
    """A look as it is read, and its layers and variants as its file has them."""

    look: Look
    outline: Outline


class Sources:
    """Contents of files, by path: `first` as read, and the digest of what is known to be on disk."""

    def __init__(self) -> None:
        self._first: dict[Path, bytes] = {}
        self._known: dict[Path, str] = {}
        self._stamps: dict[Path, tuple[tuple[int, int, int], str]] = {}
        self._read = lru_cache(256)(self._reading)

    def take(self, file: Path) -> None:
        """Note what a file has; raises LookdevError where it is too large, or is no USD layer."""
        if file in self._first:
            return
        if file.suffix not in (".usda", ".usd", ".usdc") or file.is_symlink():
            raise LookdevError(f"{file}: only looks in USD files, not links or packages, are edited here")
        if file.stat().st_size > LARGEST:
            raise LookdevError(f"{file} has more than {LARGEST >> 20} MiB: keep its materials in a file of their own")
        for left in file.parent.glob(f".*{file.stem}.designer-*{file.suffix}"):  # by a Designer that was killed
            with suppress(OSError):
                if time.time() - left.stat().st_mtime > _LONGEST_EDIT:
                    left.unlink()
        self._first[file] = file.read_bytes()
        self._known[file] = digest(self._first[file])

    def add(self, file: Path, content: bytes) -> None:
        """Note a file that is no look, with the content that was read, or that it has first where there is no file."""
        self._first[file] = content
        self._known[file] = self.on_disk(file) and digest(content)

    @property
    def files(self) -> list[Path]:
        """The files that were read."""
        return list(self._first)

    def content(self, files: Mapping[Path, bytes], file: Path) -> bytes:
        """Return the edited content of a file, or that which was read."""
        return files.get(file, self._first[file])

    def unsaved(self, files: Mapping[Path, bytes], file: Path) -> bool:
        """Return whether what is edited is not what is known to be on disk; no file is unsaved that is not edited."""
        if file not in self._first or (not self._known[file] and file not in files):
            return False
        return digest(self.content(files, file)) != self._known[file]

    def known(self, file: Path) -> str:
        """Return the digest of what is known to be on disk."""
        return self._known[file]

    def expect(self, file: Path, known: str) -> None:
        """Take another digest for what is known to be on disk."""
        self._known[file] = known

    def on_disk(self, file: Path) -> str:
        """Return the digest of what is on disk now; an empty string where there is no file."""
        try:
            status = file.stat()
            stamp = (status.st_ino, status.st_size, status.st_mtime_ns)
            if self._stamps.get(file, (None, ""))[0] != stamp:
                self._stamps[file] = stamp, digest(file.read_bytes())
        except OSError:
            return ""
        return self._stamps[file][1]

    def changed(self) -> list[Path]:
        """Return the files that others have changed."""
        return [file for file, known in self._known.items() if self.on_disk(file) != known]

    def write(self, file: Path, content: bytes, *, over: bool) -> None:
        """Write a file, whole or not at all; raises ConflictError where it was changed, unless `over`."""
        if not over and self.on_disk(file) != self._known[file]:
            raise ConflictError([file])
        with atomic_path(file) as temporary:
            temporary.write_bytes(content)
            if file.exists():
                shutil.copymode(file, temporary)
        self._known[file] = digest(content)

    @contextmanager
    def beside(self, file: Path, content: bytes) -> Iterator[Path]:
        """Yield a hidden copy of a file with another content, which is removed; faults are those of the file."""
        name = f".{file.stem}.designer-{os.getpid()}{file.suffix}"
        temporary = file.with_name(name)
        try:
            temporary.write_bytes(content)
        except PermissionError as error:
            hint = "copy the look to a folder of your own, and open it there"
            raise LookdevError(f"{file.parent}: cannot be written, so its looks cannot be edited; {hint}") from error
        try:
            with reported_for(file, temporary):
                yield temporary
        finally:
            temporary.unlink(missing_ok=True)

    def opened(self, place: Place, files: Mapping[Path, bytes], variants: Mapping[str, str], original: Look) -> Opened:
        """Return a look of edited files; raises LookError where it is none."""
        content = self.content(files, place.file)
        made = self._read(content, place.file, place.prim, tuple(sorted({**place.variants, **variants}.items())))
        return replace(made, look=replace(made.look, name=original.name, source=original.source))

    def _reading(self, content: bytes, file: Path, prim: str, variants: tuple[tuple[str, str], ...]) -> Opened:
        chosen = dict(variants)
        if content == self._first[file] and self.on_disk(file) == digest(content):
            return Opened(read_look(file, prim, chosen), outline_of(file, prim, chosen))
        with self.beside(file, content) as temporary:
            return Opened(read_look(temporary, prim, chosen), outline_of(temporary, prim, chosen))


def images_below(folder: Path) -> list[str]:
    """Return the images below a folder, relative to it, at most `_MOST_IMAGES`, without hidden ones."""
    found: list[str] = []
    for above, folders, files in os.walk(folder):
        folders[:] = sorted(each for each in folders if not each.startswith("."))
        names = [each for each in sorted(files) if each.lower().endswith(IMAGES) and not each.startswith(".")]
        found += [Path(above, each).relative_to(folder).as_posix() for each in names]
        if len(found) >= _MOST_IMAGES:
            break
    return found[:_MOST_IMAGES]


def digest(content: bytes) -> str:
    """Return the SHA-256 of a content."""
    return hashlib.sha256(content).hexdigest()
