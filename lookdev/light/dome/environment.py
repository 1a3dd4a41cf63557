"""Environment maps: read, repaired, and named by their content.

A map is a lat-long image of linear Rec.709 radiance. The numbers of a file are used as they are, as Cycles does: an
EXR's ``chromaticities`` have no effect.
"""

from __future__ import annotations

import hashlib
import importlib.util
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio
from numpy.typing import ArrayLike, NDArray

from lookdev.errors import EnvironmentMapError, nearest_hint

Floats = NDArray[np.float32]

BUILTIN_LIGHTS: tuple[str, ...] = (
    "city", "courtyard", "forest", "interior", "night", "studio", "sunrise", "sunset", "white",
)  # fmt: skip
"""The eight CC0 Poly Haven maps that the bpy wheel ships, and ``white``: radiance 1 from everywhere."""


@dataclass(frozen=True)
class Repairs:
    """The number of repaired texels, by kind of damage; a texel may have several kinds."""

    negative: int = 0
    nan: int = 0
    infinite: int = 0

    def __bool__(self) -> bool:
        return bool(self.negative or self.nan or self.infinite)

    def __str__(self) -> str:
        kinds = (("negative", self.negative), ("NaN", self.nan), ("infinite", self.infinite))
        found = [f"{count} {kind}" for kind, count in kinds if count]
        return f"{' and '.join(found) or 'no'} texels repaired"


@dataclass(frozen=True, eq=False)
class EnvironmentMap:
    """An image of radiance (H, W, 3), row 0 at the zenith, linear Rec.709, finite and not negative, and its digest."""

    name: str
    radiance: Floats
    repairs: Repairs
    digest: str

    @property
    def is_constant(self) -> bool:
        """Whether the radiance is the same from every direction."""
        return bool((self.radiance == self.radiance[0, 0]).all())


def load_environment(file: Path | None = None, builtin: str | None = None) -> EnvironmentMap:
    """Load a lat-long map from an EXR or HDR file, or one of `BUILTIN_LIGHTS`; exactly one of both is given.

    Maps may have any aspect: the whole image is the whole sphere.

    Raises
    ------
    EnvironmentMapError
        The file is missing, no EXR or HDR image, or has no finite value; the name is unknown; bpy is not installed.
    """
    if file is not None and builtin is None:
        return make_environment(file.stem, _read(file), str(file))
    if file is None and builtin is not None:
        white = builtin == "white"
        pixels = np.ones((32, 64, 3), np.float32) if white else _read(_builtin_file(builtin))
        return make_environment(builtin, pixels)
    raise EnvironmentMapError("an environment map is given either by file or by built-in name, not both or none")


def _builtin_file(name: str) -> Path:
    if name not in BUILTIN_LIGHTS:
        raise EnvironmentMapError(f"no built-in light '{name}' ({nearest_hint(name, BUILTIN_LIGHTS)})")
    spec = importlib.util.find_spec("bpy")  # finds the package without importing Blender
    folders = list(spec.submodule_search_locations or ()) if spec else []
    for folder in folders:
        for file in Path(folder).glob(f"*/datafiles/studiolights/world/{name}.exr"):
            return file
    where = f"not under {folders[0]}" if folders else "bpy is not installed"
    raise EnvironmentMapError(f"built-in light '{name}' comes with Blender's bpy wheel: {where}")


def _read(file: Path) -> Floats:
    readers = {".exr": _read_exr, ".hdr": _read_hdr}
    reader = readers.get(file.suffix.lower())
    if reader is None:
        raise EnvironmentMapError(f"{file}: an environment map is a lat-long .exr or .hdr file")
    if not file.is_file():
        raise EnvironmentMapError(f"{file}: no such file")
    return reader(file)


def _read_exr(file: Path) -> Floats:
    """Read R, G, B (or Y alone, a grey map) from the first part that has them."""
    names: list[str] = []
    try:
        with OpenEXR.File(str(file), separate_channels=True) as exr:
            for part in exr.parts:  # `exr.channels()` is part 0 only
                names.extend(part.channels)
                wanted = ("R", "G", "B") if {"R", "G", "B"} <= part.channels.keys() else ("Y",) * 3
                # RY and BY beside Y are luminance-chroma: Y alone would be a grey picture of a coloured one.
                if not set(wanted) <= part.channels.keys() or "RY" in part.channels:
                    continue
                if not np.array_equal(part.header["dataWindow"], part.header["displayWindow"]):
                    raise EnvironmentMapError(f"{file}: data and display window differ; save the map uncropped")
                pixels = [part.channels[name].pixels for name in wanted]
                return np.asarray(np.stack(pixels, axis=-1), dtype=np.float32)
    except (RuntimeError, ValueError) as error:  # OpenEXR raises both for files that it cannot read
        raise EnvironmentMapError(f"{file}: not a readable EXR image: {error}") from error
    # OpenEXR drops a part whose pixels it cannot decode.
    found = f"channels {', '.join(names)}" if names else "no readable pixels"
    raise EnvironmentMapError(f"{file}: needs channels R, G, B (or Y), has {found}")


def _read_hdr(file: Path) -> Floats:
    image = oiio.ImageInput.open(str(file))
    if image is None:
        raise EnvironmentMapError(f"{file}: not a readable HDR image: {oiio.geterror().strip()}")
    try:
        pixels = image.read_image(0, 0, 0, 3, oiio.FLOAT)
        if pixels is None:
            raise EnvironmentMapError(f"{file}: not a readable HDR image: {image.geterror().strip()}")
    finally:
        image.close()
    return np.asarray(pixels, dtype=np.float32)


def make_environment(name: str, pixels: ArrayLike, where: str = "") -> EnvironmentMap:
    """Make a map of radiance (H, W, 3), row 0 at the zenith, repaired.

    Negative values become 0, infinite ones the largest finite value of the map, and NaN the mean of the neighbours that
    are not NaN, or 0. If no value is finite, an EnvironmentMapError names the map by `where`, or by its name.
    """
    radiance, repairs = _repair(np.asarray(pixels, np.float32), where or name)
    digest = hashlib.sha256(repr(radiance.shape).encode() + radiance.tobytes()).hexdigest()
    return EnvironmentMap(name, radiance, repairs, digest)


def _repair(pixels: Floats, where: str) -> tuple[Floats, Repairs]:
    nan, infinite, negative = np.isnan(pixels), np.isposinf(pixels), pixels < 0.0
    repairs = Repairs(*(int(bad.any(axis=-1).sum()) for bad in (negative, nan, infinite)))
    finite = np.isfinite(pixels)
    if not finite.any():
        raise EnvironmentMapError(f"{where}: no finite value in the whole map; export it again as float or half EXR")
    radiance: Floats = np.where(negative, np.float32(0.0), pixels)
    radiance[infinite] = np.max(pixels, where=finite, initial=0.0)
    if nan.any():
        radiance[nan] = _neighbour_mean(radiance, nan)[nan]
    return np.ascontiguousarray(radiance), repairs


def _neighbour_mean(radiance: Floats, nan: NDArray[np.bool_]) -> Floats:
    """Return the mean of the 3 x 3 texels around each, periodic in u and clamped in v, without those that are NaN."""

    def around(values: NDArray[np.float64]) -> NDArray[np.float64]:
        # Not at the top: as in `lookdev.metrics`.
        from scipy.ndimage import convolve1d

        columns = convolve1d(values, np.ones(3), axis=0, mode="nearest")
        return np.asarray(convolve1d(columns, np.ones(3), axis=1, mode="wrap"))

    total = around(np.where(nan, 0.0, radiance.astype(np.float64)))
    count = around((~nan).astype(np.float64))
    return np.asarray(total / np.maximum(count, 1.0), dtype=np.float32)
