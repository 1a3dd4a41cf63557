"""MaterialX documents with one thing wrong, imported as Disney layers or read as looks of a job."""

import random
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from cases import ANY, ANY_MEANING, Case, Reading, Shown, planned_kind, reading_of
from pictures import job
from text_changes import odd, spoil, text_plan
from usd_sound import PIXELS

from lookdev.material.materialx import import_materialx, write_usda
from lookdev.material.usd import read_look
from lookdev.material.usd.bound import read_any_look

_TEXT = """<?xml version="1.0"?>
<materialx version="1.39" colorspace="lin_rec709">
  <tiledimage name="image" type="color3">
    <input name="file" type="filename" value="color.png" colorspace="srgb_texture"/>
    <input name="texcoord" type="vector2" nodename="place"/>
  </tiledimage>
  <place2d name="place" type="vector2">
    <input name="texcoord" type="vector2" nodename="uv"/>
    <input name="scale" type="vector2" value="0.5, 0.5"/>
  </place2d>
  <texcoord name="uv" type="vector2"/>
  <SHADER name="S" type="surfaceshader">
    <input name="COLOR" type="color3" nodename="image"/>
    <input name="metallic" type="float" value="0.25"/>
    <input name="ROUGH" type="float" value="0.75"/>
    <input name="TINT" type="color3" value="0.5, 0.25, 1"/>
  </SHADER>
  <surfacematerial name="M" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="S"/>
  </surfacematerial>
</materialx>
"""
_WAYS = {
    "import": {"SHADER": "disney_principled", "COLOR": "baseColor", "ROUGH": "roughness", "TINT": "subsurfaceDistance"},
    "look": {"SHADER": "gltf_pbr", "COLOR": "base_color", "ROUGH": "roughness", "TINT": "sheen_color"},
}
_JOBS = {
    way: job('builtin = "sphere"', f'material = "{name}"') for way, name in (("import", "m.usda"), ("look", "m.mtlx"))
}
_VALUES = ("", "abc", "nan", "inf", "-inf", "1e400", "9" * 5000, "1, 2", "0.5 0.5", "true", "0x10", "1;2")
_VALUES += ("0.5 0.5 0.5 0.5", "ODD", "[1]")
_NAMES = ("", "nothing", "S", "ODD", "a/b", "../S", "M")
_TYPES = ("", "integer", "string", "boolean", "color4", "matrix44", "floatarray", "nothing", "ODD")
_CATEGORIES = ("nothing", "noise2d", "image", "ODDNAME", "nodegraph", "surface", "mix")
_DEEP = "<nodegraph name='g'>"
_BOMB = '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
_WHOLE: dict[str, tuple[str, str]] = {
    "a type definition": ("<materialx", f"{_BOMB}<materialx"),
    "no version": ('version="1.39" ', ""),
    "version 1.36": ("1.39", "1.36"),
    "version 9.9": ("1.39", "9.9"),
    "version x": ("1.39", "x" * 3000),
    "another root": ("materialx", "html"),
    "deep nesting": ("<texcoord", _DEEP * 900 + "</nodegraph>" * 900 + "<texcoord"),
    "deeper nesting": ("<texcoord", _DEEP * 100_000),
    "two of a name": ('name="place"', 'name="image"'),
    "a cycle": ('nodename="uv"', 'nodename="place"'),
    "a long cycle": (
        '<texcoord name="uv" type="vector2"/>',
        '<texcoord name="uv" type="vector2"><input name="in" type="vector2" nodename="place"/></texcoord>',
    ),
    "no material": ("surfacematerial", "volumematerial"),
    "an entity": ('value="0.25"', 'value="&quot"'),
    "an unknown entity": ('value="0.25"', 'value="&lol;"'),
    "a control character": ('value="0.25"', 'value="&#27;[31m"'),
    "a character 0": ('value="0.25"', 'value="&#0;"'),
}


def _spots(attribute: str) -> list[int]:
    """Return the numbers of the lines of a layer's own or its texture's inputs, that have an attribute."""
    return [number for number, line in enumerate(_TEXT.splitlines()) if f" {attribute}=" in line and "<input" in line]


_NUMBERS = [number for number in _spots("value") if "filename" not in _TEXT.splitlines()[number]]
_FILES = ("", "nothing.png", "ODD", ".", "m.mtlx", "a<UDIM>.png", "@@@")
_PLAN: tuple[tuple[Any, ...], ...] = tuple(
    (sort, way, *rest)
    for way in _WAYS
    for sort, *rest in (
        *(("value", line, value) for line in _NUMBERS for value in _VALUES if (line, value) != (_NUMBERS[0], "1, 2")),
        *(("nodename", line, name) for line in _spots("nodename") for name in _NAMES),
        *(("type", line, kind) for line in _spots("type") for kind in _TYPES),
        *(("name", line) for line in _spots("name")),
        *(("category", kind) for kind in _CATEGORIES),
        *(("file", name) for name in _FILES),
        *(("whole", name) for name in _WHOLE),
        *text_plan(3),
    )
)


def _text(way: str) -> str:
    text = _TEXT
    for word, name in _WAYS[way].items():
        text = text.replace(word, name)
    return text


def _read(way: str, file: Path) -> Reading:
    if way == "import":
        found = import_materialx(file)
        write_usda(found, file.with_suffix(".usda"), replace=True)
        name = found.materials[0].name if found.materials else ""
        prim = None if len(found.materials) == 1 else f"/{name}"
        materials, notes = repr(read_look(file.with_suffix(".usda"), prim, name="M")), found.losses
    else:
        look = read_any_look(file, None, {}, "M")
        materials, notes = repr(look.look), look.losses
    folder = str(file.parent)
    return Reading(
        {"materials": materials.replace(folder, "FOLDER")}, tuple(str(note).replace(folder, "") for note in notes)
    )


def _write(way: str, text: str, folder: Path, notes: str = "") -> str:
    """Write a document, and the look that is imported from it; return the job that shows it."""
    (folder / "color.png").write_bytes(PIXELS)
    (folder / "m.mtlx").write_text(text)
    if way == "import":
        write_usda(import_materialx(folder / "m.mtlx"), folder / "m.usda", replace=True)
    return _JOBS[way]


_SOUND = {
    way: reading_of(partial(_write, way, _text(way)), lambda folder, way=way: _read(way, folder / "m.mtlx"))
    for way in _WAYS
}


def make(rng: random.Random, planned: tuple[Any, ...], folder: Path) -> Case:
    """Write the files of a case."""
    sort, way, *rest = planned
    (folder / "color.png").write_bytes(PIXELS)
    file, text = folder / "m.mtlx", _text(way)
    lines = text.splitlines(keepends=True)
    strange = re.sub(r'[<>&"\x00-\x1f]', "-", odd(rng))
    # What is not carried is noted, what is broken is refused; which of them depends on the node.
    expected, names = ANY, ("m.mtlx|m.usda",)
    match sort, *rest:
        case "value" | "nodename" | "type", line, value:
            lines[line] = re.sub(rf' {sort}="[^"]*"', f' {sort}="{value.replace("ODD", strange)}"', lines[line])
        case "name", line:
            lines[line] = re.sub(r' name="[^"]*"', f' name="{strange.replace(" ", "")[:4000]}"', lines[line])
        case "category", kind:
            lines = [text.replace("tiledimage", kind.replace("ODDNAME", "x" * 3000))]
        case "file", name:
            lines = [text.replace("color.png", name.replace("ODD", strange))]
        case "whole", name:
            lines = [text.replace(*_WHOLE[name])]
            expected = ANY_MEANING if name in ("an entity", "a control character") else expected
    if sort in ("text", "place"):
        expected, words = spoil((sort, *rest), rng, file, text)
        names = (*names, *words)
    else:
        file.write_text("".join(lines))
    right = {"sound": partial(_write, way, text)} | _as_noted(way, text, sort, rest)
    # Of another node there is another picture.
    shown = None if (sort, way) == ("category", "look") else Shown(_JOBS[way], right)
    title = " ".join(str(part)[:40] for part in planned)
    return Case(title, expected, lambda: _read(way, file), _SOUND[way], names, (), shown)


def _as_noted(way: str, text: str, sort: str, rest: list[Any]) -> dict[str, Callable[[Path, str], str]]:
    """Return how documents are written without what a note may say is lost: the line, its node, or the texture."""
    lines = text.splitlines(keepends=True)
    colored = next(number for number, line in enumerate(lines) if 'nodename="image"' in line)
    placed = next(number for number, line in enumerate(lines) if 'nodename="place"' in line)
    without = {"without the texture": colored, "without its place": placed}
    if sort in ("value", "nodename", "type", "name"):
        without["without the line"] = rest[0]
    black = text.replace('nodename="image"', 'value="0, 0, 0"')
    return {"black": partial(_write, way, black)} | {
        name: partial(_write, way, "".join(lines[:number] + lines[number + 1 :])) for name, number in without.items()
    }


MATERIALX = planned_kind("MaterialX", _PLAN, make)
