"""Malformed files that are not USD's text: binary layers, images, and what only looks like a file."""

from __future__ import annotations

import os
import random
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from look_files import write_gray
from pxr import Sdf

Expected = Literal["faulty", "valid", "any"]

BAD_IMAGES = (
    "folder.png",
    "pipe.png",
    "empty.png",
    "text.png",
    "cut.png",
    "cut.exr",
    "bomb.png",
    "bomb.exr",
    "noise.exr",
)
BAD_LAYERS = (
    "folder.usda",
    "pipe.usda",
    "empty.usda",
    "noise.usda",
    "noise.usdc",
    "noise.usdz",
    "deep.usda",
    "gone.usda",
)


@dataclass(frozen=True)
class Case:
    """A look file; `expected` is its state by construction: ``any`` where it depends on chance."""

    name: str
    file: Path
    expected: Expected = "faulty"


def write_layers(folder: Path, good: Mapping[str, str], referring: str, chance: random.Random) -> list[Case]:
    """Write layers that texts name and binary ones; `good` looks, and one that is `referring` to OTHER."""
    cases: list[Case] = []

    def add(name: str, file: str, content: bytes | None, expected: Expected = "faulty") -> None:
        if content is not None:
            (folder / file).write_bytes(content)
        cases.append(Case(f"files: {name}", folder / file, expected))

    for name, other in (("a", "b"), ("b", "a")):
        text = referring.replace("OTHER", f"ring_{other}.usda")
        add(f"references in a ring, {name}", f"ring_{name}.usda", text.encode())
    for name, other in (("c", "d"), ("d", "c")):
        text = good["disney"].replace("(\n", f"(\nsubLayers = [@./ring_{other}.usda@]\n", 1)
        add(f"sublayers in a ring, {name}", f"ring_{name}.usda", text.encode())
    (folder / "folder.usda").mkdir()
    add("a folder", "folder.usda", None)
    os.mkfifo(folder / "pipe.usda")
    add("a pipe", "pipe.usda", None)
    (folder / "loop.usda").symlink_to("loop.usda")
    add("a link to itself", "loop.usda", None)
    add("nothing", "gone.usda", None)
    add("a deep layer", "deep.usda", ("#usda 1.0\n" + 'def "a" {\n' * 100_000 + "}\n" * 100_000).encode())
    for ending, magic in (
        ("usd", b"PXR-USDC"),
        ("usda", b"#usda 1.0\n"),
        ("usdc", b"PXR-USDC"),
        ("usdz", b"PK\x03\x04"),
    ):
        add(f"an empty .{ending}", f"empty.{ending}", b"")
        add(f"a .{ending} of noise", f"noise.{ending}", chance.randbytes(10_000))
        for size in (10, 1000, 100_000):
            noise = magic + chance.randbytes(size)
            add(f"a .{ending} of {size} bytes of noise with its magic", f"magic{size}.{ending}", noise)
    return [*cases, *_binary(folder, good, chance)]


def _binary(folder: Path, good: Mapping[str, str], chance: random.Random) -> Iterator[Case]:
    """Write binary layers, cut and with bytes changed."""
    for name, text in good.items():
        layer = Sdf.Layer.CreateAnonymous(".usda")
        layer.ImportFromString(text)
        whole = folder / f"{name}.usdc"
        layer.Export(str(whole))
        yield Case(f"binary: {name}", whole, "valid")
        data = whole.read_bytes()
        # The table of contents is the last thing in the file.
        for size in chance.sample(range(len(data) - 8), 6):
            file = folder / f"{name}_{size}.usdc"
            file.write_bytes(data[:size])
            yield Case(f"binary: {name} cut at {size}", file)
        for number in range(12):
            changed = bytearray(data)
            for place in chance.sample(range(len(data)), chance.choice((1, 2, 8))):
                changed[place] = chance.randrange(256)
            file = folder / f"{name}_changed{number}.usdc"
            file.write_bytes(changed)
            yield Case(f"binary: {name} with bytes changed, {number}", file, "any")
        text_as_binary = folder / f"{name}_text.usdc"
        text_as_binary.write_text(text)
        yield Case(f"binary: {name} is text", text_as_binary)


def _png(width: int, height: int, pixels: bytes) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(pixels)) + chunk(b"IEND", b"")


def write_images(folder: Path) -> None:
    """Write an image that is right, and `BAD_IMAGES`."""
    write_gray(folder / "gray.png", size=64)
    write_gray(folder / "gray.exr", kind="half", size=64)
    exr = (folder / "gray.exr").read_bytes()
    (folder / "folder.png").mkdir()
    os.mkfifo(folder / "pipe.png")
    bomb = bytearray(exr)
    for window in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        struct.pack_into("<ii", bomb, bomb.index(window) + len(window) + 4 + 8, 99_999, 99_999)
    for name, content in {
        "empty.png": b"",
        "text.png": b"not an image\n" * 100,
        "cut.png": (folder / "gray.png").read_bytes()[:60],
        "cut.exr": exr[: len(exr) // 2],
        "bomb.png": _png(100_000, 100_000, b"\0" * 100),
        "bomb.exr": bytes(bomb),
        "noise.exr": struct.pack("<I", 20000630) + random.Random(1).randbytes(1000),
    }.items():
        (folder / name).write_bytes(content)
