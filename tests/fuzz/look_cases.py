"""Looks with one thing wrong: a property of a node, its expression, the text, or what the file is."""

import random
from pathlib import Path
from typing import Any

from cases import ANY_MEANING, REFUSED, SOUND, Case, Reading, Shown, planned_kind, reading_of
from pictures import job
from text_changes import text_plan
from usd_sound import PIXELS
from usda_lines import TYPES, animated, declaration, odd_text, retyped, spoil_layer

from lookdev.material import Formula, leaf_sources
from lookdev.material.usd.bound import read_any_look

_TEXT = """#usda 1.0
( defaultPrim = "M" )
def Material "M" {
    token outputs:lookdev:surface.connect = </M/Layers.outputs:layer>
    def Shader "Layers" {
        uniform token info:id = "LookdevLayers"
        token inputs:base.connect = </M/Base.outputs:layer>
        token inputs:layer1.connect = </M/Coat.outputs:layer>
        float inputs:layer1Mask.connect = </M/Mask.outputs:result>
        token inputs:layer1Mode = "over"
        bool inputs:layer1Enabled = true
    }
    def Shader "Base" {
        uniform token info:id = "LookdevDisney"
        color3f inputs:baseColor.connect = </M/Image.outputs:rgb>
        float inputs:roughness = 0.25
    }
    def Shader "Coat" {
        uniform token info:id = "LookdevDisney"
        float inputs:metallic.connect = </M/Wear.outputs:result>
    }
    def Shader "Mask" {
        uniform token info:id = "LookdevExpression"
        string inputs:expression = "clamp(wear * dirt + 0.25, 0, 1)"
        float inputs:wear.connect = </M/Wear.outputs:result>
        float inputs:dirt = 0.5
    }
    def Shader "Wear" {
        uniform token info:id = "UsdPrimvarReader_float"
        string inputs:varname = "wear"
        float inputs:fallback = 0.5
    }
    def Shader "Image" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @color.png@
        token inputs:wrapS = "repeat"
        token inputs:sourceColorSpace = "sRGB"
        float4 inputs:scale = (1, 0.5, 1, 1)
        float2 inputs:st.connect = </M/Reader.outputs:result>
    }
    def Shader "Reader" {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
    }
}
"""
_LINES = _TEXT.splitlines()
_SPOTS = [number for number, line in enumerate(_LINES) if "inputs:" in line or "info:id" in line]
_JOB = job('builtin = "sphere"', 'material = "look.usda"')
_TARGETS = (
    "</M/Nothing.outputs:result>",
    "</M/Base.outputs:nothing>",
    "</M>",
    "</Other.a>",
    "</M/Base.inputs:roughness>",
    "[</M/Base.outputs:layer>, </M/Coat.outputs:layer>]",
    "<SELF>",
)
_EXPRESSIONS = ("", "1 +", "wear + nothing", "nothing(wear)", "[wear, 1]", "wear[0]", "ODD", "$wear", "clamp(wear)")
_EXPRESSIONS += ("(" * 900 + "wear" + ")" * 900, "-" * 900 + "wear", "9" * 5000, "1e999", "wear" * 20_000)
_EXPRESSIONS += ("+".join(["wear"] * 900),)
_PLAN: tuple[tuple[Any, ...], ...] = (
    *(("type", line, kind) for line in _SPOTS for kind in TYPES),
    *(("connection", line, target) for line in _SPOTS for target in _TARGETS if "inputs:" in _LINES[line]),
    *(("animated", line) for line in _SPOTS if " = " in _LINES[line] and "info:id" not in _LINES[line]),
    *(("expression", text) for text in _EXPRESSIONS),
    *(("ladder", count) for count in (17, 29, 31, 200, "cycle")),
    *text_plan(5),
)


def _read(file: Path) -> Reading:
    found = read_any_look(file, None, {}, "M")
    folder = str(file.parent)
    notes = tuple(str(note).replace(folder, "") for note in found.losses)
    # Not the text of the whole look: expressions that share another one are as long as their paths are many.
    read = [
        (layer.name, layer.mode, sorted(layer.inputs), list(leaf_sources([*layer.inputs.values(), layer.mask])))
        for layer in found.look.layers
    ]
    masks = [layer.mask.expression.text for layer in found.look.layers if isinstance(layer.mask, Formula)]
    return Reading({"layers": repr(read).replace(folder, "FOLDER"), "masks": masks}, notes)


def _write(folder: Path, notes: str = "") -> str:
    """Write the sound look, and return the job that shows it."""
    (folder / "color.png").write_bytes(PIXELS)
    (folder / "look.usda").write_text(_TEXT)
    return _JOB


_sound = reading_of(_write, lambda folder: _read(folder / "look.usda"))


def _ladder(count: int | str) -> str:
    """Return a look whose mask is a chain of expressions, each of which reads the next twice."""
    names = [f"E{number}" for number in range(20 if count == "cycle" else int(count))]
    nodes = "".join(
        f"""    def Shader "{name}"
    {{
        uniform token info:id = "LookdevExpression"
        string inputs:expression = "a + b"
        float inputs:a.connect = </M/{read}.outputs:result>
        float inputs:b.connect = </M/{read}.outputs:result>
    }}
"""
        for name, read in zip(names, [*names[1:], "E0" if count == "cycle" else "Wear"], strict=True)
    )
    return _TEXT.replace("</M/Mask.outputs:result>", "</M/E0.outputs:result>").rstrip()[:-1] + nodes + "}\n"


def make(rng: random.Random, planned: tuple[Any, ...], folder: Path) -> Case:
    """Write the files of a case."""
    _write(folder)
    file, lines = folder / "look.usda", list(_LINES)
    expected, names = REFUSED, ("look.usda",)
    match planned:
        case "type", line, kind:
            own, name = declaration(lines[line])
            lines[line] = retyped(lines[line], kind, rng)
            names = (*names, "/M")
            if name != "info:id" and (own == kind or (own, kind) == ("string", "token")):
                expected = ANY_MEANING
        case "connection", line, target:
            own, name = declaration(lines[line])
            prim = next(line.split('"')[1] for line in reversed(lines[:line]) if "Shader" in line)
            lines[line] = f"{own} {name}.connect = {target.replace('SELF', f'/M/{prim}.{name}')}"
            names, expected = (*names, "/M"), ANY_MEANING if target == "</M/Base.inputs:roughness>" else REFUSED
        case "animated", line:
            if ".connect" in lines[line]:
                expected = SOUND
            else:
                lines[line], names = animated(lines[line]), (*names, "/M", "animated")
        case "expression", text:
            line = next(number for number, line in enumerate(lines) if "inputs:expression" in line)
            lines[line] = f'string inputs:expression = "{text.replace("ODD", odd_text(rng))}"'
            names = (*names, "/M/Mask")
        case "ladder", count:
            lines = _ladder(count).splitlines()
            names = (*names, "/M/E")
            if count in (17, 29, 31):
                expected = frozenset({"silent"})  # it is a sound look, of another mask
    file.write_text("\n".join(lines) + "\n")
    if planned[0] in ("text", "place"):
        expected = spoil_layer(planned, rng, file, _TEXT)
    shown = Shown(_JOB, {"sound": _write})
    return Case(" ".join(str(part)[:40] for part in planned), expected, lambda: _read(file), _sound, names, shown=shown)


LOOKS = planned_kind("looks", _PLAN, make)
