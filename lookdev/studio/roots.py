"""The files that a page may have read: those in folders and of names that the server was started with, and uploads."""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import AsyncIterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from lookdev.brdf.measured.files import read_grid
from lookdev.errors import LookdevError, ModelError, shortened

UPLOADS = "uploads"
LARGEST_UPLOAD = 64 << 20
"""Bytes of an uploaded file; a MERL binary has 33 MiB."""
MOST_UPLOADED = 512 << 20
"""Bytes of all uploaded files together."""

_ODD = re.compile(r"[^A-Za-z0-9._-]+")
_MOST_LISTED = 500


@dataclass
class Roots:
    """Files by names that a page uses: ``<root>/<path>`` of a folder, or the name of a single file.

    `uploads` is a folder that the server owns, empty when it starts.
    """

    uploads: Path
    named: dict[str, Path] = field(default_factory=dict)
    _size: int = 0

    def __post_init__(self) -> None:
        self.named[UPLOADS] = self.uploads

    def add(self, path: Path) -> str:
        """Name a folder or a file, and return the name; raises LookdevError where there is none."""
        whole = path.absolute()
        if not whole.exists():
            raise LookdevError(f"{path}: no such file or folder")
        for name, known in self.named.items():
            if known == whole:
                return name
        plain = _ODD.sub("_", whole.name) or "root"
        names = [plain, *(f"{number}_{plain}" for number in range(2, 1000))]
        name = next(each for each in names if each not in self.named)
        self.named[name] = whole
        return name

    def locate(self, name: str) -> Path:
        """Return the file of a name.

        Raises LookdevError where the name is outside of the roots, also by ``..`` or by a link.
        """
        parts = PurePosixPath(name).parts
        refused = LookdevError(f"'{shortened(name, 80)}' is not among the files of this server; start it with --root")
        if not parts or "\0" in name or parts[0] not in self.named:
            raise refused
        root = self.named[parts[0]]
        place = root.joinpath(*parts[1:])
        try:
            inside = place.resolve().is_relative_to(root.resolve())
        except (OSError, RuntimeError):
            inside = False
        if not inside or ".." in parts:
            raise refused
        return place

    def path_words(self, words: str) -> str:
        """Return words for a command line: with the paths of files in place of names."""
        for name in sorted(self.named, key=len, reverse=True):
            words = re.sub(rf"(^|[=]){re.escape(name)}(?=$|[/:@#,])", lambda m: f"{m[1]}{self.named[name]}", words)  # noqa: B023
        return words

    def listed(self, suffixes: Sequence[str]) -> Iterator[str]:
        """Yield the names of files with some suffixes, at most `_MOST_LISTED` of a root, without hidden ones."""
        for name, root in self.named.items():
            if root.is_file():
                yield name
                continue
            count = 0
            for folder, folders, files in os.walk(root):
                folders[:] = sorted(each for each in folders if not each.startswith("."))
                for file in sorted(files):
                    if file.lower().endswith(tuple(suffixes)) and not file.startswith(".") and count < _MOST_LISTED:
                        count += 1
                        yield str(PurePosixPath(name, Path(folder, file).relative_to(root).as_posix()))

    async def upload(self, name: str, chunks: AsyncIterable[bytes]) -> str:
        """Keep a file of measured reflectance that a page sends, and return its name.

        Raises LookdevError where it is too large, or no such file.
        """
        digest, size = hashlib.sha256(), 0
        with tempfile.NamedTemporaryFile(dir=self.uploads, delete=False) as stream:
            temporary = Path(stream.name)
            try:
                async for chunk in chunks:
                    size += len(chunk)
                    if size > LARGEST_UPLOAD:
                        raise LookdevError(
                            f"more than {LARGEST_UPLOAD >> 20} MiB; a measurement of less would be right"
                        )
                    if self._size + size > MOST_UPLOADED:
                        raise LookdevError(f"uploads have {MOST_UPLOADED >> 20} MiB together; start the server again")
                    digest.update(chunk)
                    stream.write(chunk)
                stream.flush()
                self._check(temporary, name)
                plain = _ODD.sub("_", PurePosixPath(name).name)[-60:] or "upload"
                kept = f"{digest.hexdigest()[:8]}-{plain}"
                if not (self.uploads / kept).exists():
                    self._size += size
                temporary.replace(self.uploads / kept)
            except BaseException:
                temporary.unlink(missing_ok=True)
                raise
        return f"{UPLOADS}/{kept}"

    @staticmethod
    def _check(file: Path, name: str) -> None:
        try:
            read_grid(file)
        except ModelError as error:
            raise LookdevError(str(error).replace(str(file), shortened(name, 80))) from None
