"""The reader of images: an image that must not be read is refused by name, before its pixels are in memory."""

import os
import resource
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.errors import OutputError, TextureError
from lookdev.images import DEFAULT_PIXELS, PIXELS_VARIABLE, check_file, open_image, whole_image

pytestmark = pytest.mark.both_pythons


def write(file: Path, pixels: np.ndarray, **options: object) -> Path:
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, oiio.FLOAT)
    for name, value in options.items():
        if name == "compression":
            spec.attribute(name, str(value))
        else:
            setattr(spec, name, value)
    output = oiio.ImageOutput.create(str(file))
    assert output.open(str(file), spec)
    assert output.write_image(np.ascontiguousarray(pixels, np.float32))
    assert output.close()
    return file


def read(file: Path) -> np.ndarray:
    with open_image(file, TextureError) as image:
        return whole_image(image, file, range(image.spec().nchannels), TextureError)


@pytest.mark.parametrize(
    "options",
    [{}, {"tile_width": 32, "tile_height": 16}, {"x": 3, "y": -2}, {"tile_width": 16, "tile_height": 16, "y": 9}],
)
@pytest.mark.parametrize("strip", [70, 1 << 20])
def test_pixels_are_read_in_strips(tmp_path, monkeypatch, options, strip):
    monkeypatch.setattr("lookdev.images._STRIP", strip)
    pixels = np.random.default_rng(1).random((37, 50, 3)).astype(np.float32)
    np.testing.assert_array_equal(read(write(tmp_path / "a.exr", pixels, **options)), pixels)


@pytest.mark.parametrize("options", [{}, {"tile_width": 32, "tile_height": 16}, {"tile_width": 64, "tile_height": 64}])
def test_the_first_block_of_dwa_is_decoded_alone(tmp_path, monkeypatch, options):
    monkeypatch.setattr("lookdev.images._dwa_decoded", False)
    pixels = np.random.default_rng(1).random((37, 50, 3))
    file = write(tmp_path / "a.exr", pixels, compression="dwab", **options)
    sizes = []
    with open_image(file, TextureError) as image:

        class Spy:
            """An open image that records the number of pixels of each read."""

            def __getattr__(self, name: str) -> Any:
                attribute = getattr(image, name)
                if not name.startswith("read_"):
                    return attribute

                def read(*arguments: int) -> Any:
                    sizes.append((part := attribute(*arguments)).size // 3)
                    return part

                return read

        for _ in range(2):
            decoded = whole_image(cast("oiio.ImageInput", Spy()), file, range(3), TextureError)
    first = options and min(options["tile_width"], 50) * min(options["tile_height"], 37)
    assert sizes == [first or 50, 37 * 50, 37 * 50]
    np.testing.assert_allclose(decoded, pixels, atol=0.1)


@pytest.mark.proof
def test_all_processes_read_a_dwa_map_alike():
    program = "from lookdev.light import load_environment; print(load_environment(builtin='sunset').digest)"
    digests = {subprocess.run([sys.executable, "-c", program], capture_output=True).stdout for _ in range(250)}
    assert len(digests) == 1


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def claimed_png(file: Path, side: int = 16384) -> None:
    """Write a PNG of few bytes that claims many pixels."""
    header = struct.pack(">IIBBBBB", side, side, 8, 6, 0, 0, 0)
    data = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(99))) + chunk(b"IEND", b"")
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + data)


def sparse(file: Path) -> None:
    write(file.with_suffix(".exr"), np.zeros((2, 2, 3))).rename(file)
    os.truncate(file, 33 * DEFAULT_PIXELS)


def windowed(file: Path) -> None:
    write(file.with_suffix(".exr"), np.zeros((2, 2, 3)), full_width=200_000, full_height=100_000).rename(file)


REFUSED: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda file: None, "no such image file"),
    "empty": (Path.touch, "it is empty"),
    "folder": (Path.mkdir, "is not a regular file"),
    "pipe": (os.mkfifo, "is not a regular file"),
    "device": (lambda file: file.symlink_to("/dev/zero"), "is not a regular file"),
    "loop": (lambda file: file.symlink_to(file), "cannot be read"),
    "text": (lambda file: file.write_text("not an image"), "cannot be read as an image"),
    "claimed": (
        claimed_png,
        f"is 16384 x 16384 pixels large; at most {PIXELS_VARIABLE} = {DEFAULT_PIXELS} pixels|header claims",
    ),
    "sparse": (sparse, rf"has {33 * DEFAULT_PIXELS} bytes; .*{PIXELS_VARIABLE} = {DEFAULT_PIXELS} pixels"),
    "window": (windowed, "is 200000 x 100000 pixels large; at most"),
    "hdr": (
        lambda file: file.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 100000\n" + bytes(99)),
        "is 100000 x 100000 pixels large; at most|appears to be 100000x100000",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_must_not_be_read_is_refused_by_name(tmp_path, name):
    make, message = REFUSED[name]
    file = tmp_path / f"image.{'hdr' if name == 'hdr' else 'png'}"
    make(file)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(TextureError, match=message) as caught:
        read(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jpg", ".exr"])
@pytest.mark.parametrize("part", [0.99, 0.7])
def test_an_image_that_is_cut_off_is_refused(tmp_path, suffix, part):
    """Some readers fill in missing pixels."""
    file = write(tmp_path / f"a{suffix}", np.random.default_rng(1).random((64, 64, 3)))
    assert read(file).shape == (64, 64, 3)
    os.truncate(file, int(part * file.stat().st_size))
    with pytest.raises(TextureError, match="cannot be read as an image"):
        read(file)


def test_a_changed_byte_of_a_png_is_seen(tmp_path, capfd):
    file = write(tmp_path / "a.png", np.random.default_rng(1).random((64, 64, 3)))
    data = bytearray(file.read_bytes())
    for index in range(8, len(data), 97):
        data[index] ^= 1
        file.write_bytes(data)
        with pytest.raises(TextureError, match=r"the PNG|header"):
            read(file)
        data[index] ^= 1
    assert capfd.readouterr().err == ""


def test_the_limit_is_an_option(tmp_path, monkeypatch):
    file = write(tmp_path / "a.exr", np.zeros((30, 40, 3)))
    monkeypatch.setenv(PIXELS_VARIABLE, "1199")
    with pytest.raises(TextureError, match=f"at most {PIXELS_VARIABLE} = 1199 pixels"):
        read(file)
    monkeypatch.setenv(PIXELS_VARIABLE, "1200")
    assert read(file).shape == (30, 40, 3)
    for wrong in ("many", "-1", "0", "1e9", "9" * 5000):
        monkeypatch.setenv(PIXELS_VARIABLE, wrong)
        with pytest.raises(OutputError, match=f"{PIXELS_VARIABLE} is '") as caught:
            check_file(file, TextureError)
        assert len(str(caught.value)) < 200
