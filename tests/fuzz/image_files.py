"""Environment maps and textures with one thing wrong, as files."""

import random
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import OpenImageIO as oiio
from cases import ANY, NOTED, REFUSED, SOUND
from damage import Damage, append_noise, flip_bits, replace_by_noise, truncate
from numpy.typing import NDArray
from text_changes import NO_FILES

from lookdev.arrays import Floats32

Write = Callable[[Path, random.Random], object]

GRAY = (128 + np.random.default_rng(5).integers(0, 128, (8, 16))) / np.float32(256.0)
"""Exact in half floats, in RGBE and in 16 bits."""

RGB = np.repeat(GRAY[..., None], 3, axis=-1).astype(np.float32)
_MANY = 100_000


@dataclass(frozen=True)
class Wrong:
    """How a file `name` is written, and what must become of it."""

    write: Write
    expected: frozenset[str] = REFUSED
    name: str = "map.exr"
    exposure: float = 0.0
    right: Write | None = None
    """What writes the sound file, unless it is an EXR of floats."""


def exr(pixels: NDArray[Any] = RGB, names: str = "RGB", **header: Any) -> Write:
    def write(file: Path, rng: random.Random) -> None:
        planes = {name: np.ascontiguousarray(pixels[..., i]) for i, name in enumerate(names)}
        given = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
        with OpenEXR.File(given, planes) as made:
            made.write(str(file))

    return write


def image(pixels: NDArray[Any] = RGB, kind: str = "float", form: str = "", **options: Any) -> Write:
    """Return what writes an image by OpenImageIO, of the form of another suffix where one is given."""

    def write(file: Path, rng: random.Random) -> None:
        height, width, channels = pixels.shape
        spec = oiio.ImageSpec(width, height, channels, kind)
        for name, value in options.items():
            if hasattr(spec, name):
                setattr(spec, name, value)
            else:
                spec[name.replace("__", ":")] = value
        target = file.with_suffix(form) if form else file
        output = oiio.ImageOutput.create(str(target))
        assert output.open(str(target), spec), output.geterror()
        assert output.write_image(np.ascontiguousarray(pixels, np.float32))
        assert output.close()
        target.rename(file)

    return write


def hdr(
    resolution: str = "-Y 8 +X 16", pixels: NDArray[Any] = GRAY, form: str = "rgbe", magic: str = "RADIANCE"
) -> Write:
    def write(file: Path, rng: random.Random) -> None:
        numbers = np.round(pixels * 256.0).astype(np.uint8).ravel()
        flat = np.stack([numbers, numbers, numbers, np.full_like(numbers, 128)], axis=-1).tobytes()
        file.write_bytes(f"#?{magic}\nFORMAT=32-bit_rle_{form}\n\n{resolution}\n".encode() + flat)

    return write


def damaged(write: Write, damage: Damage) -> Write:
    def write_damaged(file: Path, rng: random.Random) -> None:
        write(file, rng)
        file.write_bytes(damage(file.read_bytes(), rng))

    return write_damaged


def _texels(*values: float) -> Floats32:
    pixels = RGB.copy()
    for place, value in enumerate(values):
        pixels[2 + place, 3] = value
    return pixels


def png(width: int, height: int, rows: bytes, depth: int = 8) -> bytes:
    """Return a PNG of a size, with rows of it, each behind the byte of its filter."""
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, depth, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(rows)),
        (b"IEND", b""),
    )
    parts = (struct.pack(">I", len(data)) + kind + data for kind, data in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(part + struct.pack(">I", zlib.crc32(part[4:])) for part in parts)


def _claimed_png(width: int, height: int, depth: int = 8) -> Write:
    return lambda file, rng: file.write_bytes(png(width, height, bytes(1000), depth))


def _several(*parts: tuple[str, NDArray[Any]]) -> Write:
    """Return what writes an EXR of parts with names of channels."""

    def write(file: Path, rng: random.Random) -> None:
        made = [
            OpenEXR.Part(
                {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage},
                {name: np.ascontiguousarray(pixels[..., i % pixels.shape[-1]]) for i, name in enumerate(names)},
                f"part{number}",
            )
            for number, (names, pixels) in enumerate(parts)
        ]
        with OpenEXR.File(made) as exr:
            exr.write(str(file))

    return write


def _odd(write: Write, suffix: str) -> dict[str, Wrong]:
    """Return what can be wrong with the bytes of any file."""
    name = f"map{suffix}"
    makers: dict[str, Callable[[Path, random.Random], object]] = {
        "text": lambda file, rng: file.write_text("not an image\n" * rng.randrange(1, 99)),
        "random bytes": lambda file, rng: file.write_bytes(rng.randbytes(rng.randrange(1, 5000))),
        "nulls": lambda file, rng: file.write_bytes(bytes(rng.randrange(1, 5000))),
        "noise after the first bytes": damaged(write, replace_by_noise),
        "cut in the first bytes": damaged(write, lambda data, rng: data[: rng.randrange(1, 64)]),
    }
    odd = {f"{suffix} {what}": Wrong(make, REFUSED, name) for what, make in makers.items()}
    # Some formats end with what is not needed.
    odd[f"{suffix} cut"] = Wrong(damaged(write, truncate), REFUSED | SOUND, name, right=write)
    odd[f"{suffix} longer"] = Wrong(damaged(write, append_noise), ANY, name, right=write)
    return odd


_NO_IMAGES = {name: Wrong(lambda file, rng, make=make: make(file)) for name, (make, _) in NO_FILES.items()}
_HALF = np.float16(RGB)
ENVIRONMENTS: dict[str, Wrong] = {
    **_NO_IMAGES,
    **_odd(exr(), ".exr"),
    **_odd(hdr(), ".hdr"),
    "half": Wrong(exr(_HALF), SOUND),
    "not compressed": Wrong(exr(compression=OpenEXR.NO_COMPRESSION), SOUND),
    "a strip": Wrong(exr(compression=OpenEXR.PIZ_COMPRESSION), SOUND),
    "tiles": Wrong(image(tile_width=16, tile_height=16), SOUND),
    "a window elsewhere": Wrong(image(x=5, y=-3, full_x=5, full_y=-3), SOUND),
    "gray": Wrong(exr(RGB[..., :1], "Y"), SOUND),
    "with alpha": Wrong(exr(np.concatenate([RGB, RGB[..., :1] * 0], axis=-1), "RGBA"), SOUND),
    "with depth": Wrong(exr(np.concatenate([RGB, RGB[..., :1] * 9], axis=-1), "RGBZ"), SOUND),
    "second part": Wrong(_several(("Z", RGB * 7), ("RGB", RGB)), SOUND),
    "first of two": Wrong(_several(("RGB", RGB), ("RGB", RGB * 2)), SOUND),
    "capital suffix": Wrong(exr(), SOUND, "map.EXR"),
    "scrambled": Wrong(damaged(exr(), flip_bits(0.5)), ANY),
    "scrambled tiles": Wrong(damaged(image(tile_width=16, tile_height=16), flip_bits(0.5)), ANY),
    "no color": Wrong(exr(RGB, "UVW")),
    "two of three": Wrong(exr(RGB[..., :2], "RG")),
    "layers": Wrong(_several(("ZU", RGB), ("VW", RGB))),
    "luminance and chroma": Wrong(image(np.repeat(RGB[..., :1], 3, axis=-1), channelnames=("BY", "RY", "Y"))),
    "cropped": Wrong(image(full_width=32, full_height=16)),
    "huge window": Wrong(image(full_width=_MANY, full_height=_MANY)),
    "far window": Wrong(image(x=2_000_000, y=1_000_000)),
    "all NaN": Wrong(exr(RGB * np.float32(np.nan))),
    "all infinite": Wrong(exr(RGB * np.float32(np.inf))),
    "NaN": Wrong(exr(_texels(np.nan)), NOTED),
    "infinite": Wrong(exr(_texels(np.inf)), NOTED),
    "negative": Wrong(exr(_texels(-1.0, -np.inf)), NOTED),
    "NaN and negative": Wrong(exr(_texels(np.nan, -1.0)), NOTED),
    "too bright": Wrong(exr(_texels(1e30))),
    "too bright with exposure": Wrong(exr(_texels(1e10)), exposure=30.0),
    "too dim": Wrong(exr(RGB * np.float32(1e-30))),
    "too dim with exposure": Wrong(exr(RGB * np.float32(1e-15)), exposure=-30.0),
    "PNG by another name": Wrong(image(kind="uint8", form=".png")),
    "TIFF by another name": Wrong(image(form=".tif")),
    "PNG": Wrong(image(kind="uint8"), name="map.png"),
    "no suffix": Wrong(exr(), name="map"),
    "HDR by another name": Wrong(hdr()),
    "EXR by another name": Wrong(exr(), name="map.hdr"),
    "HDR": Wrong(hdr(), SOUND, "map.hdr"),
    "HDR of runs": Wrong(image(), SOUND, "map.hdr"),
    "HDR of RGBE": Wrong(hdr(magic="RGBE"), SOUND, "map.hdr"),
    "HDR from below": Wrong(hdr("+Y 8 +X 16", GRAY[::-1]), SOUND, "map.hdr"),
    "HDR mirrored": Wrong(hdr("-Y 8 -X 16", GRAY[:, ::-1]), SOUND, "map.hdr"),
    "HDR turned": Wrong(hdr("+Y 8 -X 16", GRAY[::-1, ::-1]), SOUND, "map.hdr"),
    "HDR of columns": Wrong(hdr("+X 16 -Y 8", GRAY.T), SOUND, "map.hdr"),
    "HDR of columns mirrored": Wrong(hdr("-X 16 -Y 8", GRAY[:, ::-1].T), SOUND, "map.hdr"),
    "HDR of columns from below": Wrong(hdr("+X 16 +Y 8", GRAY[::-1].T), SOUND, "map.hdr"),
    "HDR of columns turned": Wrong(hdr("-X 16 +Y 8", GRAY[::-1, ::-1].T), SOUND, "map.hdr"),
    "HDR of XYZ": Wrong(hdr(form="xyze"), name="map.hdr"),
    **{
        f"HDR {size}": Wrong(hdr(size), name="map.hdr")
        for size in (
            f"-Y {_MANY} +X {_MANY}",
            "-Y 0 +X 16",
            "-Y 8 +X 0",
            "-Y -8 +X 16",
            "-Y 8 +X -16",
            "-Y 99999999999999999999 +X 16",
            "-Y 8",
            "-Y 8 +Y 16",
            "nothing",
            "",
            "-Y 8 +X 16 " + "9" * 5000,
        )
    },
}  # fmt: skip

_LONG = 2**31 - 1
_A = np.full_like(RGB[..., :1], 0.5)
TEXTURES: dict[str, Wrong] = {
    **_NO_IMAGES,
    **_odd(image(kind="uint16"), ".png"),
    **_odd(image(kind="uint16", compression="zip"), ".tif"),
    **_odd(exr(), ".exr"),
    **_odd(image(kind="uint8"), ".jpg"),
    **_odd(image(kind="uint8"), ".tga"),
    **_odd(image(kind="uint8"), ".bmp"),
    "float TIFF": Wrong(image(), SOUND, "map.tif"),
    "tiled TIFF": Wrong(image(tile_width=16, tile_height=16), SOUND, "map.tif"),
    "half EXR": Wrong(exr(_HALF), SOUND),
    "tiled EXR": Wrong(image(tile_width=16, tile_height=16), SOUND),
    "gray EXR": Wrong(exr(RGB[..., :1], "Y"), SOUND),
    "gray TIFF": Wrong(image(RGB[..., :1]), SOUND, "map.tif"),
    "more channels": Wrong(exr(np.concatenate([RGB, RGB[..., :2]], axis=-1), "RGBUV"), SOUND),
    "HDR": Wrong(hdr(), SOUND, "map.hdr"),
    "PNG by another name": Wrong(image(form=".exr"), SOUND, "map.png"),
    "window elsewhere": Wrong(image(x=5, y=-3, full_x=5, full_y=-3), SOUND),
    "scrambled EXR": Wrong(damaged(exr(), flip_bits(0.5)), ANY),
    "scrambled PNG": Wrong(damaged(image(kind="uint16"), flip_bits(0.5)), ANY, "map.png"),
    "no color": Wrong(exr(RGB, "UVW")),
    "many channels": Wrong(image(np.repeat(_A, 200, axis=-1), channelnames=tuple(f"c{i}" for i in range(200)))),
    "huge window": Wrong(image(full_width=_MANY, full_height=_MANY)),
    "long window": Wrong(image(full_width=2**25, full_height=8)),
    "huge HDR": Wrong(hdr(f"-Y {_MANY} +X {_MANY}"), name="map.hdr"),
    "NaN": Wrong(exr(_texels(np.nan))),
    "infinite": Wrong(exr(_texels(np.inf, -np.inf))),
    **{
        f"PNG that claims {w} x {h}": Wrong(_claimed_png(w, h), name="map.png")
        for w, h in ((16384, 16384), (_LONG, 1), (1, _LONG), (_LONG, _LONG), (0, 8), (8, 0), (10000, 10000))
    },
    "PNG of odd depth": Wrong(_claimed_png(16, 8, 7), name="map.png"),
    "damaged header": Wrong(
        damaged(image(kind="uint8"), lambda data, rng: data[:20] + bytes([data[20] ^ 1]) + data[21:]), name="map.png"
    ),
}  # fmt: skip
