"""Copies image files from usdz packages into the cache, because no image library reads a package.

A path of a file in a package has the form ``a.usdz[b.png]``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path, PurePosixPath

from pxr import Ar

from lookdev.cache import cache_dir, is_whole, write_file
from lookdev.errors import TextureError


def unpack(paths: Sequence[str]) -> Path:
    """Copy files of one package into a cache folder that is named by their content; return the copy of the first file.

    `paths` are the paths of the files in the package. Raises TextureError if a file cannot be read.
    """
    status = Path(Ar.SplitPackageRelativePathOuter(paths[0])[0]).stat()
    digests = _member_digests(tuple(paths), status.st_size, status.st_mtime_ns)
    content = "\n".join([*digests, *map(_member_name, paths)])
    folder = cache_dir("unpacked", hashlib.sha256(content.encode()).hexdigest())
    for path, digest in zip(paths, digests, strict=True):
        file = folder / _member_name(path)
        if not is_whole(file, digest):
            write_file(file, _read_member(path))
    return folder / _member_name(paths[0])


@lru_cache(maxsize=4096)
def _member_digests(paths: tuple[str, ...], size: int, modified: int) -> tuple[str, ...]:
    """Return the SHA-256 of each file in a package.

    `size` and `modified`, the package's size and time of modification, are part of the key of the cached result.
    """
    return tuple(hashlib.sha256(_read_member(path)).hexdigest() for path in paths)


def _member_name(path: str) -> str:
    """Return the name, without folders, of a file in a package."""
    return PurePosixPath(Ar.SplitPackageRelativePathInner(path)[1]).name


def _read_member(path: str) -> bytes:
    """Return the content of a file in a package; raises TextureError if it cannot be read."""
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if asset is None:
        raise TextureError(f"{path}: cannot be read")
    return bytes(asset.GetBuffer())
