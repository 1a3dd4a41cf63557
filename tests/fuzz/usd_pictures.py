"""How sound and changed USD assets are rendered, and what they may look like: in looks that show what is read."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import usd_text
from cases import Shown
from pictures import job, table
from pxr import Gf
from usd_sound import SOUND, Sound, Spot, sound_layer
from usd_text import shader

Write = Callable[[Any, Path], Path]
"""Writes a layer, and the files beside it, into a folder; returns the asset."""


_TAKEN = re.compile(r"(\S+\.inputs:\w+): is not carried(?:: .*?)? \((.*) (?:is|are) taken\)")
_KINDS = {"st": "float2", "wear": "float", "tint": "float3", "rust": "float"}


def probe(**varnames: str) -> str:
    """Return the text of a look that shows the primvars of the names given.

    A UV set `st`, `wear` and `tint` make its colour, `rust` its roughness; those without a name are constants.
    """
    return f'#usda 1.0\n( defaultPrim = "Probe" )\n{material("Probe", "", **varnames)}'


def material(name: str, above: str, **varnames: str) -> str:
    """Return the material of `probe`, below the prim of a path."""
    path, types = f"{above}/{name}", _KINDS | {"tint": "color3f"}

    def expression(name: str, kind: str, text: str) -> str:
        inputs = [
            f"{types[primvar]} inputs:{primvar}.connect = <{path}/{primvar}.outputs:result>"
            for primvar in varnames
            if re.search(rf"\b{primvar}\b", text)
        ]
        formula = f'string inputs:expression = "{text}"'
        return shader(name, "LookdevExpression", formula, *inputs, f"{kind} outputs:result")

    color = "clamp(0.5 * st + [0.3, 0.3, 0.5], 0, 1)" if "st" in varnames else "[0.5, 0.25, 0.75]"
    color += "".join(f" * (0.25 + 0.5 * {primvar})" for primvar in ("wear", "tint") if primvar in varnames)
    shaders = [
        expression("Color", "color3f", color),
        expression("Rough", "float", "rust" if "rust" in varnames else "0.5"),
    ]
    for primvar, varname in varnames.items():
        kind = _KINDS[primvar]
        text = f'string inputs:varname = "{varname}"'
        shaders.append(shader(primvar, f"UsdPrimvarReader_{kind}", text, f"{kind} outputs:result"))
    inputs = (
        f"color3f inputs:baseColor.connect = <{path}/Color.outputs:result>",
        f"float inputs:roughness.connect = <{path}/Rough.outputs:result>",
    )
    return usd_text.material(name, *inputs, scope=above, more="".join(shaders))


_PROBES: dict[str, tuple[str, str]] = {
    # What reads the primvars of a base, and the part that has them.
    "mesh": (probe(st="st", wear="wear", rust="rust"), "/Root/Body"),
    "cage": (probe(st="st"), "/Root/Body"),
    "curves": (probe(wear="wear"), "/Root/Hair"),
    "instances": (probe(rust="rust"), "/Root"),
}


def asset_job(file: str, sound: Sound, look: str = "") -> str:
    """Return the job that shows an asset."""
    more = f'[camera]\nusd = "{sound.camera}"' if sound.camera else ""
    return job(table(usd=file, time=sound.time), look, more=more)


def spot_shown(base: str, spot: Spot, file: Path, write: Write) -> Shown:
    """Return how an asset is rendered whose property `spot` is changed.

    Where a note says so, it may be the sound one without the property, without the value of it, or without the prim.
    """
    sound = SOUND[base]
    look, text = "", ""
    if base in _PROBES and spot.name not in ("primvars:displayColor", "visibility", "purpose"):
        text, part = _PROBES[base]
        look = table(material="probe.usda", parts=[part])
    elif spot.role in ("members", "expansion"):
        text, look = probe(), table(material="probe.usda", parts=[sound.collection])

    def placed(folder: Path, name: str) -> str:
        if text:
            (folder / "probe.usda").write_text(text)
        return asset_job(name, sound, look)

    def right(change: Callable[[Any, str], object]) -> Callable[[Path, str], str]:
        def write_right(folder: Path, notes: str) -> str:
            layer = sound_layer(sound)
            change(layer, notes)
            return placed(folder, write(layer, folder).name)

        return write_right

    operations = {
        f"without operation {number}": right(lambda layer, notes, number=number: _leave_out(layer, spot, number))
        for number in range(3 if spot.role == "order" else 0)
    }
    return Shown(
        placed(file.parent, file.name),
        {
            "sound": right(lambda layer, notes: None),
            "without the property": right(lambda layer, notes: _remove(layer, spot)),
            "without the prim": right(lambda layer, notes: setattr(layer.GetPrimAtPath(spot.prim), "active", False)),
            "as noted": right(_take),
            **operations,
        },
    )


def _remove(layer: Any, spot: Spot) -> None:
    layer.GetPrimAtPath(spot.prim).RemoveProperty(layer.GetPropertyAtPath(f"{spot.prim}.{spot.name}"))


def _leave_out(layer: Any, spot: Spot, number: int) -> None:
    attribute = layer.GetAttributeAtPath(f"{spot.prim}.{spot.name}")
    values = list(attribute.default)
    attribute.default = type(attribute.default)(values[:number] + values[number + 1 :])


def _take(layer: Any, notes: str) -> None:
    """Give inputs the values that notes say are taken."""
    for path, taken in _TAKEN.findall(notes):
        attribute = layer.GetAttributeAtPath(path)
        edits = attribute.connectionPathList
        if taken.startswith("the UV set"):
            edits.explicitItems = ["/Root/Looks/Preview/Reader.outputs:result"]
        else:
            numbers = [float(each) for each in taken.split(", ")]
            edits.ClearEdits()
            attribute.default = Gf.Vec3f(*numbers) if len(numbers) == 3 else numbers[0]
