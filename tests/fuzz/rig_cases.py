"""Rigs with one thing wrong: an attribute of a light, its transform, its files, the text, or what the file is."""

import random
from pathlib import Path
from typing import Any

import numpy as np
from cases import ANY_MEANING, NOTED, REFUSED, Case, Reading, planned_kind, reading_of
from damage import flip_bits
from text_changes import NO_FILES, text_plan
from usda_lines import TYPES, animated, declaration, retyped, spoil_layer

from lookdev.light.dome.environment import write_exr
from lookdev.light.rig import load_rig

_TEXT = """#usda 1.0
( defaultPrim = "Rig"
  upAxis = "Y"
  metersPerUnit = 0.01 )
def Xform "Rig" {
    custom bool lookdev:fit = false
    def RectLight "Key" (prepend apiSchemas = ["ShapingAPI", "ShadowAPI"]) {
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
    def CylinderLight "Tube" {
        float inputs:length = 150
        float inputs:radius = 3
        bool treatAsLine = false
    }
    def DistantLight "Sun" {
        float inputs:angle = 0.6
    }
    def DomeLight_1 "Sky" {
        asset inputs:texture:file = @sky.exr@
        token inputs:texture:format = "automatic"
        uniform token poleAxis = "scene"
        float lookdev:local:radius = 900
        float lookdev:local:edge = 0.5
    }
}
"""
_LINES = _TEXT.splitlines()
_SPOTS = [number for number, line in enumerate(_LINES) if number > 4 and " = " in line and "def " not in line]
_INPUTS = [number for number in _SPOTS if "inputs:" in _LINES[number] or "lookdev:" in _LINES[number]]
_SCALARS = {"int", "float", "double", "half", "bool", "token", "string"}
_NUMBERS = ("nan", "inf", "-1", "0", "1e38", "1e-38", "1e999")
_TRANSFORMS = (
    "((1,1,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
    "((0,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
    "((nan,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
    "((1,0,0,0),(0,1,0,0),(0,0,1,0),(1e300,0,0,1))",
    "((1,0,0,1),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
)
_FILES = ("box.exr", "sky.exr", "lamp.ies")
_PLAN: tuple[tuple[Any, ...], ...] = (
    *(("type", line, kind) for line in _SPOTS for kind in TYPES),
    *(("number", line, value) for line in _INPUTS if "float" in _LINES[line] for value in _NUMBERS),
    *(("misspelt", line) for line in _INPUTS),
    *(("connection", line) for line in _INPUTS if "inputs:" in _LINES[line]),
    *(("animated", line) for line in _INPUTS if "uniform" not in _LINES[line]),
    *(("transform", matrix) for matrix in _TRANSFORMS),
    *(("image", name, instead) for name in _FILES for instead in NO_FILES),
    *(("noise", name) for name in _FILES for _ in range(4)),
    *text_plan(5),
)


def _write(folder: Path) -> None:
    (folder / "rig.usda").write_text(_TEXT)
    write_exr(folder / "box.exr", "RGB", np.full((4, 4, 3), 0.5, np.float32))
    write_exr(folder / "sky.exr", "RGB", np.full((4, 8, 3), 0.5, np.float32))
    (folder / "lamp.ies").write_text("IESNA91\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1 1 0\n0 90\n0\n4 2\n")


def _read(file: Path) -> Reading:
    rig, folder = load_rig(file, sampled=False), str(file.parent)
    notes = tuple(note.replace(folder, "") for note in rig.notes)
    return Reading({light.path: repr(light).replace(folder, "") for light in rig.rig_lights} | {"fit": rig.fit}, notes)


_sound = reading_of(_write, lambda folder: _read(folder / "rig.usda"))


def _types_expected(line: str, kind: str) -> frozenset[str]:
    """Return what must become of an attribute of another type."""
    own, name = declaration(line)
    if {own, kind} <= _SCALARS and "uniform" not in line:
        return ANY_MEANING
    if own in ("color3f", "double3") and kind in ("color3f", "float3"):
        return ANY_MEANING  # both are vectors of three floats
    # Of attributes that no light reads, and of an operation that a type does not change.
    return ANY_MEANING if name.startswith("xformOp") or name == "visibility" else REFUSED


def make(rng: random.Random, planned: tuple[Any, ...], folder: Path) -> Case:
    """Write the files of a case."""
    _write(folder)
    file, lines = folder / "rig.usda", list(_LINES)
    expected, names = REFUSED, ("rig.usda", "/Rig")
    match planned:
        case "type", line, kind:
            expected, names = _types_expected(lines[line], kind), ("rig.usda",)
            lines[line] = retyped(lines[line], kind, rng)
        case "number", line, value:
            lines[line] = f"{lines[line].partition(' = ')[0]} = {value}"
            names, expected = ("rig.usda",), ANY_MEANING if value not in ("nan", "inf", "1e999") else REFUSED
        case "misspelt", line:
            name = declaration(lines[line])[1]
            place = rng.randrange(name.index(":") + 1, len(name))
            other = name[:place] + ("_" if name[place] == ":" else "") + name[place + 1 :]
            lines[line] = lines[line].replace(name, other)
            expected = ANY_MEANING if "lookdev:fit" in name else REFUSED
        case "connection", line:
            lines[line] = "{} {}.connect = </Rig/Noise.outputs:out>".format(*declaration(lines[line]))
        case "animated", line:
            lines[line], expected = animated(lines[line]), NOTED
        case "transform", matrix:
            text = f'matrix4d xformOp:transform = {matrix}\nuniform token[] xformOpOrder = ["xformOp:transform"]\n'
            lines.insert(next(number for number, line in enumerate(lines) if "Tube" in line) + 1, text)
            names = (*names, "Tube")
        case "image", name, instead:
            (folder / name).unlink()
            NO_FILES[instead][0](folder / name)
            names = (*names, name)
        case "noise", name:
            (folder / name).write_bytes(flip_bits()((folder / name).read_bytes(), rng))
            expected, names = ANY_MEANING, ("rig.usda|" + name,)
    file.write_text("\n".join(lines) + "\n")
    if planned[0] in ("text", "place"):
        expected, names = spoil_layer(planned, rng, file, _TEXT), ("rig.usda",)
    return Case(" ".join(str(part)[:40] for part in planned), expected, lambda: _read(file), _sound, names)


RIGS = planned_kind("rigs", _PLAN, make)
