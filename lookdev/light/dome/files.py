"""The images of a dome light."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR

from lookdev.arrays import Floats32
from lookdev.cache import from_memory
from lookdev.errors import EnvironmentMapError

_TILE_SIDE = 4096


def write_exr(path: Path, channels: str, values: Floats32, *, compressed: bool = True) -> None:
    """Write an image (H, W, C) as an EXR of a single tile.

    Blender 4.5 evaluates texture() with OpenImageIO, which divides an image without tiles into tiles of 64 x 64. A
    thread caches two tiles, and a change of the tile costs more than the look-up.
    """
    planes = {name: np.ascontiguousarray(values[..., i], dtype=np.float32) for i, name in enumerate(channels)}
    tile = OpenEXR.TileDescription()
    tile.ySize, tile.xSize = (min(side, _TILE_SIDE) for side in values.shape[:2])
    tile.mode, tile.roundingMode = OpenEXR.LevelMode.ONE_LEVEL, OpenEXR.LevelRoundingMode.ROUND_DOWN
    compression = OpenEXR.ZIP_COMPRESSION if compressed else OpenEXR.NO_COMPRESSION
    header = {"compression": compression, "type": OpenEXR.tiledimage, "tiles": tile}
    with OpenEXR.File(header, planes) as exr, from_memory(path) as name:
        exr.write(name)


def read_exr(path: Path, channels: str) -> Floats32:
    """Read an image (H, W, C) of some channels; raise EnvironmentMapError if that fails."""
    try:
        with OpenEXR.File(str(path), separate_channels=True) as exr:
            return np.stack([exr.channels()[name].pixels for name in channels], axis=-1)
    except (RuntimeError, ValueError, KeyError) as error:
        raise EnvironmentMapError(f"{path}: unreadable ({error}); remove it and it is made again") from error
