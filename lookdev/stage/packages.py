"""Files inside usdz packages, which are copied into the cache: no library of images reads a package."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path, PurePosixPath

from pxr import Ar

from lookdev.cache import atomic_path, cache_dir, is_whole
from lookdev.errors import TextureError


def unpacked(paths: Sequence[str]) -> Path:
    """Copy files of a package into a folder of the cache that is named by their content; return the first.

    Raises TextureError where one cannot be read.
    """
    status = Path(Ar.SplitPackageRelativePathOuter(paths[0])[0]).stat()
    digests = _digests(tuple(paths), status.st_size, status.st_mtime_ns)
    folder = cache_dir("unpacked", hashlib.sha256("\n".join([*digests, *map(_name, paths)]).encode()).hexdigest())
    for path, digest in zip(paths, digests, strict=True):
        file = folder / _name(path)
        if not is_whole(file, digest):
            with atomic_path(file) as temporary:
                temporary.write_bytes(_content(path))
    return folder / _name(paths[0])


@lru_cache(maxsize=4096)
def _digests(paths: tuple[str, ...], size: int, changed: int) -> tuple[str, ...]:
    return tuple(hashlib.sha256(_content(path)).hexdigest() for path in paths)


def _name(path: str) -> str:
    return PurePosixPath(Ar.SplitPackageRelativePathInner(path)[1]).name


def _content(path: str) -> bytes:
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if asset is None:
        raise TextureError(f"cannot be read: {path}")
    return bytes(asset.GetBuffer())
