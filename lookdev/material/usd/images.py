"""The image files that texture nodes name, also inside usdz packages."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from pxr import Ar, Sdf, Usd, UsdShade

from lookdev.errors import TextureError
from lookdev.material.textures import UDIM
from lookdev.material.usd.network import Network
from lookdev.stage.packages import unpack


def image_path(network: Network, attribute: Usd.Attribute, asset: Sdf.AssetPath) -> Path:
    """Return the image file, or the set of tiles, that the value `asset` of an input names, without opening it.

    Raises
    ------
    TextureError
        There is no such file.
    """
    if UDIM in asset.path:
        layer = _value_layer(network, attribute)
        tiles = [path for path, _ in UsdShade.UdimUtils.ResolveUdimTilePaths(asset.path, layer)]
        if not tiles:
            raise TextureError(f"no tile of this set: {asset.path}")
        if Ar.IsPackageRelativePath(tiles[0]):
            return unpack(tiles).with_name(PurePosixPath(asset.path.rstrip("]")).name)
        return Path(UsdShade.UdimUtils.ResolveUdimPath(asset.path, layer))
    return asset_file(asset, "image file")


def asset_file(asset: Sdf.AssetPath, kind: str = "file") -> Path:
    """Return the file that a value names; raises TextureError where it names none or no such file exists."""
    if not asset.path:
        raise TextureError(f"names no {kind}")
    if not asset.resolvedPath:
        raise TextureError(f"no such {kind}: {asset.path}")
    if Ar.IsPackageRelativePath(asset.resolvedPath):
        return unpack([asset.resolvedPath])
    return Path(asset.resolvedPath)


def _value_layer(network: Network, attribute: Usd.Attribute) -> Sdf.Layer | None:
    """Return the layer that states an attribute's value; relative paths in the value are relative to it."""
    holder = network.follow(attribute)
    stack = holder.GetPropertyStack() if isinstance(holder, Usd.Attribute) else []
    return next((spec.layer for spec in stack if spec.default is not None), None)
