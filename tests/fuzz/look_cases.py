"""Looks with one thing wrong: a property of a node, its expression, the text, or what the file is."""

from __future__ import annotations

import random
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from cases import Case, Kind, Reading, Shown
from pictures import job
from text_changes import ANY, CHANGES, NO_FILES, REFUSED, odd
from usd_sound import PIXELS

from lookdev.material import Formula
from lookdev.material.look import leaves
from lookdev.material.usd.bound import read_any_look

_TEXT = """#usda 1.0
( defaultPrim = "M" )
def Material "M"
{
    token outputs:lookdev:surface.connect = </M/Layers.outputs:layer>
    def Shader "Layers"
    {
        uniform token info:id = "LookdevLayers"
        token inputs:base.connect = </M/Base.outputs:layer>
        token inputs:layer1.connect = </M/Coat.outputs:layer>
        float inputs:layer1Mask.connect = </M/Mask.outputs:result>
        token inputs:layer1Mode = "over"
        bool inputs:layer1Enabled = true
    }
    def Shader "Base"
    {
        uniform token info:id = "LookdevDisney"
        color3f inputs:baseColor.connect = </M/Image.outputs:rgb>
        float inputs:roughness = 0.25
        color3f inputs:subsurfaceTint = (0.5, 0.25, 1)
    }
    def Shader "Coat"
    {
        uniform token info:id = "LookdevDisney"
        float inputs:metallic.connect = </M/Wear.outputs:result>
    }
    def Shader "Mask"
    {
        uniform token info:id = "LookdevExpression"
        string inputs:expression = "clamp(wear * dirt + 0.25, 0, 1)"
        float inputs:wear.connect = </M/Wear.outputs:result>
        float inputs:dirt = 0.5
    }
    def Shader "Wear"
    {
        uniform token info:id = "UsdPrimvarReader_float"
        string inputs:varname = "wear"
        float inputs:fallback = 0.5
    }
    def Shader "Image"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @color.png@
        token inputs:wrapS = "repeat"
        token inputs:sourceColorSpace = "sRGB"
        float4 inputs:scale = (1, 0.5, 1, 1)
        float2 inputs:st.connect = </M/Reader.outputs:result>
    }
    def Shader "Reader"
    {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
    }
}
"""
_TEXT = _TEXT.replace("        color3f inputs:subsurfaceTint = (0.5, 0.25, 1)\n", "")
_LINES = _TEXT.splitlines()
_SPOTS = [number for number, line in enumerate(_LINES) if "inputs:" in line or "info:id" in line]
_JOB = job('builtin = "sphere"', 'material = "look.usda"')
_VALUES = {
    "int": "1",
    "double": "0.5",
    "string": '"0.5"',
    "float": "nan",
    "float2": "(nan, 1)",
    "float3": "(inf, 1, 1)",
    "float4": "(1, 1, 1, -inf)",
    "matrix4d": "((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
    "float[]": "[0.5]",
    "token[]": '["a"]',
    "asset": "@nothing.png@",
    "bool": "1",
    "token": '"ODD"',
    "dictionary": "{}",
}
_TARGETS = (
    "</M/Nothing.outputs:result>",
    "</M/Base.outputs:nothing>",
    "</M>",
    "</Other.a>",
    "</M/Base.inputs:roughness>",
)
_TARGETS += ("[</M/Base.outputs:layer>, </M/Coat.outputs:layer>]", "<SELF>")
_EXPRESSIONS = ("", "1 +", "wear + nothing", "nothing(wear)", "[wear, 1]", "wear[0]", "ODD", "$wear", "clamp(wear)")
_EXPRESSIONS += (
    "(" * 900 + "wear" + ")" * 900,
    "-" * 900 + "wear",
    "9" * 5000,
    "1e999",
    "wear" * 20_000,
    "+".join(["wear"] * 900),
)
_PLANNED: tuple[tuple[str, ...], ...] = (
    *(("type", str(line), kind) for line in _SPOTS for kind in _VALUES),
    *(("connection", str(line), target) for line in _SPOTS for target in _TARGETS if "inputs:" in _LINES[line]),
    *(("animated", str(line)) for line in _SPOTS if " = " in _LINES[line] and "info:id" not in _LINES[line]),
    *(("expression", text) for text in _EXPRESSIONS),
    *(("ladder", way) for way in ("17", "29", "31", "200", "cycle")),
    *(("text", name) for name in CHANGES for _ in range(5)),
    *(("place", name) for name in NO_FILES),
)


def _read(file: Path) -> Reading:
    found = read_any_look(file, None, {}, "M")
    folder = str(file.parent)
    notes = tuple(str(note).replace(folder, "") for note in found.lost)
    # Not the text of the whole look: expressions that share another one are as long as their paths are many.
    read = [
        (layer.name, layer.mode, sorted(layer.inputs), list(leaves([*layer.inputs.values(), layer.mask])))
        for layer in found.look.layers
    ]
    masks = [each.mask.expression.text for each in found.look.layers if isinstance(each.mask, Formula)]
    return Reading({"layers": repr(read).replace(folder, "FOLDER"), "masks": masks}, notes)


@cache
def _sound() -> Reading:
    with TemporaryDirectory() as name:
        _write(Path(name))
        return _read(Path(name) / "look.usda")


def _write(folder: Path, notes: str = "") -> str:
    """Write the sound look, and return the job that shows it."""
    (folder / "color.png").write_bytes(PIXELS)
    (folder / "look.usda").write_text(_TEXT)
    return _JOB


def _ladder(way: str) -> str:
    """Return a look whose mask is a chain of expressions, each of which reads the next twice."""
    count = 20 if way == "cycle" else int(way)
    node = """    def Shader "E{0}"
    {{
        uniform token info:id = "LookdevExpression"
        string inputs:expression = "a + b"
        float inputs:a.connect = </M/{1}.outputs:result>
        float inputs:b.connect = </M/{1}.outputs:result>
    }}
"""
    last = "E0" if way == "cycle" else "Wear"
    nodes = "".join(node.format(n, f"E{n + 1}" if n < count - 1 else last) for n in range(count))
    return _TEXT.replace("</M/Mask.outputs:result>", "</M/E0.outputs:result>").rstrip()[:-1] + nodes + "}\n"


def make(rng: random.Random, number: int, folder: Path) -> Case:
    """Write the files of a case."""
    order = list(range(len(_PLANNED)))
    random.Random("order").shuffle(order)
    what, *rest = _PLANNED[order[number % len(order)]]
    file = folder / "look.usda"
    (folder / "color.png").write_bytes(PIXELS)
    lines = list(_LINES)
    expected, names = REFUSED, ("look.usda",)
    strange = odd(rng).replace("\x1b", "\\x1b").replace("\x07", "\\x07")
    sound = _sound
    match what, *rest:
        case "type", line, kind:
            own, name = lines[int(line)].split()[:2]
            name = "info:id" if own == "uniform" else name.removesuffix(".connect")
            lines[int(line)] = f"{kind} {name} = {_VALUES[kind].replace('ODD', strange)}"
            names = (*names, "/M")
            if own == kind or (own, kind) in (("string", "token"), ("bool", "bool")):
                expected = ANY
        case "connection", line, target:
            own, name = lines[int(line)].split()[:2]
            name = name.removesuffix(".connect")
            prim = next(each.split('"')[1] for each in reversed(lines[: int(line)]) if "Shader" in each)
            lines[int(line)] = f"{own} {name}.connect = {target.replace('SELF', f'/M/{prim}.{name}')}"
            names, expected = (*names, "/M"), ANY if target == "</M/Base.inputs:roughness>" else REFUSED
        case "animated", line:
            own, name, _, value = lines[int(line)].split(maxsplit=3)
            if ".connect" in name:
                expected = frozenset({"sound"})
            else:
                lines[int(line)] = f"{own} {name}.timeSamples = {{ 0: {value}, 5: {value} }}"
                names = (*names, "/M", "animated")
        case "expression", text:
            number_of = next(n for n, each in enumerate(lines) if "inputs:expression" in each)
            lines[number_of] = f'string inputs:expression = "{text.replace("ODD", strange)}"'
            names = (*names, "/M/Mask")
        case "ladder", way:
            lines = _ladder(way).splitlines()
            names = (*names, "/M/E")
            if way in ("17", "29", "31"):
                expected = frozenset({"silent"})  # it is a sound look, of another mask
        case "text", name:
            file.write_bytes(CHANGES[name].make(rng, _TEXT.encode()))
            expected = CHANGES[name].expected | ({"refused"} if name == "a mark at its start" else frozenset())
        case "place", name:
            NO_FILES[name][0](file)
    if what not in ("text", "place"):
        file.write_text("\n".join(lines) + "\n")
    title = " ".join((what, *(each[:40] for each in rest)))
    return Case(title, expected, lambda: _read(file), sound, names, shown=Shown(_JOB, {"sound": _write}))


LOOKS = Kind("looks", make, len(_PLANNED))
