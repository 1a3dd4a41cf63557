"""The files that a page may read, by name: files that the server's command line states, and uploads.

A root is a file or a folder that the command line states, or the folder of uploads.
"""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import AsyncIterable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from lookdev.brdf.measured.files import read_grid
from lookdev.errors import LookdevError, ModelError, shorten

UPLOADS = "uploads"
"""The name of the root that is the folder of uploads."""
MAX_UPLOAD_BYTES = 64 << 20
"""Largest size of an upload, in bytes; a MERL binary has 33 MiB."""
MAX_UPLOADS_BYTES = 512 << 20
"""Largest size of all uploads together, in bytes."""

_UNSAFE = re.compile(r"[^A-Za-z0-9._-]+")  # characters that the name of a root or an upload must not have
_MAX_LISTED = 500  # files of one root that a page lists


def is_below(file: Path, folders: Iterable[Path]) -> bool:
    """Return whether a file, its links resolved, is in one of the folders or below it."""
    return any(file.resolve().is_relative_to(folder.resolve()) for folder in folders)


@dataclass
class Roots:
    """The roots, whose names a page uses instead of paths.

    `paths` has the path of each root by its name. A file in a folder has the name ``<root>/<path in the folder>``, and
    a single file has the name of its root. `uploads` is a folder of the server, empty at first; `_size` is the number
    of bytes of all uploads.
    """

    uploads: Path
    paths: dict[str, Path] = field(default_factory=dict)
    _size: int = 0

    def __post_init__(self) -> None:
        self.paths[UPLOADS] = self.uploads

    def add(self, path: Path) -> str:
        """Add a folder or a file, and return its name; raise LookdevError if the path does not exist."""
        absolute = path.absolute()
        if not absolute.exists():
            raise LookdevError(f"{path}: no such file or folder")
        for name, root in self.paths.items():
            if root == absolute:
                return name
        plain = _UNSAFE.sub("_", absolute.name) or "root"
        names = [plain, *(f"{number}_{plain}" for number in range(2, 1000))]
        name = next(candidate for candidate in names if candidate not in self.paths)
        self.paths[name] = absolute
        return name

    def locate(self, name: str) -> Path:
        """Return the path of the file with a name.

        Raises LookdevError if the file is outside of the roots, even if the path leaves a root by ``..`` or by a link.
        """
        parts = PurePosixPath(name).parts
        error = LookdevError(f"'{shorten(name, 80)}' is not among the files of this server; start it with --root")
        if not parts or "\0" in name or parts[0] not in self.paths:
            raise error
        root = self.paths[parts[0]]
        file = root.joinpath(*parts[1:])
        try:
            inside = is_below(file, [root])
        except (OSError, RuntimeError):
            inside = False
        if not inside or ".." in parts:
            raise error
        return file

    def replace_names(self, text: str) -> str:
        """Return the text of a surface, with paths in place of the names of roots, so that a command line can read it.

        The name of a root is at the start of the text or after ``=``, and ends before one of ``/:@#,`` or at the end.
        """
        for name in sorted(self.paths, key=len, reverse=True):
            text = re.sub(rf"(^|[=]){re.escape(name)}(?=$|[/:@#,])", lambda m: f"{m[1]}{self.paths[name]}", text)  # noqa: B023
        return text

    def list_files(self, suffixes: Sequence[str]) -> Iterator[str]:
        """Yield the names of all single files, and of files in folders that have one of `suffixes`.

        At most `_MAX_LISTED` files of each root are yielded; hidden files and folders are left out.
        """
        for name, root in self.paths.items():
            if root.is_file():
                yield name
                continue
            count = 0
            for folder, folders, files in os.walk(root):
                folders[:] = sorted(subfolder for subfolder in folders if not subfolder.startswith("."))
                for file in sorted(files):
                    if file.lower().endswith(tuple(suffixes)) and not file.startswith(".") and count < _MAX_LISTED:
                        count += 1
                        yield str(PurePosixPath(name, Path(folder, file).relative_to(root).as_posix()))

    async def upload(self, name: str, chunks: AsyncIterable[bytes]) -> str:
        """Store a file of measured reflectance that a page sends, and return its name.

        Raises LookdevError if it is too large, or is not a file of measured reflectance.
        """
        digest, size = hashlib.sha256(), 0
        with tempfile.NamedTemporaryFile(dir=self.uploads, delete=False) as stream:
            temporary = Path(stream.name)
            try:
                async for chunk in chunks:
                    size += len(chunk)
                    if size > MAX_UPLOAD_BYTES:
                        raise LookdevError(
                            f"more than {MAX_UPLOAD_BYTES >> 20} MiB; a measurement of less would be right"
                        )
                    if self._size + size > MAX_UPLOADS_BYTES:
                        raise LookdevError(
                            f"uploads have {MAX_UPLOADS_BYTES >> 20} MiB together; start the server again"
                        )
                    digest.update(chunk)
                    stream.write(chunk)
                stream.flush()
                self._check_measured(temporary, name)
                plain = _UNSAFE.sub("_", PurePosixPath(name).name)[-60:] or "upload"
                stored_name = f"{digest.hexdigest()[:8]}-{plain}"
                if not (self.uploads / stored_name).exists():
                    self._size += size
                temporary.replace(self.uploads / stored_name)
            except BaseException:
                temporary.unlink(missing_ok=True)
                raise
        return f"{UPLOADS}/{stored_name}"

    @staticmethod
    def _check_measured(file: Path, name: str) -> None:
        """Raise LookdevError, with `name` in its message, if a file is not a file of measured reflectance."""
        try:
            read_grid(file)
        except ModelError as error:
            raise LookdevError(str(error).replace(str(file), shorten(name, 80))) from None
