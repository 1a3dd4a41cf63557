"""Rigs with one thing wrong: an attribute of a light, its transform, its files, the text, or what the file is."""

from __future__ import annotations

import random
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from cases import Case, Kind, Reading
from text_changes import ANY, CHANGES, NO_FILES, REFUSED, odd

from lookdev.light.dome.files import write_exr
from lookdev.light.rig import load_rig

_TEXT = """#usda 1.0
( defaultPrim = "Rig"
  upAxis = "Y"
  metersPerUnit = 0.01 )
def Xform "Rig"
{
    custom bool lookdev:fit = false
    def RectLight "Key" (prepend apiSchemas = ["ShapingAPI", "ShadowAPI"])
    {
        float inputs:intensity = 3
        float inputs:exposure = 1
        color3f inputs:color = (1, 0.5, 0.25)
        bool inputs:normalize = true
        bool inputs:enableColorTemperature = true
        float inputs:colorTemperature = 4000
        float inputs:diffuse = 0.5
        float inputs:width = 100
        asset inputs:texture:file = @box.exr@
        float inputs:shaping:cone:angle = 40
        color3f inputs:shaping:focusTint = (1, 0, 0)
        asset inputs:shaping:ies:file = @lamp.ies@
        bool inputs:shaping:ies:normalize = true
        bool inputs:shadow:enable = true
        color3f inputs:shadow:color = (0, 0, 0.5)
        float inputs:shadow:distance = 200
        float lookdev:falloff:exponent = 1.5
        bool lookdev:turns = false
        token lookdev:lightGroup = "keys"
        token visibility = "inherited"
        double3 xformOp:translate = (0, 300, 0)
        float xformOp:rotateX = -80
        double3 xformOp:scale = (1, 2, 1)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX", "xformOp:scale"]
    }
    def CylinderLight "Tube"
    {
        float inputs:length = 150
        float inputs:radius = 3
        bool treatAsLine = false
    }
    def DistantLight "Sun"
    {
        float inputs:angle = 0.6
    }
    def DomeLight_1 "Sky"
    {
        asset inputs:texture:file = @sky.exr@
        token inputs:texture:format = "automatic"
        uniform token poleAxis = "scene"
        float lookdev:local:radius = 900
        float lookdev:local:edge = 0.5
    }
}
"""
_LINES = _TEXT.splitlines()
_SPOTS = [number for number, line in enumerate(_LINES) if number > 5 and " = " in line and "def " not in line]
_INPUTS = [number for number in _SPOTS if "inputs:" in _LINES[number] or "lookdev:" in _LINES[number]]
_VALUES = {
    "int": "3",
    "double": "nan",
    "float": "-inf",
    "half": "-1",
    "string": '"ODD"',
    "token": '"ODD"',
    "bool": "1",
    "color3f": "(nan, 1, 1)",
    "float3": "(1, -1, 1)",
    "float[]": "[1, 2]",
    "token[]": '["ODD"]',
    "asset": "@nothing.exr@",
    "matrix4d": "((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
    "dictionary": "{}",
}
_NUMBERS = ("nan", "inf", "-1", "0", "1e38", "1e-38", "1e999")
_TRANSFORMS = (
    "((1,1,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
    "((0,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
    "((nan,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
    "((1,0,0,0),(0,1,0,0),(0,0,1,0),(1e300,0,0,1))",
    "((1,0,0,1),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
)
_FILES = ("box.exr", "sky.exr", "lamp.ies")
_PLANNED: tuple[tuple[str, ...], ...] = (
    *(("type", str(line), kind) for line in _SPOTS for kind in _VALUES),
    *(("number", str(line), value) for line in _INPUTS if "float" in _LINES[line] for value in _NUMBERS),
    *(("misspelt", str(line)) for line in _INPUTS),
    *(("connection", str(line)) for line in _INPUTS if "inputs:" in _LINES[line]),
    *(("animated", str(line)) for line in _INPUTS if "uniform" not in _LINES[line]),
    *(("transform", matrix) for matrix in _TRANSFORMS),
    *(("image", name, place) for name in _FILES for place in NO_FILES),
    *(("noise", name) for name in _FILES for _ in range(4)),
    *(("text", name) for name in CHANGES for _ in range(5)),
    *(("place", name) for name in NO_FILES),
)


def _write(folder: Path) -> None:
    (folder / "rig.usda").write_text(_TEXT)
    write_exr(folder / "box.exr", "RGB", np.full((4, 4, 3), 0.5, np.float32))
    write_exr(folder / "sky.exr", "RGB", np.full((4, 8, 3), 0.5, np.float32))
    (folder / "lamp.ies").write_text("IESNA91\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1 1 0\n0 90\n0\n4 2\n")


def _read(file: Path) -> Reading:
    found, folder = load_rig(file, sampled=False), str(file.parent)
    notes = tuple(note.replace(folder, "") for note in found.notes)
    return Reading({each.path: repr(each).replace(folder, "") for each in found.given} | {"fit": found.fit}, notes)


@cache
def _sound() -> Reading:
    with TemporaryDirectory() as name:
        _write(Path(name))
        return _read(Path(name) / "rig.usda")


def make(rng: random.Random, number: int, folder: Path) -> Case:
    """Write the files of a case."""
    order = list(range(len(_PLANNED)))
    random.Random("order").shuffle(order)
    what, *rest = _PLANNED[order[number % len(order)]]
    file = folder / "rig.usda"
    _write(folder)
    lines = list(_LINES)
    expected, names = REFUSED, ("rig.usda", "/Rig")
    strange = odd(rng).replace("\x1b", "\\x1b").replace("\x07", "\\x07")
    match what, *rest:
        case "type", line, kind:
            name = lines[int(line)].partition(" = ")[0].split()[-1]
            own = lines[int(line)].removeprefix("    custom").split()[0]
            lines[int(line)] = f"{kind} {name} = {_VALUES[kind].replace('ODD', strange)}"
            names = ("rig.usda",)
            expected = ANY if {own, kind} <= {"int", "float", "double", "half", "bool", "token", "string"} else REFUSED
            # Both are vectors of three floats.
            expected = ANY if own in ("color3f", "double3") and kind in ("color3f", "float3") else expected
            # Of attributes that no light reads, and of an operation that a type does not change.
            expected = ANY if name.startswith("xformOp") or name == "visibility" else expected
        case "number", line, value:
            lines[int(line)] = f"{lines[int(line)].partition(' = ')[0]} = {value}"
            names, expected = ("rig.usda",), ANY if value not in ("nan", "inf", "1e999") else REFUSED
        case "misspelt", line:
            name = lines[int(line)].partition(" = ")[0].split()[-1]
            place = rng.randrange(name.index(":") + 1, len(name))
            changed = name[:place] + name[place + 1 :] if name[place] != ":" else f"{name[:place]}_{name[place + 1 :]}"
            lines[int(line)] = lines[int(line)].replace(name, changed)
            expected = ANY if "lookdev:fit" in name else REFUSED
        case "connection", line:
            kind, name = lines[int(line)].partition(" = ")[0].split()[-2:]
            lines[int(line)] = f"{kind} {name}.connect = </Rig/Noise.outputs:out>"
        case "animated", line:
            before, _, value = lines[int(line)].partition(" = ")
            lines[int(line)] = f"{before}.timeSamples = {{ 0: {value}, 5: {value} }}"
            expected = frozenset({"noted"})
        case "transform", matrix:
            text = f'matrix4d xformOp:transform = {matrix}\nuniform token[] xformOpOrder = ["xformOp:transform"]\n'
            lines.insert(next(n for n, line in enumerate(lines) if "Tube" in line) + 2, text)
            names = (*names, "Tube")
        case "image", name, place:
            (folder / name).unlink()
            NO_FILES[place][0](folder / name)
            names = (*names, name)
        case "noise", name:
            data = bytearray((folder / name).read_bytes())
            for _ in range(rng.choice((1, 3, 30))):
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            (folder / name).write_bytes(data)
            expected, names = ANY, ("rig.usda|" + name,)
        case "text", name:
            file.write_bytes(CHANGES[name].make(rng, _TEXT.encode()))
            expected = CHANGES[name].expected | ({"refused"} if name == "a mark at its start" else frozenset())
            names = ("rig.usda",)
        case "place", name:
            file.unlink()
            NO_FILES[name][0](file)
            names = ("rig.usda",)
    if what not in ("text", "place"):
        file.write_text("\n".join(lines) + "\n")
    title = " ".join((what, *(each[:40] for each in rest)))
    return Case(title, expected, lambda: _read(file), _sound, names)


RIGS = Kind("rigs", make, len(_PLANNED))
