"""The layers of looks as JSON rows for the Designer's page: a row for each layer, and in it a row for each parameter.

A parameter's value is a constant, or varies over the surface and has a source: an image, a primvar or an expression.
Sources, and masks, are converted to and from the text that a user types.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from lookdev.brdf import MASK, MODELS, Parameter
from lookdev.codegen.program.look import live_name
from lookdev.errors import LookdevError
from lookdev.material import Bump, Coordinates, Formula, Layer, Look, Primvar, Texture
from lookdev.material.expression import ExpressionKind
from lookdev.material.library.masks import MaskExpression, MaskImage, MaskSource, parse_mask
from lookdev.material.library.stack import LayerEntry, LookOutline
from lookdev.material.usd import MODES
from lookdev.studio.roots import is_below

NO_PART = (
    "a mask cannot select a part: assign a look of its own to the part, or give the asset a primvar, and the mask "
    "primvar:NAME"
)


def layer_rows(
    look: Look, outline: LookOutline | None, folder: Path | None, solo: int | None
) -> Iterator[dict[str, Any]]:
    """Yield a row for each layer of a stack, base first, disabled layers included.

    `outline` lists all layers of the stack; it is None if the look cannot be edited. Paths of images are relative to
    `folder`, the folder of the look's file. `solo` is the number of the layer that is shown alone, if there is one. In
    a row, ``number`` is the layer's number in the stack, and ``index`` its index in the look, which lacks disabled
    layers.
    """
    entries = outline.entries if outline else [LayerEntry(n, layer.name) for n, layer in enumerate(look.layers)]
    index = 0
    for entry in entries:
        if not entry.enabled:
            yield {"number": entry.number, "index": None, "name": entry.name, "enabled": False, "mode": entry.mode}
            continue
        layer = look.layers[index]
        is_own = layer.model in MODELS  # not a layer that is translated from another shading model
        # The layer's index in the look that the viewport draws, or None if it is not drawn. The names of its uniforms
        # contain this index.
        drawn_index = index if solo is None else 0 if solo == entry.number else None
        yield {
            "number": entry.number,
            "index": index,
            "name": entry.name,
            "enabled": True,
            "mode": layer.mode,
            "model": layer.model,
            "modes": [mode for mode in MODES if is_own and mode in MODELS[layer.model].modes],
            "own": is_own,
            "title": MODELS[layer.model].title if is_own else layer.model,
            "parameters": [*_parameter_rows(index, layer, drawn_index, folder)],
            "mask": _source_row(layer.mask, folder) if index else None,
        }
        index += 1


def _parameter_rows(index: int, layer: Layer, drawn_index: int | None, folder: Path | None) -> Iterator[dict[str, Any]]:
    """Yield the rows of a layer's mask, unless it is the base, of its parameters, and of numbers in expressions."""
    if index > 0:
        # A solo layer is drawn without its mask, so the mask is not a uniform.
        yield _parameter_row(drawn_index if drawn_index else None, MASK, layer.mask)
        yield from _number_rows("mask", layer.mask)
    if layer.model in MODELS:
        for parameter in MODELS[layer.model].parameters.values():
            if parameter.file is None:
                value = layer.inputs.get(parameter.name)
                yield {**_parameter_row(drawn_index, parameter, value), "source": _source_row(value, folder)}
                yield from _number_rows(parameter.name, value)


def _number_rows(owner: str, value: Any) -> Iterator[dict[str, Any]]:
    """Yield a row for each constant number among the inputs of an expression.

    `value` is the value of the parameter `owner`; without an expression, there are no rows.
    """
    for name, number in value.inputs.items() if isinstance(value, Formula) else ():
        if isinstance(number, float | int):
            parameter = Parameter(f"{owner}.{name}", "float", float(number), (0.0, max(1.0, 2.0 * abs(number))))
            yield _parameter_row(None, parameter, float(number))


def _parameter_row(drawn_index: int | None, parameter: Parameter, value: Any) -> dict[str, Any]:
    """Return the row of a parameter, whose value in the look is `value`.

    `value` is None if the look does not state it. `drawn_index` is the layer's index in the look that the viewport
    draws, or None if the parameter is not a uniform there. ``varies`` describes the source of a value that is not a
    constant. ``uniform`` is the name of the parameter's uniform in the viewport's shader, or empty.
    """
    constant = isinstance(value, float | int | str | tuple)
    live = drawn_index is not None and isinstance(value, float | tuple)
    return {
        "name": parameter.name,
        "kind": parameter.kind,
        "default": parameter.default,
        "value": value if constant else None,
        "varies": "" if constant or value is None else describe_source(value),
        "uniform": live_name(drawn_index, parameter.name) if live and drawn_index is not None else "",
        "soft": parameter.soft,
        "hard": parameter.hard,
        "choices": parameter.choices,
        "help": parameter.help,
    }


def describe_source(value: Any) -> str:
    """Return a description, for the user, of the source of a parameter that varies over the surface."""
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


def _source_row(mask: Any, folder: Path | None) -> dict[str, Any]:
    """Return the ``kind`` and the ``text`` of a mask, or of a parameter's source, in the syntax of `parse_mask`.

    ``inputs`` has the texts of the inputs of an expression, by name.
    """
    inputs = mask.inputs if isinstance(mask, Formula) else {}
    kind = {Texture: "texture", Primvar: "primvar", Formula: "expression"}.get(type(mask), "number")
    return {
        "kind": kind,
        "text": "" if mask is None else _source_text(mask, folder),
        "inputs": {name: _source_text(source, folder) for name, source in inputs.items()},
    }


def _source_text(source: Any, folder: Path | None) -> str:
    """Return a source, or a constant, in the syntax of `parse_mask`; paths are relative to `folder`."""
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
            return " ".join(f"{component:g}" for component in source)
    return "the view"


def read_source(
    text: str,
    inputs: Mapping[str, str],
    folder: Path,
    roots: list[Path],
    target: str = "mask",
    kind: ExpressionKind = "float",
) -> MaskSource:
    """Return the mask, or the source of a parameter, that a text of the page describes.

    `inputs` has the texts of the inputs of an expression, by name. Paths of images are relative to `folder`, the folder
    of the look's file. `target` is ``"mask"`` or the name of the parameter, whose values are of type `kind`. Raises
    LookdevError if the text is not valid, or an image is outside of the folders `roots`.
    """
    if target == "mask" and text.strip().startswith("part:"):
        raise LookdevError(NO_PART)
    assignments = [f"{name}={value.strip()}" for name, value in inputs.items()]
    source = parse_mask(text.strip(), assignments, folder, target, kind)
    if target != "mask" and isinstance(source, float):
        raise LookdevError(f"{target}: {text.strip()} is a constant: its slider sets it")
    sources = [source] if not isinstance(source, MaskExpression) else list(source.inputs.values())
    for image in sources:
        if isinstance(image, MaskImage) and not is_below(image.file, roots):
            below = ", ".join(map(str, roots))
            raise LookdevError(f"{image.file}: this page reads only images in these folders: {below}; copy it there")
    return source
