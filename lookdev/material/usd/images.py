"""The image files that texture nodes name, also inside usdz packages."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from pxr import Ar, Sdf, Usd, UsdShade

from lookdev.errors import TextureError
from lookdev.material.textures import UDIM
from lookdev.material.usd.network import Network
from lookdev.stage.packages import unpacked


def image_path(network: Network, attribute: Usd.Attribute, asset: Sdf.AssetPath) -> Path:
    """Return the image, or the set of tiles, that an input `attribute` of the value `asset` names; it is not opened.

    Raises
    ------
    TextureError
        There is no such file.
    """
    if UDIM in asset.path:
        layer = _layer_of(network, attribute)
        tiles = [path for path, _ in UsdShade.UdimUtils.ResolveUdimTilePaths(asset.path, layer)]
        if not tiles:
            raise TextureError(f"no tile of this set: {asset.path}")
        if Ar.IsPackageRelativePath(tiles[0]):
            return unpacked(tiles).with_name(PurePosixPath(asset.path.rstrip("]")).name)
        return Path(UsdShade.UdimUtils.ResolveUdimPath(asset.path, layer))
    return asset_file(asset, "image file")


def asset_file(asset: Sdf.AssetPath, what: str = "file") -> Path:
    """Return the file that a value names; raises TextureError where there is no such one."""
    if not asset.path:
        raise TextureError(f"names no {what}")
    if not asset.resolvedPath:
        raise TextureError(f"no such {what}: {asset.path}")
    if Ar.IsPackageRelativePath(asset.resolvedPath):
        return unpacked([asset.resolvedPath])
    return Path(asset.resolvedPath)


def _layer_of(network: Network, attribute: Usd.Attribute) -> Sdf.Layer | None:
    """Return the layer that holds an attribute's value: a relative path is relative to it."""
    holder = network.follow(attribute)
    stack = holder.GetPropertyStack() if isinstance(holder, Usd.Attribute) else []
    return next((spec.layer for spec in stack if spec.default is not None), None)
