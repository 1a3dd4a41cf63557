"""The image files that texture nodes name, also inside usdz packages, from which they are copied into the cache."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path, PurePosixPath

from pxr import Ar, Sdf, Usd, UsdShade

from lookdev.cache import atomic_path, cache_dir, is_whole
from lookdev.errors import TextureError
from lookdev.material.textures import UDIM
from lookdev.material.usd.network import Network


def image_path(network: Network, attribute: Usd.Attribute, asset: Sdf.AssetPath) -> Path:
    """Return the image, or the set of tiles, that an input `attribute` of the value `asset` names; it is not opened.

    Raises
    ------
    TextureError
        There is no such file.
    """
    if not asset.path:
        raise TextureError("names no image file")
    if UDIM in asset.path:
        layer = _layer_of(network, attribute)
        tiles = [path for path, _ in UsdShade.UdimUtils.ResolveUdimTilePaths(asset.path, layer)]
        if not tiles:
            raise TextureError(f"no tile of this set: {asset.path}")
        if Ar.IsPackageRelativePath(tiles[0]):
            return _unpacked(tiles).with_name(PurePosixPath(asset.path.rstrip("]")).name)
        return Path(UsdShade.UdimUtils.ResolveUdimPath(asset.path, layer))
    if not asset.resolvedPath:
        raise TextureError(f"no such image file: {asset.path}")
    if Ar.IsPackageRelativePath(asset.resolvedPath):
        return _unpacked([asset.resolvedPath])
    return Path(asset.resolvedPath)


def _layer_of(network: Network, attribute: Usd.Attribute) -> Sdf.Layer | None:
    """Return the layer that holds an attribute's value: a relative path is relative to it."""
    holder = network.follow(attribute)
    stack = holder.GetPropertyStack() if isinstance(holder, Usd.Attribute) else []
    return next((spec.layer for spec in stack if spec.default is not None), None)


def _unpacked(paths: Sequence[str]) -> Path:
    """Copy files of a package into a folder of the cache that is named by their content; return the first."""
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
