"""The files of looks that the Designer edits: they are read once, opened with edits, and written when they are saved.

Edits are made in a hidden copy beside a file. The known digest of a file is the digest of its content when the Designer
last read or wrote it. If the digest of the file on disk differs, another program has changed the file.
"""

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
from lookdev.material.library.edit import report_faults_for
from lookdev.material.library.masks import IMAGE_SUFFIXES
from lookdev.material.library.stack import LookOutline, read_outline
from lookdev.material.usd import read_look

MAX_LOOK_BYTES = 64 << 20
"""Largest file whose looks can be edited, in bytes."""


_MAX_IMAGES = 500  # images that a page lists
_MAX_EDIT_SECONDS = 600  # an older hidden copy is left over from a Designer that was killed


class ConflictError(LookdevError):
    """A file has changed on disk since it was read or saved: saving would lose the change."""

    def __init__(self, files: list[Path]) -> None:
        self.files = files
        super().__init__(f"{', '.join(map(str, files))}: changed on disk since the Designer read it")


@dataclass(frozen=True)
class LookLocation:
    """The location of a look: a file, the path of a prim in it, and the variant of each set that the job chooses."""

    file: Path
    prim: str
    variants: Mapping[str, str] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """The key of the look in `EditState.variants`."""
        return f"{self.file}<{self.prim}>"


@dataclass(frozen=True)
class OpenedLook:
    """A look, and the outline of its layers and variants in its file."""

    look: Look
    outline: LookOutline


class SourceFiles:
    """The original contents of files, and the digests of the contents that are known to be on disk, by path.

    The known digest of a file that is not on disk is an empty string. The parameter `edited_contents` of methods has
    the present contents of all files with edits, by path.
    """

    def __init__(self) -> None:
        self._original_contents: dict[Path, bytes] = {}
        self._known_digests: dict[Path, str] = {}
        # For each file: its inode, size and modification time when it was last read, and its digest then.
        self._stamps: dict[Path, tuple[tuple[int, int, int], str]] = {}
        self._read_cached = lru_cache(256)(self._read_look)

    def track(self, file: Path) -> None:
        """Read a file of looks; raise LookdevError if it is too large, or is not a USD layer."""
        if file in self._original_contents:
            return
        if file.suffix not in (".usda", ".usd", ".usdc") or file.is_symlink():
            raise LookdevError(f"{file}: only looks in USD files, not links or packages, are edited here")
        if file.stat().st_size > MAX_LOOK_BYTES:
            raise LookdevError(
                f"{file} has more than {MAX_LOOK_BYTES >> 20} MiB: keep its materials in a file of their own"
            )
        for leftover in file.parent.glob(f".*{file.stem}.designer-*{file.suffix}"):  # of a Designer that was killed
            with suppress(OSError):
                if time.time() - leftover.stat().st_mtime > _MAX_EDIT_SECONDS:
                    leftover.unlink()
        self._original_contents[file] = file.read_bytes()
        self._known_digests[file] = digest(self._original_contents[file])

    def add(self, file: Path, content: bytes) -> None:
        """Add a file that is not a look, such as the job; `content` is its original content.

        The file need not be on disk.
        """
        self._original_contents[file] = content
        self._known_digests[file] = self.digest_on_disk(file) and digest(content)  # empty if it is not on disk

    @property
    def files(self) -> list[Path]:
        """The files that were read or added."""
        return list(self._original_contents)

    def content(self, edited_contents: Mapping[Path, bytes], file: Path) -> bytes:
        """Return the edited content of a file, or its original content."""
        return edited_contents.get(file, self._original_contents[file])

    def is_unsaved(self, edited_contents: Mapping[Path, bytes], file: Path) -> bool:
        """Return whether a file's content differs from the known content on disk; False for an unedited new file."""
        if file not in self._original_contents or (not self._known_digests[file] and file not in edited_contents):
            return False
        return digest(self.content(edited_contents, file)) != self._known_digests[file]

    def known_digest(self, file: Path) -> str:
        """Return the digest of the content that is known to be on disk; an empty string if there is no file."""
        return self._known_digests[file]

    def set_known_digest(self, file: Path, known_digest: str) -> None:
        """Set the digest of the content that is known to be on disk."""
        self._known_digests[file] = known_digest

    def digest_on_disk(self, file: Path) -> str:
        """Return the digest of the content on disk now; an empty string if there is no file."""
        try:
            status = file.stat()
            stamp = (status.st_ino, status.st_size, status.st_mtime_ns)
            if self._stamps.get(file, (None, ""))[0] != stamp:
                self._stamps[file] = stamp, digest(file.read_bytes())
        except OSError:
            return ""
        return self._stamps[file][1]

    def changed_files(self) -> list[Path]:
        """Return the files that other programs have changed."""
        return [file for file, known_digest in self._known_digests.items() if self.digest_on_disk(file) != known_digest]

    def write(self, file: Path, content: bytes, *, overwrite: bool) -> None:
        """Write a file, whole or not at all; unless `overwrite`, raise ConflictError if it has changed on disk."""
        if not overwrite and self.digest_on_disk(file) != self._known_digests[file]:
            raise ConflictError([file])
        with atomic_path(file) as temporary:
            temporary.write_bytes(content)
            if file.exists():
                shutil.copymode(file, temporary)
        self._known_digests[file] = digest(content)

    @contextmanager
    def copy_beside(self, file: Path, content: bytes) -> Iterator[Path]:
        """Yield a temporary, hidden file beside `file`, with `content`; messages about its faults name `file`."""
        name = f".{file.stem}.designer-{os.getpid()}{file.suffix}"
        temporary = file.with_name(name)
        try:
            temporary.write_bytes(content)
        except PermissionError as error:
            hint = "copy the look to a folder of your own, and open it there"
            raise LookdevError(f"{file.parent}: cannot be written, so its looks cannot be edited; {hint}") from error
        try:
            with report_faults_for(file, temporary):
                yield temporary
        finally:
            temporary.unlink(missing_ok=True)

    def open_look(
        self, location: LookLocation, edited_contents: Mapping[Path, bytes], variants: Mapping[str, str], original: Look
    ) -> OpenedLook:
        """Return the look at a location with edits; raise LookError if there is no valid look.

        `variants` replace variants of the location. The look gets the name and the source of `original`.
        """
        content = self.content(edited_contents, location.file)
        opened = self._read_cached(
            content, location.file, location.prim, tuple(sorted({**location.variants, **variants}.items()))
        )
        return replace(opened, look=replace(opened.look, name=original.name, source=original.source))

    def _read_look(self, content: bytes, file: Path, prim: str, variants: tuple[tuple[str, str], ...]) -> OpenedLook:
        """Return the look at a prim of a file with this content, which can differ from the content on disk."""
        choices = dict(variants)
        if content == self._original_contents[file] and self.digest_on_disk(file) == digest(content):
            return OpenedLook(read_look(file, prim, choices), read_outline(file, prim, choices))
        with self.copy_beside(file, content) as temporary:
            return OpenedLook(read_look(temporary, prim, choices), read_outline(temporary, prim, choices))


def images_below(folder: Path) -> list[str]:
    """Return the images below a folder, relative to it, without hidden ones: at most `_MAX_IMAGES`."""
    images: list[str] = []
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        names = [name for name in sorted(files) if name.lower().endswith(IMAGE_SUFFIXES) and not name.startswith(".")]
        images += [Path(parent, name).relative_to(folder).as_posix() for name in names]
        if len(images) >= _MAX_IMAGES:
            break
    return images[:_MAX_IMAGES]


def digest(content: bytes) -> str:
    """Return the SHA-256 digest of a content."""
    return hashlib.sha256(content).hexdigest()
