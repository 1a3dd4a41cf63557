"""Small files that crash, stall or swell the libraries that read them.

They are tried through the command line, which reads files in a child process that it supervises; in the pool of
`pool.py` they would end the process of many cases. A seed whose case there is a crash belongs here.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pxr import Sdf
from usd_sound import CUBE

_HEAD = '#usda 1.0\n(\n    defaultPrim = "Root"\n    metersPerUnit = 0.5\n    upAxis = "Y"\n)\n'


def _references(times: int, deep: int, arc: str = "references") -> Callable[[Path], Path]:
    """Return what writes prims that each refer so many times to the next."""

    def write(folder: Path) -> Path:
        levels = [f'def Xform "Root"\n{{\n    def Mesh "Body"\n    {{\n{CUBE}\n    }}\n}}\n']
        levels += [
            'def Xform "Root"\n{\n'
            + "".join(f'    def "C{i}" ({arc} = @part{level}.usda@</Root>)\n    {{\n    }}\n' for i in range(times))
            + "}\n"
            for level in range(deep)
        ]
        for number, text in enumerate(levels):
            name = "asset.usda" if number == deep else f"part{number}.usda"
            (folder / name).write_text(_HEAD + text)
        return folder / "asset.usda"

    return write


def _within(times: int, deep: int) -> Callable[[Path], Path]:
    """Return what writes one layer, whose prims refer to others of it."""

    def write(folder: Path) -> Path:
        parts = [f'def Xform "P0"\n{{\n    def Mesh "Body"\n    {{\n{CUBE}\n    }}\n}}\n']
        for level in range(deep):
            name = "Root" if level == deep - 1 else f"P{level + 1}"
            inner = "".join(f'    def "C{i}" (references = </P{level}>)\n    {{\n    }}\n' for i in range(times))
            parts.append(f'def Xform "{name}"\n{{\n{inner}}}\n')
        (folder / "asset.usda").write_text(_HEAD + "".join(parts))
        return folder / "asset.usda"

    return write


def _nested_binary(count: int) -> Callable[[Path], Path]:
    """Return what writes a binary layer of prims inside each other."""

    def write(folder: Path) -> Path:
        layer = Sdf.Layer.CreateAnonymous(".usdc")
        path = Sdf.Path("/" + "/".join(["P"] * count))
        with Sdf.ChangeBlock():
            Sdf.CreatePrimInLayer(layer, path)
        layer.Export(str(folder / "asset.usdc"))
        return folder / "asset.usdc"

    return write


BOMBS: dict[str, Callable[[Path], Path]] = {
    "references, tenfold, 9 deep": _references(10, 9),
    "payloads, tenfold, 9 deep": _references(10, 9, "payload"),
    "references in one layer, tenfold, 9 deep": _within(10, 9),
    "references in one layer, twofold, 30 deep": _within(2, 30),
    "2,000 nested prims in a binary layer": _nested_binary(2_000),
}
