"""Small files that crash, stall or swell the libraries that read them.

They are tried through the command line, which reads files in a child process that it supervises; in the pool of
`pool.py` they would end the process of many cases. A seed whose case there is a crash belongs here.
"""

from collections.abc import Callable
from pathlib import Path

from pxr import Sdf
from usd_sound import CUBE

_HEAD = '#usda 1.0\n(\n    defaultPrim = "Root"\n    metersPerUnit = 0.5\n    upAxis = "Y"\n)\n'


def _xform(name: str, body: str) -> str:
    return f'def Xform "{name}"\n{{\n{body}}}\n'


def _levels(arc: str) -> list[str]:
    """Return the bodies of prims, each of which has ten children that refer to the one before, by its number."""
    children = [
        "".join(f'    def "C{i}" (references = {arc.format(level)})\n    {{\n    }}\n' for i in range(10))
        for level in range(9)
    ]
    return [f'    def Mesh "Body"\n    {{\n{CUBE}\n    }}\n', *children]


def _write_layers(folder: Path) -> Path:
    """Write a chain of layers, whose prims each refer ten times to the next."""
    for number, body in enumerate(_levels("@part{}.usda@</Root>")):
        file = folder / (f"part{number}.usda" if number < 9 else "asset.usda")
        file.write_text(_HEAD + _xform("Root", body))
    return file


def _write_layer(folder: Path) -> Path:
    """Write one layer, whose prims refer to others of it."""
    prims = [_xform(f"P{number}" if number < 9 else "Root", body) for number, body in enumerate(_levels("</P{}>"))]
    (folder / "asset.usda").write_text(_HEAD + "".join(prims))
    return folder / "asset.usda"


def _write_nested(folder: Path) -> Path:
    """Write a binary layer of 2,000 prims inside each other."""
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    with Sdf.ChangeBlock():
        Sdf.CreatePrimInLayer(layer, Sdf.Path("/P" * 2_000))
    layer.Export(str(folder / "asset.usdc"))
    return folder / "asset.usdc"


BOMBS: dict[str, Callable[[Path], Path]] = {
    "references in one layer, tenfold, 9 deep": _write_layer,
    "references, tenfold, 9 deep": _write_layers,
    "2,000 nested prims in a binary layer": _write_nested,
}
