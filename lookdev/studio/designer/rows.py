"""The layers of looks for the page: a row for each parameter, and masks as they are typed."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from lookdev.brdf import MASK, MODELS, Parameter
from lookdev.codegen.program.look import live_name
from lookdev.errors import LookdevError
from lookdev.material import Formula, Look, Texture
from lookdev.material.expression import Kind
from lookdev.material.library.masks import Computed, Image, Mask, parse_mask
from lookdev.material.library.stack import Entry, Outline
from lookdev.material.look import Bump, Coordinates, Layer, Primvar
from lookdev.material.usd import MODES

NO_PART = (
    "a look does not know which part wears it: dress the part in a look of its own, or give the asset a primvar, and "
    "the mask primvar:NAME"
)


def layer_rows(look: Look, outline: Outline | None, folder: Path | None, solo: int | None) -> Iterator[dict[str, Any]]:
    """Yield each layer of a stack, base first, also those that are not enabled.

    `number` is that of the stack, `place` that of the look, which has no layer that is not enabled. `solo` is the
    number of the only layer that is shown.
    """
    entries = outline.entries if outline else [Entry(k, each.name) for k, each in enumerate(look.layers)]
    place = 0
    for entry in entries:
        if not entry.enabled:
            yield {"number": entry.number, "place": None, "name": entry.name, "enabled": False, "mode": entry.mode}
            continue
        layer = look.layers[place]
        ours = layer.model in MODELS
        uniform = place if solo is None else 0 if solo == entry.number else None
        yield {
            "number": entry.number,
            "place": place,
            "name": entry.name,
            "enabled": True,
            "mode": layer.mode,
            "model": layer.model,
            "modes": [each for each in MODES if ours and each in MODELS[layer.model].modes],
            "own": ours,
            "title": MODELS[layer.model].title if ours else layer.model,
            "parameters": [*_parameters(place, layer, uniform, folder)],
            "mask": _words(layer.mask, folder) if place else None,
        }
        place += 1


def _parameters(place: int, layer: Layer, uniform: int | None, folder: Path | None) -> Iterator[dict[str, Any]]:
    if place > 0:
        # The only layer that is shown is shown whole.
        yield _row(uniform if uniform else None, MASK, layer.mask)
        yield from _numbers("mask", layer.mask)
    if layer.model in MODELS:
        for each in MODELS[layer.model].parameters.values():
            if each.file is None:
                value = layer.inputs.get(each.name)
                yield {**_row(uniform, each, value), "source": _words(value, folder)}
                yield from _numbers(each.name, value)


def _numbers(of: str, value: Any) -> Iterator[dict[str, Any]]:
    """Yield the numbers of an expression."""
    for name, number in value.inputs.items() if isinstance(value, Formula) else ():
        if isinstance(number, float | int):
            wide = Parameter(f"{of}.{name}", "float", float(number), (0.0, max(1.0, 2.0 * abs(number))))
            yield _row(None, wide, float(number))


def _row(uniform: int | None, parameter: Parameter, value: Any) -> dict[str, Any]:
    constant = isinstance(value, float | int | str | tuple)
    live = uniform is not None and isinstance(value, float | tuple)
    return {
        "name": parameter.name,
        "kind": parameter.kind,
        "default": parameter.default,
        "value": value if constant else None,
        "varies": "" if constant or value is None else varies(value),
        "uniform": live_name(uniform, parameter.name) if live and uniform is not None else "",
        "soft": parameter.soft,
        "hard": parameter.hard,
        "choices": parameter.choices,
        "help": parameter.help,
    }


def varies(value: Any) -> str:
    """Return what gives a parameter that varies its value, in words."""
    match value:
        case Texture():
            return f"texture {value.file.name}, {value.channel}"
        case Bump():
            return f"bump of {value.height.file.name}"
        case Primvar():
            return f"primvar {value.name}"
        case Formula():
            return f"expression {value.expression.text}"
    return "varies"


def _words(mask: Any, folder: Path | None) -> dict[str, Any]:
    """Return a mask, or what a parameter has, as `parse_mask` reads it, with the sources of its names."""
    inputs = mask.inputs if isinstance(mask, Formula) else {}
    kind = {Texture: "texture", Primvar: "primvar", Formula: "expression"}.get(type(mask), "number")
    return {
        "kind": kind,
        "text": "" if mask is None else _source(mask, folder),
        "inputs": {name: _source(each, folder) for name, each in inputs.items()},
    }


def _source(source: Any, folder: Path | None) -> str:
    match source:
        case Texture():
            return f"{os.path.relpath(source.file, folder or Path())}:{source.channel}"
        case Primvar():
            return f"primvar:{source.name}"
        case Coordinates():
            return f"uv:{source.st}"
        case Formula():
            return source.expression.text
        case float() | int():
            return f"{source:g}"
        case tuple():
            return " ".join(f"{each:g}" for each in source)
    return "the view"


def read_source(
    text: str,
    inputs: Mapping[str, str],
    folder: Path,
    roots: list[Path],
    what: str = "mask",
    kind: Kind = "float",
) -> Mask:
    """Return a mask of a page's words, or the source of a parameter; images are relative to the look's folder.

    Raises LookdevError where it is none, or an image is outside of the folders that the page may read.
    """
    if what == "mask" and text.strip().startswith("part:"):
        raise LookdevError(NO_PART)
    given = [f"{name}={value.strip()}" for name, value in inputs.items()]
    source = parse_mask(text.strip(), given, folder, what, kind)
    if what != "mask" and isinstance(source, float):
        raise LookdevError(f"{what}: {text.strip()} is a constant: its slider sets it")
    sources = [source] if not isinstance(source, Computed) else list(source.inputs.values())
    for each in sources:
        if isinstance(each, Image) and not any(each.file.resolve().is_relative_to(root.resolve()) for root in roots):
            below = ", ".join(map(str, roots))
            raise LookdevError(f"{each.file}: this page reads images below {below} alone; copy it there")
    return source
