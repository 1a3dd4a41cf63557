"""Environment maps: their reading and repair, the digest of their content, and the EXR files of lights in the cache.

A map is a lat-long image of linear Rec.709 radiance. As in Cycles, the numbers of a file are taken as they are: the
``chromaticities`` of an EXR have no effect.
"""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import OpenEXR
from numpy.typing import ArrayLike

from lookdev.arrays import Bools, Floats, Floats32
from lookdev.cache import memory_file
from lookdev.errors import EnvironmentMapError, nearest_hint
from lookdev.images import check_size, open_image, whole_image
from lookdev.space import Space, to_space

if TYPE_CHECKING:
    import OpenImageIO as oiio


BUILTIN_LIGHTS: tuple[str, ...] = (
    "city", "courtyard", "forest", "interior", "night", "studio", "sunrise", "sunset", "white",
)  # fmt: skip
"""The eight CC0 Poly Haven maps that the bpy wheel ships, and ``white``: radiance 1 from everywhere."""

_TILE_SIDE = 4096  # texels: the largest side of a tile in `write_exr`

MIN_PEAK, MAX_PEAK = 1e-18, 1e18
"""The limits of a map's largest radiance, because shaders compute in float32; 0 is allowed, too."""


@dataclass(frozen=True)
class Repairs:
    """The number of repaired texels for each kind of damage; a texel may have several kinds."""

    negative: int = 0
    nan: int = 0
    infinite: int = 0

    def __bool__(self) -> bool:
        return bool(self.negative or self.nan or self.infinite)

    def __str__(self) -> str:
        kinds = (("negative", self.negative), ("NaN", self.nan), ("infinite", self.infinite))
        repairs = [f"{count} {kind}" for kind, count in kinds if count]
        return f"{' and '.join(repairs) or 'no'} texels repaired"


@dataclass(frozen=True, eq=False)
class EnvironmentMap:
    """An environment map: radiance (H, W, 3) in linear Rec.709, row 0 at the zenith, finite and not negative.

    `digest` identifies the radiance. `where` is the map's file, or else its name, for messages.
    """

    name: str
    radiance: Floats32
    repairs: Repairs
    digest: str
    where: str

    @property
    def is_constant(self) -> bool:
        """Whether the radiance is the same from every direction."""
        return bool((self.radiance == self.radiance[0, 0]).all())


def exposure_fault(peak: float, exposure: float) -> tuple[str, str] | None:
    """Return the fault if `peak` times 2^exposure is out of the range of shaders, which compute in float32; else None.

    `peak` is the largest radiance of a light. The fault is a pair: the problem, and a sentence on what would be right.
    """
    peak *= 2.0**exposure
    if not peak or MIN_PEAK <= peak <= MAX_PEAK:
        return None
    exposed = f" times 2^{exposure:g}" if exposure else ""
    return f"its largest radiance{exposed} is {peak:g}", f"from {MIN_PEAK:g} to {MAX_PEAK:g} would be right"


def check_exposed(peak: float, exposure: float, where: str) -> None:
    """Raise EnvironmentMapError if `exposure_fault` has a fault; `where` names the map in the message."""
    if fault := exposure_fault(peak, exposure):
        raise EnvironmentMapError(f"{where}: {'; '.join(fault)}")


def map_in_space(radiance: Floats, color: tuple[float, float, float], digest: str, space: Space) -> EnvironmentMap:
    """Return a linear Rec.709 map (H, W, 3), multiplied by a colour and converted to a colour space.

    `digest` is the digest of the given map; the digest of the result is computed from it, the colour and the space.
    """
    name = hashlib.sha256(f"{digest} {color!r} {space}".encode()).hexdigest()
    pixels = to_space(radiance * np.array(color), space).astype(np.float32)
    return EnvironmentMap(space, pixels, Repairs(), name, space)


def load_environment(file: Path | None = None, builtin: str | None = None) -> EnvironmentMap:
    """Load a lat-long map, either from an EXR or HDR file or from `BUILTIN_LIGHTS`.

    Maps may have any aspect ratio: the whole image always covers the whole sphere.

    Raises
    ------
    EnvironmentMapError
        The file is missing, is not an EXR or HDR image, or has no finite value; the name is unknown; bpy is not
        installed.
    """
    if file is not None and builtin is None:
        return make_environment(file.stem, read_pixels(file), str(file))
    if file is None and builtin is not None:
        white = builtin == "white"
        pixels = np.ones((32, 64, 3), np.float32) if white else read_pixels(builtin_file(builtin))
        return make_environment(builtin, pixels)
    raise EnvironmentMapError("an environment map is given either by file or by built-in name, not both or none")


def builtin_file(name: str) -> Path:
    """Return the file of a built-in map other than ``white``; raise the errors of `load_environment`."""
    if name not in BUILTIN_LIGHTS:
        raise EnvironmentMapError(f"no built-in light '{name}' ({nearest_hint(name, BUILTIN_LIGHTS)})")
    spec = importlib.util.find_spec("bpy")  # finds the package without importing Blender
    folders = list(spec.submodule_search_locations or ()) if spec else []
    for folder in folders:
        for file in Path(folder).glob(f"*/datafiles/studiolights/world/{name}.exr"):
            return file
    where = f"not under {folders[0]}" if folders else "bpy is not installed"
    raise EnvironmentMapError(f"built-in light '{name}' comes with Blender's bpy wheel: {where}")


def read_pixels(file: Path) -> Floats32:
    """Read the channels R, G, B (H, W, 3), or Y as all three for a grey map, from the first part that has them.

    A *part* is one of the images in a multi-part EXR. Raises EnvironmentMapError if no part has these channels.
    """
    if file.suffix.lower() not in (".exr", ".hdr"):
        raise EnvironmentMapError(f"{file}: an environment map is a lat-long .exr or .hdr file")
    is_hdr = file.suffix.lower() == ".hdr"
    names: list[str] = []
    with open_image(file, EnvironmentMapError) as image:
        if image.format_name() != ("hdr" if is_hdr else "openexr"):
            raise EnvironmentMapError(f"{file}: is an image of kind {image.format_name()}, which its name does not say")
        number = 0
        while image.seek_subimage(number, 0):
            spec = image.spec()
            names += spec.channelnames
            channels = _color_channels(spec.channelnames)
            if channels:
                check_size(file, spec, EnvironmentMapError)
                pixels = _read_channels(image, file, channels)
                return _orient(pixels, spec.get_int_attribute("Orientation", 1)) if is_hdr else pixels
            number += 1
    raise EnvironmentMapError(f"{file}: needs channels R, G, B (or Y), has channels {', '.join(names[:20])}")


def _color_channels(names: Sequence[str]) -> tuple[str, ...]:
    """Return the channels to read as red, green and blue; () if an image has no such channels."""
    if {"R", "G", "B"} <= set(names):
        return "R", "G", "B"
    # Channels RY and BY beside Y are a luminance-chroma image, which would lose its colour.
    return ("Y", "Y", "Y") if "Y" in names and "RY" not in names else ()


def _read_channels(image: oiio.ImageInput, file: Path, channels: Sequence[str]) -> Floats32:
    spec = image.spec()
    if (spec.x, spec.y, spec.width, spec.height) != (spec.full_x, spec.full_y, spec.full_width, spec.full_height):
        raise EnvironmentMapError(f"{file}: data and display window differ; save the map uncropped")
    numbers = [list(spec.channelnames).index(name) for name in channels]
    first, last = min(numbers), max(numbers)
    pixels = whole_image(image, file, range(first, last + 1), EnvironmentMapError)
    order = [number - first for number in numbers]
    return pixels if order == list(range(pixels.shape[-1])) else np.ascontiguousarray(pixels[..., order])


def _orient(pixels: Floats32, orientation: int) -> Floats32:
    """Return an image turned upright, by its `orientation`: a number from 1 to 8 as in TIFF and Exif."""
    pixels = pixels[:: -1 if orientation in (3, 4, 7, 8) else 1, :: -1 if orientation in (2, 3, 6, 7) else 1]
    return np.ascontiguousarray(pixels if orientation < 5 else pixels.transpose(1, 0, 2))


def make_environment(name: str, pixels: ArrayLike, where: str = "") -> EnvironmentMap:
    """Repair radiance (H, W, 3), row 0 at the zenith, and return it as a map.

    Negative values become 0, infinite ones the largest finite value of the map, and NaN the mean of the neighbours that
    are not NaN, or 0.

    Raises
    ------
    EnvironmentMapError
        No value is finite, or the largest is not within `MIN_PEAK` and `MAX_PEAK`. The message names the map by
        `where`, or by its name.
    """
    radiance, repairs = _repair(np.asarray(pixels, np.float32), where or name)
    check_exposed(float(radiance.max()), 0.0, where or name)
    digest = hashlib.sha256(repr(radiance.shape).encode())
    digest.update(radiance.data)
    return EnvironmentMap(name, radiance, repairs, digest.hexdigest(), where or name)


def _repair(pixels: Floats32, where: str) -> tuple[Floats32, Repairs]:
    """Return repaired pixels, as `make_environment` documents, and the numbers of repaired texels."""
    if 0.0 <= pixels.min() <= pixels.max() < np.inf:  # false if a value is NaN
        return np.ascontiguousarray(pixels), Repairs()
    nan, infinite, negative = np.isnan(pixels), np.isposinf(pixels), pixels < 0.0
    repairs = Repairs(*(int(bad.any(axis=-1).sum()) for bad in (negative, nan, infinite)))
    finite = np.isfinite(pixels)
    if not finite.any():
        raise EnvironmentMapError(f"{where}: no finite value in the whole map; export it again as float or half EXR")
    radiance: Floats32 = np.where(negative, np.float32(0.0), pixels)
    radiance[infinite] = np.max(pixels, where=finite, initial=0.0)
    if nan.any():
        radiance[nan] = _neighbour_mean(radiance, nan)[nan]
    return np.ascontiguousarray(radiance), repairs


def _neighbour_mean(radiance: Floats32, nan: Bools) -> Floats32:
    """Return the mean over 3 x 3 texels about each texel, without those that are NaN; periodic in u, clamped in v."""

    def sum_of_neighbours(values: Floats) -> Floats:
        # SciPy is imported here for the reason that `lookdev.metrics` states.
        from scipy.ndimage import convolve1d

        columns = convolve1d(values, np.ones(3), axis=0, mode="nearest")
        return np.asarray(convolve1d(columns, np.ones(3), axis=1, mode="wrap"))

    total = sum_of_neighbours(np.where(nan, 0.0, radiance.astype(np.float64)))
    count = sum_of_neighbours((~nan).astype(np.float64))
    return np.asarray(total / np.maximum(count, 1.0), dtype=np.float32)


def write_exr(path: Path, channels: str, values: Floats32, *, compressed: bool = True) -> None:
    """Write an image (H, W, C) as an EXR of a single tile; a side of more than 4096 texels is divided.

    Blender 4.5 evaluates OSL's texture() with OpenImageIO, which divides an image without tiles into tiles of 64 x 64.
    A thread caches only two tiles, and access to another tile costs more than the look-up itself.
    """
    planes = {name: np.ascontiguousarray(values[..., i], dtype=np.float32) for i, name in enumerate(channels)}
    tile = OpenEXR.TileDescription()
    tile.ySize, tile.xSize = (min(side, _TILE_SIDE) for side in values.shape[:2])
    tile.mode, tile.roundingMode = OpenEXR.LevelMode.ONE_LEVEL, OpenEXR.LevelRoundingMode.ROUND_DOWN
    compression = OpenEXR.ZIP_COMPRESSION if compressed else OpenEXR.NO_COMPRESSION
    header = {"compression": compression, "type": OpenEXR.tiledimage, "tiles": tile}
    with OpenEXR.File(header, planes) as exr, memory_file(path) as name:
        exr.write(name)


def read_exr(path: Path, channels: str) -> Floats32:
    """Read an image (H, W, C) of the given channels, a letter each; raise EnvironmentMapError if that fails."""
    try:
        with OpenEXR.File(str(path), separate_channels=True) as exr:
            return np.stack([exr.channels()[name].pixels for name in channels], axis=-1)
    except (RuntimeError, ValueError, KeyError) as error:
        raise EnvironmentMapError(f"{path}: unreadable ({error}); remove it and it is made again") from error
